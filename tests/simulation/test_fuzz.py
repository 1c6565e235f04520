"""The fuzzer finds its old counterexamples again, and a sample of new runs keeps every guarantee."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from edc_swarm.experiments import fuzzing
from edc_swarm.experiments.fuzz_scenarios import RECKLESS, scenario
from edc_swarm.experiments.fuzzing import Counterexample, fly, search, smallest
from edc_swarm.mission.validation import mission_from_dict

ONCE_BROKEN = {
    "126": "a step accepted, never said, and then forgotten with the promise",
    "1743": "the same, and landed by that step: the judge counted from the step before",
    "1194": "a normal that separates nothing from the end of a previous step",
    "1220": "the same, without any fault",
    "1316": "the same, at a partition",
    "1401": "the same, planner edc",
    "1522": "the same, two UAVs",
    "10989": "a head that was still planning when the mission ended",
    "1856": "the same, on a slow computer: it said no last word",
    "406": "a vehicle that lags counted in the slot after it had landed",
    "705": "a process that was killed in its first step of all: nothing told who had ended it",
    "1017": "a landing that counted from a command which a newer grant had discarded",
    "999": "three UAVs in a tight fence that blocked each other for ever",
    "654": "a UAV that a dead one's hull and the fence held for ever, which no judge knew",
    "1762": "UAVs beside a fence that blocked each other for ever",
    "401907": "a head with a fast clock that planned before any fix of other clusters, so a hull covered a target",
}
MISSIONS = msgspec.json.decode(Path(__file__).with_name("once_broken.json").read_bytes())
"""The missions themselves, since a seed gives another one when the generator changes."""


@pytest.mark.parametrize("name", ONCE_BROKEN)
def test_what_was_once_broken_holds(name: str) -> None:
    """Runs that once broke a guarantee keep it."""
    assert fly(mission_from_dict(MISSIONS[name])) == []


@pytest.mark.parametrize("seed", range(7000, 7020))
def test_random_runs_keep_every_guarantee(seed: int) -> None:
    """This is a sample; `edc-swarm fuzz` executes thousands more."""
    assert search(seed) is None


def test_what_is_asked_and_not_judged_counts_as_broken() -> None:
    """A run that ends before G7 can be judged, or without time for a quorum, counts as broken."""
    (said,) = fly(mission_from_dict({"uavs": 4, "max_slots": 5}))
    assert said.startswith("G7: not judged: stopped after 5 slots (max_slots = 5 was given)")
    assert fly(mission_from_dict({"uavs": 4, "max_slots": 5, "planner": RECKLESS})) == []


def test_progress_is_asked_after_faults_that_never_end() -> None:
    """Some missions whose progress is checked have a link, partition or UAV with a fault without an end."""
    missions = [mission for seed in range(80) if (mission := scenario(seed)).planner == "edc"]
    last = [text for mission in missions for text in mission.fault if " for " not in text]
    for lasting in ("link *>* loss", "partition u", "freeze u001 @"):
        assert any(text.startswith(lasting) for text in last)
    assert all(mission.max_slots == 0 for mission in missions), "each lasts as long as G7 needs"


def test_a_scenario_depends_on_its_seed_alone() -> None:
    """The seed alone repeats a run."""
    assert scenario(11) == scenario(11)
    assert scenario(11) != scenario(12)


def test_faults_can_be_kept_by_index() -> None:
    """Shrinking drops faults by index, and the others stay the same."""
    whole = scenario(0).fault
    assert scenario(0, (1,)).fault == whole[1:2]


def test_shrinking_keeps_only_what_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The two faults that together break a guarantee remain."""

    def broken_by_1_and_2(seed: int, kept: tuple[int, ...], *, clusters: bool) -> Counterexample | None:
        assert not clusters
        return Counterexample(seed, tuple(kept), ("G1: broken",)) if {1, 2} <= set(kept) else None

    monkeypatch.setattr(fuzzing, "search", broken_by_1_and_2)
    assert smallest(Counterexample(5, (0, 1, 2, 3), ("G1: broken",))).kept == (1, 2)


def test_a_finding_names_its_replay() -> None:
    """One command line repeats the run."""
    assert Counterexample(5, (1, 2), ("G1",)).command == "edc-swarm fuzz --seed 5 --runs 1 --keep 1,2"
