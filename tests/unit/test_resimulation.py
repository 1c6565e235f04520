"""G6: a second simulation finds a difference, and only a difference that proves a fault breaks G6."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.experiments.resimulation import MAX_SLOTS, check_same_bytes, judge
from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import Event
from edc_swarm.recording.model import Recording
from processes.cli.main import main
from processes.experiments.measures import simulate
from processes.runtime.run_facts import CODE, code_digest, run_facts, simulated_otherwise
from tests.unit.synthetic import flight, parallel, recorded

MISSION = Mission(uavs=3, area_m2=1000.0, planner="straight", fault=["kill u002 @4"])
RESTLESS = """
from itertools import count
from edc_swarm.planner.straight import Straight
from dataclasses import replace

planned = count()

class Restless(Straight):
    def plan(self, request):
        plan = super().plan(request)
        x_m, y_m = plan.waypoint_m[0]
        return replace(plan, waypoint_m=[(x_m + 1e-9 * next(planned), y_m), *plan.waypoint_m[1:]])
"""
"""A planner that remembers, in its module, what it has planned in other runs."""


@pytest.fixture
def restless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of that planner."""
    (tmp_path / "restless_planner.py").write_text(RESTLESS)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "restless_planner", raising=False)
    return "restless_planner:Restless"


def simulated(mission: Mission = MISSION) -> Recording:
    """Return a simulated mission, as `sim` records it."""
    recording, _ = simulate(mission)
    recording.run = {"clock": "virtual"}
    return recording


def test_the_same_mission_says_the_same_bytes() -> None:
    """All eight guarantees are judged, in order; the callback follows the second run slot by slot."""
    recording = simulated()
    watched: list[tuple[int, int]] = []
    results = judge(recording, "", lambda done, of: watched.append((done, of)))
    assert [result.guarantee for result in results] == [f"G{i}" for i in range(1, 9)]
    assert (results[5].status, results[5].notes) == (
        "held",
        [f"simulated again: {recording.message_count} messages are equal to the byte"],
    )
    slots = compute_metrics(recording).slots or 0
    assert watched == [(slot + 1, slots + 1) for slot in range(slots)]


def test_a_planner_that_remembers_other_runs_breaks_it(restless: str) -> None:
    """The messages differ from the first plan on."""
    result = check_same_bytes(simulated(msgspec.structs.replace(MISSION, planner=restless)), load_planner=True)
    assert result.broken
    assert any("command/u001 0: target_x_m was " in line for line in result.where)


@pytest.mark.parametrize("field", ["sent_ns", "energy_j", "x_m"])
def test_any_field_counts(field: str) -> None:
    """A change of a sending time, or of the last bit of a number, is found."""
    recording = simulated()
    fix = recording.fixes[7]
    changed = getattr(fix, field) * (1 + 2**-52) if field != "sent_ns" else fix.sent_ns + 1
    recording.fixes[7] = msgspec.structs.replace(fix, **{field: changed})
    result = check_same_bytes(recording)
    assert result.broken
    assert field in result.where[0]
    assert result.violations[0].slot == fix.slot


def test_minus_zero_is_other_bytes() -> None:
    """Minus zero equals zero as a number, but not in its bytes."""
    recording = simulated()
    i, fix = next((i, fix) for i, fix in enumerate(recording.fixes) if fix.lat_deg == 0.0 or fix.response_ms == 0.0)
    recording.fixes[i] = msgspec.structs.replace(fix, response_ms=-0.0)
    assert check_same_bytes(recording).where == [
        f"slot {fix.slot}: swarm/mission/uav/{fix.uav}/fix {fix.seq}: not the same bytes"
    ]


def test_what_is_not_said_again_breaks_it() -> None:
    """A message beyond those of the mission breaks G6."""
    recording = simulated()
    recording.events.append(Event(source="u001", instance="u001-9", kind="said once"))
    assert check_same_bytes(recording).violations[0].kind == "unsaid"


def test_a_difference_of_other_code_proves_nothing_but_equality_does(restless: str) -> None:
    """The verdict is "not judged", with the differences of version or machine."""
    recording = simulated(msgspec.structs.replace(MISSION, planner=restless))
    differs = check_same_bytes(recording, "made with numpy 1", load_planner=True)
    assert differs.status == "not-judged"
    assert "the recording was made with numpy 1" in differs.notes[0]
    assert check_same_bytes(simulated(), "made with numpy 1").held


@pytest.mark.parametrize("kept", [0.5, 0.0])
def test_what_the_record_lacks_is_not_judged(kept: float) -> None:
    """All recorded messages are equal, and the others are unknown."""
    recording = simulated()
    for said in recording.lists().values():
        del said[max(int(kept * len(said)), said is recording.missions) :]
    result = check_same_bytes(recording)
    assert result.status == "not-judged"
    assert result.notes[0].startswith("the record lacks ")


