"""UAVs whose bodies are autopilots: a stand-in that speaks MAVLink over UDP and is as strict as ArduCopter."""

from __future__ import annotations

import json
import math
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edc_swarm.analysis.autopilots import TOLD_AFTER
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.evidence import gather
from edc_swarm.analysis.guarantees.inside import deviations_m
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.separation import least_gap_m
from edc_swarm.autopilot.pilot import Pilot
from edc_swarm.errors import RecordingError, SwarmError
from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from processes.host import autopilots
from processes.uav.autopilot_link import MAX_ADDRESSES, AutopilotLink
from tests.processes.conftest import Fly, await_true
from tests.set_points import set_points_off_m

pytest.importorskip("pymavlink")
STAND_IN = Path(__file__).with_name("stand_in.py")
ORIGIN_DEG = (60.1841, 24.8301)


def free_ports(count: int) -> list[int]:
    """Return the first of so many free UDP ports in a row, ten apart."""
    for first in range(20_000, 30_000, 97):
        ports = [first + 10 * index for index in range(count)]
        try:
            for port in ports:
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                    probe.bind(("127.0.0.1", port))
        except OSError:
            continue
        return ports
    raise AssertionError("no free ports")


class StandIns:
    """Stand-ins in a process of their own, one at each start."""

    def __init__(self, starts_m: list[tuple[float, float]], bent: dict[int, dict[str, Any]]) -> None:
        self.ports = free_ports(len(starts_m))
        orders = []
        for index, (port, start_m) in enumerate(zip(self.ports, starts_m, strict=True)):
            lat, lon = to_wgs84(*start_m, *ORIGIN_DEG)
            orders.append({"port": port, "lat": lat, "lon": lon, "system": index + 1, **bent.get(index, {})})
        present = [order for order in orders if order.get("wrong") != "none"]
        command = [sys.executable, str(STAND_IN), json.dumps(present)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def logs(self) -> list[dict[str, Any]]:
        """End them, and return what each of them did."""
        self.process.send_signal(signal.SIGTERM)
        found: list[dict[str, Any]] = json.loads(self.process.communicate(timeout=30)[0])
        return found


Stand = Callable[..., StandIns]


@pytest.fixture
def stand() -> Iterator[Stand]:
    """Start stand-ins; kill those that are left at the end."""
    started: list[StandIns] = []

    def go(starts_m: list[tuple[float, float]], bent: dict[int, dict[str, Any]] | None = None) -> StandIns:
        started.append(StandIns(starts_m, bent or {}))
        return started[-1]

    yield go
    for each in started:
        each.process.kill()
        each.process.communicate()


def fields(starts_m: list[tuple[float, float]], port: int, **vehicle: Any) -> dict[str, Any]:
    """Return a mission of UAVs that fly 16 m to the north, each from its start."""
    return {
        "name": "stand-ins",
        "r_m": 4.0,
        "v_max_mps": 4.0,
        "dt_s": 1.0,
        "land_after_s": 6.0,
        "landing_s": 4.0,
        "vehicle": {
            "model": "mavlink",
            "autopilot": f"udpin:127.0.0.1:{{{port}+10*i}}",
            "altitude_m": 2.0,
            "takeoff_s": 8.0,
            "free_mps": 3.0,
            **vehicle,
        },
        "roster": [
            {"uav": f"u{k + 1:03d}", "start_x_m": x, "start_y_m": y, "target_x_m": x, "target_y_m": y + 16.0}
            for k, (x, y) in enumerate(starts_m)
        ],
    }


def toml(value: dict[str, Any]) -> str:
    """Return a mission as TOML."""
    lines = [f"{key} = {json.dumps(item)}" for key, item in value.items() if not isinstance(item, dict | list)]
    lines += ["[vehicle]", *(f"{key} = {json.dumps(item)}" for key, item in value["vehicle"].items())]
    for entry in value["roster"]:
        lines += ["[[roster]]", *(f"{key} = {json.dumps(item)}" for key, item in entry.items())]
    return "\n".join(lines)


def require_truths(recording: Recording, uavs: list[str], slots_before_end: int = TOLD_AFTER) -> None:
    """Assert that every slot of some UAVs has a truth, but for the last ones, which end before they are reported."""
    for uav in uavs:
        last = max(fix.slot for fix in recording.fixes if fix.uav == uav)
        told = [truth.slot for truth in recording.truths if truth.uav == uav]
        assert told[: last + 1 - slots_before_end] == list(range(last + 1 - slots_before_end)), uav


def judged(recording: Recording, uav: str, places: list[tuple[int, int, int]]) -> float:
    """Return how far the set-points that an autopilot received are from the declared path, at most."""
    return set_points_off_m(recording.mission, recording.mission.epoch_ns, uav, recording.fixes, places)


@pytest.mark.timing
def test_those_that_follow_finish_and_those_that_fail_are_told(start: Fly, stand: Stand, tmp_path: Path) -> None:
    """Seven stand-ins: one refuses to arm, one falls silent, a pilot takes over one; four fly there and land."""
    starts_m = [(20.0 * index, 0.0) for index in range(7)]
    bent = {1: {"wrong": "silent", "after": 9.0}, 3: {"wrong": "refuses"}, 5: {"wrong": "leaves", "after": 8.0}}
    flown_by = stand(starts_m, bent)
    mission_file = tmp_path / "mission.toml"
    mission_file.write_text(toml(fields(starts_m, flown_by.ports[0])))
    flown = start("run", str(mission_file), "--arm", "--overload", "fly", "--json").end()
    logs = flown_by.logs()
    assert flown.json["completed"] is False, flown.stderr
    recording = flown.recording
    told = {event.source: event.detail for event in recording.events if event.kind in {"strayed", "grounded"}}
    assert sorted(told) == ["u002", "u004", "u006"]
    assert "reported no position" in told["u002"]
    assert "does not arm (failed): PreArm" in told["u004"]
    assert "left GUIDED for LOITER: Mode changed by pilot" in told["u006"]
    last = {fix.uav: fix for fix in recording.fixes if fix.voter}
    assert {uav for uav, fix in last.items() if fix.arrived} >= {"u001", "u003", "u005", "u007"}
    for index in (0, 2, 4, 6):
        events = [what for _, what in logs[index]["events"]]
        assert events == ["mode 4", "armed", "take-off to 2", "mode 9", "disarmed on the ground"]
        assert judged(recording, f"u{index + 1:03d}", logs[index]["places"]) < 0.05
        assert set(logs[index]["rejected"]) <= {"not flying in GUIDED"}
    assert [what for _, what in logs[3]["events"]] == ["mode 4"]
    assert "mode 9" not in [what for _, what in logs[5]["events"]], "nobody fights the pilot"
    metrics = compute_metrics(recording)
    require_truths(recording, ["u001", "u003", "u005", "u006", "u007"])
    evidence = gather(recording)
    assert evidence.paths is not None
    bodies_m = evidence.paths.moves_m(*evidence.tracks.bodies_m)
    assert least_gap_m(*bodies_m, np.zeros(7)) > 10.0, "20 m apart, and nobody was near another one"
    assert (metrics.potential_collisions, metrics.true_collisions) == (0, None)
    separation = next(verdict for verdict in check(recording) if verdict.guarantee == "G3")
    assert separation.status == "not-judged"
    assert "slots that autopilots did not report" in str(separation), "nobody knows where the silent one was"
    assert "of u002" in str(separation)
    off_m = deviations_m(evidence, evidence.paths)
    assert np.nanmax(off_m) < 1.5, "of a disc of 4 m"
    for index in (0, 2, 4, 6):
        assert math.dist(logs[index]["landed_at_m"], (0.0, 16.0)) < 1.0, "it flew out its last step before it landed"
    causes = {away.uav: away.cause for away in metrics.not_home}
    assert causes == {"u002": "strayed", "u004": "grounded", "u006": "strayed"}
    assert [str(verdict) for verdict in check(recording) if verdict.broken] == []
    strays = {uav for report in recording.reports for uav in (report.strays or [])}
    assert strays == {"u002", "u006"}
    radii = [dict(zip(r.hull_uav, r.hull_r_m, strict=True)).get("u002", 0.0) for r in recording.reports if r.strays]
    grown_m = np.diff(sorted({round(radius, 1) for radius in radii if radius}))
    assert len(grown_m) >= 2, "its hull grows from slot to slot"
    assert np.median(grown_m) == pytest.approx(3.0, abs=0.2), "by what it can fly in one"


@pytest.mark.timing
@pytest.mark.long
def test_ctrl_c_in_flight_lands_all_and_one_whose_process_is_dead_lands_by_itself(
    start: Fly, stand: Stand, tmp_path: Path
) -> None:
    """Three fly 80 m; the process of one is killed, then Ctrl-C: all are on the ground, and the record is whole."""
    starts_m = [(20.0 * index, 0.0) for index in range(3)]
    values = {"FS_GCS_TIMEOUT": 3.0, "GUID_TIMEOUT": 1.0}
    flown_by = stand(starts_m, {index: {"parameters": values} for index in range(3)})
    mission = fields(starts_m, flown_by.ports[0])
    for entry in mission["roster"]:
        entry["target_y_m"] = 80.0
    mission_file = tmp_path / "mission.toml"
    mission_file.write_text(toml(mission))
    command = start("run", str(mission_file), "--arm", "--overload", "fly", "--fault", "kill u003 @3s")
    part = command.path.with_name(command.path.name + ".part")

    def flies(slot: int) -> bool:
        with suppress(RecordingError):
            return any(fix.slot >= slot for fix in read_recording(part, salvage=True).fixes)
        return False

    command.await_file(lambda: flies(8))
    command.process.send_signal(signal.SIGINT)
    ended = command.end()
    logs = flown_by.logs()
    flew = ["mode 4", "armed", "take-off to 2"]
    for log in logs[:2]:
        assert [what for _, what in log["events"]] == [*flew, "mode 9", "disarmed on the ground"]
    alone = [*flew, "ground station failsafe", "mode 9", "disarmed on the ground"]
    assert [what for _, what in logs[2]["events"]] == alone
    told = {(event.source, event.detail) for event in ended.recording.events if event.kind == "autopilot"}
    assert {("u001", "has landed, and its motors are off"), ("u002", "has landed, and its motors are off")} <= told
    assert [str(verdict) for verdict in check(ended.recording) if verdict.broken] == []
    assert "Traceback" not in ended.stderr


def test_bad_autopilots_are_named_and_nothing_is_armed(
    stand: Stand, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody there, garbage, another dialect, MAVLink 1, a plane, a stranger, two in three ways: one line each."""
    monkeypatch.setattr(autopilots, "READY_S", 3.0)
    wrong = ["", "none", "garbled", "plane", "stranger", "twin", "", "double", "mavlink1", "dialect"]
    starts_m = [(20.0 * index, 0.0) for index in range(len(wrong))]
    bent: dict[int, dict[str, Any]] = {index: {"wrong": kind} for index, kind in enumerate(wrong) if kind}
    bent[6] = {"system": 1}
    flown_by = stand(starts_m, bent)
    mission: Mission = complete_mission(mission_from_dict(fields(starts_m, flown_by.ports[0])))
    with pytest.raises(SwarmError, match="nothing was armed: 9 of 10 autopilots are not ready"):
        autopilots.check_ready(mission, [entry.uav for entry in mission.roster], arm=True)
    lines = capsys.readouterr().err.splitlines()
    for line, said in zip(
        lines,
        [
            "ready, ArduPilot, system 1; without set-points it stops after 3 s, without its process it lands after 5 s",
            "no autopilot: nothing came",
            "no heartbeat within 3 s: what comes is no MAVLink",
            "vehicle type 1 is no multicopter",
            "neither ArduPilot nor PX4",
            "more than one autopilot speaks there: systems [6, 7]",
            "the system number of the autopilot of u001",
            "two autopilots speak there with system number 8",
            "it speaks MAVLink 1: set SERIALn_PROTOCOL",
            "no heartbeat within 3 s, but",
            "warning: u001: without set-points it flies on for 3 s with its last velocity: set GUID_TIMEOUT to",
        ],
        strict=True,
    ):
        assert said in line
    assert all(log["events"] == [] for log in flown_by.logs())


def test_strangers_at_an_autopilots_port_are_counted_and_not_all_answered(stand: Stand) -> None:
    """Forty senders of garbage: pymavlink would send every set-point to each of them."""
    flown_by = stand([(0.0, 0.0)])
    mission = complete_mission(mission_from_dict(fields([(0.0, 0.0)], flown_by.ports[0])))
    pilot = Pilot(mission, mission.roster[0], 1 << 62, arm=False)
    link = AutopilotLink(f"udpin:127.0.0.1:{flown_by.ports[0]}", pilot, time.monotonic_ns)
    try:
        await_true(lambda: not pilot.objections(time.monotonic_ns()))
        for _ in range(40):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.sendto(bytes(range(200)), ("127.0.0.1", flown_by.ports[0]))
        await_true(lambda: link.heard["stranger"] >= 40 - MAX_ADDRESSES)
        assert len(link._connection.clients) <= MAX_ADDRESSES
        assert "pieces that are no MAVLink" in link.complaints
        heard = pilot.telemetry.beat_ns
        await_true(lambda: pilot.telemetry.beat_ns > heard)
    finally:
        link.close()


def test_without_permission_nothing_is_armed(stand: Stand) -> None:
    """All are ready, and --arm is missing: the command says so and ends."""
    flown_by = stand([(0.0, 0.0)])
    mission = complete_mission(mission_from_dict(fields([(0.0, 0.0)], flown_by.ports[0])))
    with pytest.raises(SwarmError, match="--arm on the command line"):
        autopilots.check_ready(mission, ["u001"], arm=False)
    assert flown_by.logs()[0]["events"] == []
