"""Missions on measured networks: the delays are those of the file, a stall holds the swarm and harms nobody."""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path

import msgspec
import pytest

from edc_swarm.analysis.link_delays import link_delays_of
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.emulation.delay_log import quantiles
from edc_swarm.emulation.links import LinkEmulator
from edc_swarm.experiments.resimulation import judge
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.trace import Rows, Trace, pack, unpack
from edc_swarm.mission.validation import load_mission
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation

STALL_S, STALLED_AT_S = 7.0, 5.0


def recorded(mission: Mission) -> Recording:
    """Return the recording of a simulated mission."""
    message, said = mission_message(complete_mission(mission)), list[Message]()
    Simulation(message, lambda: make_planner("edc", message), lambda _key, one, _ns: said.append(one)).run()
    recording = Recording.from_messages(said)
    recording.run["clock"] = "virtual"
    return recording


def flown(mission: Mission) -> Recording:
    """Return the recording of a simulated mission, in which no guarantee is broken, and which can be repeated."""
    recording = recorded(mission)
    results = judge(recording)
    assert [(one.guarantee, str(found)) for one in results for found in one.violations] == []
    assert all(one.judged for one in results)
    return recording


def test_the_delays_of_a_simulation_are_those_of_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """The quantiles that every link tells are those of the rows before its messages, to the microsecond."""
    base = load_mission(Path("scenarios/measured_5g.toml"))
    rows = unpack(base.trace[0])
    sent_s, emulated = dict[tuple[str, str], list[float]](), LinkEmulator.arrivals_ns

    def watched(links: LinkEmulator, sender: str, at_s: float, size_bytes: int = 0) -> list[int]:
        sent_s.setdefault((sender, links.receiver), []).append(at_s)
        return emulated(links, sender, at_s, size_bytes)

    monkeypatch.setattr(LinkEmulator, "arrivals_ns", watched)
    link = msgspec.structs.replace(base.link[0], trace_offset="none")
    recording = recorded(msgspec.structs.replace(base, uavs=4, link=[link]))
    told = link_delays_of(recording)
    assert len(told) == 12
    for ends, found in told.items():
        places_us = [round(at_s * 1e9) // 1000 % rows.period_us for at_s in sent_s[ends]]
        delays_us = [rows.delay_us[bisect_right(rows.at_us, place_us) - 1] for place_us in places_us]
        assert (found.arrived, found.lost) == (len(delays_us), 0)
        assert found.delay_ms == [us / 1000 for us in quantiles(delays_us)]
    assert compute_metrics(recording).completed


@pytest.mark.parametrize("probed", [True, False])
@pytest.mark.parametrize("gap", ["stall", "loss"])
def test_a_stall_of_seven_seconds_holds_the_swarm_and_harms_nobody(*, probed: bool, gap: str) -> None:
    """Nobody flies while nothing passes, nobody lands, discs stay apart, and all arrive afterwards."""
    mission = msgspec.structs.replace(Mission(seed=3, uavs=6), trace=[stalling(probed=probed)])
    link = Link(trace="t", trace_offset="none", trace_gap=gap)  # type: ignore[arg-type]
    recording = flown(msgspec.structs.replace(mission, link=[link]))
    metrics = compute_metrics(recording)
    head = metrics.heads[0].head
    moved = {fix.slot for fix in recording.fixes if fix.executing and fix.uav != head}
    first, last = int(STALLED_AT_S / mission.dt_s) + 2, int((STALLED_AT_S + STALL_S) / mission.dt_s)
    assert moved.isdisjoint(range(first, last))
    assert min(moved) < first
    assert (metrics.completed, metrics.potential_collisions, metrics.true_collisions) == (True, 0, 0)
    assert not [event for event in recording.events if event.kind == EventKind.LANDED]


def stalling(*, probed: bool) -> Trace:
    """Return a trace of 20 ms with a stall: probes that arrive together at its end, or no probes at all."""
    at_ms = range(0, 60_000, 50)
    begin_ms, end_ms = 1000 * STALLED_AT_S, 1000 * (STALLED_AT_S + STALL_S)
    inside = [at for at in at_ms if begin_ms < at < end_ms]
    kept = [at for at in at_ms if probed or at not in inside]
    delay_ms = [end_ms + 20 - at if at in inside else 20 for at in kept]
    rows = Rows([1000 * at for at in kept], [round(1000 * delay) for delay in delay_ms], 60_000_000)
    return Trace(name="t", rows=len(kept), period_us=rows.period_us, packed=pack(rows))