def test_a_planner_that_is_not_there_is_not_judged() -> None:
    """The verdict names the planner."""
    recording = simulated()
    recording.missions[0] = msgspec.structs.replace(recording.mission, planner="no_such_module:Planner")
    result = check_same_bytes(recording, load_planner=True)
    assert result.status == "not-judged"
    assert "no_such_module:Planner" in result.notes[0]


def test_a_recording_names_no_code_to_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`sim` loads the user's planner and judges; `check` and `report` import nothing of it, unless told to."""
    package, trace, path = tmp_path / "own_package", tmp_path / "imported", tmp_path / "run.mcap"
    package.mkdir()
    (package / "__init__.py").write_text(f"open({str(trace)!r}, 'a').close()")
    (package / "own.py").write_text("from edc_swarm.planner.straight import Straight as Own")
    monkeypatch.syspath_prepend(str(tmp_path))

    def run(*words: str) -> tuple[int, str]:
        for name in [name for name in sys.modules if name.startswith("own_package")]:
            monkeypatch.delitem(sys.modules, name)
        trace.unlink(missing_ok=True)
        status = main([*words])
        return status, capsys.readouterr().out

    status, said = run("sim", "--uavs", "2", "--seed", "5", "--planner", "own_package.own:Own", "--out", str(path))
    assert (status, trace.exists(), "G6 Same seed, same bytes: held" in said) == (0, True, True)
    status, said = run("check", str(path))
    assert (status, trace.exists()) == (3, False)
    why = "the planner own_package.own:Own is not one of this project's; give --load-planner to load it"
    assert f"G6 Same seed, same bytes: not judged ({why})" in said
    assert run("report", str(path))[0] == 0
    assert run("replay", "--verify", str(path))[0] == 2
    assert not trace.exists()
    status, said = run("check", "--load-planner", str(path))
    assert (status, trace.exists(), "G6 Same seed, same bytes: held" in said) == (0, True, True)


@pytest.mark.parametrize(
    ("run", "status"), [({"clock": "wall"}, "not-applicable"), ({}, "not-judged"), ({"clock": "sun"}, "not-judged")]
)
def test_who_made_it_must_be_known(run: dict[str, str], status: str) -> None:
    """Real processes depend on the machine's timing; a record of unknown origin is no simulation."""
    recording = recorded(flight(parallel()))
    recording.run = run
    assert check_same_bytes(recording).status == status


def test_a_record_that_claims_endless_slots_is_not_simulated() -> None:
    """A record with endless slots is not repeated, and one without motion ends."""
    recording = simulated()
    recording.events.append(Event(source="u001", slot=MAX_SLOTS + 1, kind="far"))
    assert "beyond" in check_same_bytes(recording).notes[0]


def test_sim_and_check_judge_all_guarantees(
    restless: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The commands return 0 for the default planner, and 1 for one that remembers, and name G6."""
    monkeypatch.chdir(tmp_path)
    flown = ["--uavs", "3", "--area", "40000", "--json"]

    def verdicts(status: int, *arguments: str) -> dict[str, Any]:
        assert main([*arguments]) == status
        said = msgspec.json.decode(capsys.readouterr().out)
        results = said if isinstance(said, list) else said["guarantees"]
        return {result["guarantee"]: result["status"] for result in results}

    good = verdicts(0, "sim", *flown, "--out", "good.mcap")
    assert good == verdicts(0, "check", "good.mcap", "--json") == {f"G{i}": "held" for i in range(1, 9)}
    bad = verdicts(1, "sim", *flown, "--planner", restless, "--out", "bad.mcap")
    again = "check", "bad.mcap", "--load-planner", "--json"
    assert (bad["G6"], verdicts(1, *again)["G6"]) == ("broken", "broken")
    (tmp_path / "restless_planner.py").write_text(RESTLESS + "# changed since\n")
    assert verdicts(3, *again)["G6"] == "not-judged"


def test_the_same_code_is_the_same_whatever_its_commit_is_called() -> None:
    """Other code, other libraries or another machine may publish other messages."""
    run = {**run_facts("virtual"), CODE: code_digest("edc")}
    assert simulated_otherwise({**run, "commit": "another"}, "edc") == ""
    assert "numpy 1.2.3" in simulated_otherwise({**run, "version numpy": "1.2.3"}, "edc")
    assert "another machine (abacus)" in simulated_otherwise({**run, "machine": "abacus"}, "edc")
    assert "other code" in simulated_otherwise({**run, CODE: "0"}, "edc")
