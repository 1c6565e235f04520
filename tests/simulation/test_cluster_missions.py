"""Missions of several clusters: they complete, and the fuzzer finds the defects that its rule is for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from edc_swarm.agent.foreign import Foreign
from edc_swarm.agent.knowledge import Knowledge
from edc_swarm.experiments import fuzzing
from edc_swarm.experiments.fuzz_scenarios import scenario
from edc_swarm.mission.validation import load_mission
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
    (whole_gap, 2),
    (stale_fix, 8),
    (hull_that_does_not_grow, 0),
    (forgotten_cluster, 30),
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
