"""Missions of several clusters: they complete, and the fuzzer finds the defects that its rule is for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from edc_swarm.agent.foreign import Foreign
from edc_swarm.agent.knowledge import Knowledge
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.outcome import not_home_of
from edc_swarm.experiments import fuzzing
from edc_swarm.experiments.fuzz_scenarios import scenario
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.prospect import COMPLETED
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import load_mission
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation
from edc_swarm.solver import foreign_rows

Patch = pytest.MonkeyPatch
SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.mark.parametrize(
    "name",
    ["crossing_clusters", "nested_clusters", pytest.param("exchanging_corners", marks=pytest.mark.long)],
)
def test_clusters_pass_through_each_other(name: str) -> None:
    """Every guarantee holds, among them G7: all UAVs are at their targets."""
    assert fuzzing.fly(load_mission(SCENARIOS / f"{name}.toml")) == []


def test_whoever_holds_in_the_air_keeps_others_from_their_targets_and_is_named() -> None:
    """A UAV of each cluster is killed and holds: all guarantees hold, and the mission is over with all others there.

    Three of them wait beside targets that the heads of other clusters cannot know to be free.
    """
    said = list[Message]()
    drawn = Mission(uavs=12, area_m2=9600.0, clusters=3, seed=1, failsafe="hold")
    faults = ["kill u004 @6", "kill u006 @9", "kill u005 @12"]
    mission = mission_message(complete_mission(msgspec.structs.replace(drawn, fault=faults)))
    end = Simulation(mission, lambda: make_planner("edc", mission), lambda _key, each, _ns: said.append(each)).run()
    recording = Recording.from_messages(said)
    assert [result.guarantee for result in check(recording) if result.broken] == []
    assert end.reason == COMPLETED
    waiting = {who.uav: who.by for who in not_home_of(recording) if who.cause == "beside"}
    assert waiting == {"u007": "u004", "u010": "u005", "u012": "u005"}
    cluster = {entry.uav: entry.cluster for entry in mission.roster}
    assert all(cluster[uav] != cluster[by] for uav, by in waiting.items())


def whole_gap(patch: Patch) -> None:
    """A head lets its UAVs take the whole gap to a foreign one."""
    rows = foreign_rows._heard_rows

    def mutant(*args: Any) -> Any:
        which, normal, room_m, spare_m = rows(*args)
        return which, normal, 2 * room_m, spare_m

    patch.setattr(foreign_rows, "_heard_rows", mutant)


def stale_fix(patch: Patch) -> None:
    """A head takes a fix of slot t - 1 for one of t."""

    def is_heard(self: Foreign, uav: str, slot: int) -> bool:
        return self._knowledge.last_slot(uav) >= slot - 1 and not self._knowledge.strays(uav)

    def heard(self: Foreign, slot: int) -> Any:
        return [self._seen(fix) for fix in self._knowledge.recent(slot - 1) if is_heard(self, fix.uav, slot)]

    patch.setattr(Foreign, "_is_heard", is_heard)
    patch.setattr(Foreign, "heard", heard)


def forgotten_cluster(patch: Patch) -> None:
    """A new head, which has heard nobody of another cluster yet, plans as if there was none."""
    hulls = Foreign.hulls

    def mutant(self: Foreign, slot: int, **which: Any) -> Any:
        known = {self._knowledge.index[uav] for uav in self._knowledge.newest}
        return [hull for hull in hulls(self, slot, **which) if hull.uav in known]

    patch.setattr(Foreign, "hulls", mutant)


def hull_that_does_not_grow(patch: Patch) -> None:
    """The hull of an unheard foreign UAV stays as it was."""
    place = Knowledge.place_after

    def mutant(self: Knowledge, uav: str, slot: int, *rules: Any) -> Any:
        return place(self, uav, min(slot, max(self.last_slot(uav), 0)), *rules)

    patch.setattr(Knowledge, "place_after", mutant)


DEFECTS: list[tuple[Callable[[Patch], None], int]] = [
    (whole_gap, 3),
    (stale_fix, 14),
    (hull_that_does_not_grow, 0),
    (forgotten_cluster, 35),
]
"""Defects, each with the first seed at which the fuzzer finds it (from seed 0 on)."""


@pytest.mark.parametrize(("defect", "seed"), DEFECTS, ids=[defect.__name__ for defect, _ in DEFECTS])
def test_the_fuzzer_finds(defect: Callable[[Patch], None], seed: int, monkeypatch: Patch) -> None:
    """A planted defect breaks the separation of clusters in a mission that holds without it."""
    with monkeypatch.context() as patch:
        defect(patch)
        broken = fuzzing.fly(scenario(seed, clusters=True))
    assert any(line.startswith("G3") for line in broken)
    assert fuzzing.search(seed, clusters=True) is None
