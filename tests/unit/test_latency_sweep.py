"""Declared latency sweeps: cells, missions, keys, invalid declarations, and the slot arithmetic."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from edc_swarm.errors import InputError
from edc_swarm.experiments.latency.arithmetic import hold_delay_ms, in_time_share, lands, only_holds, starves
from edc_swarm.experiments.latency.declared import DEFAULTS, Cell, in_turn, mission_of, run_name, runs_of, sweep_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.mission.validation import read_toml
from tests.builders import entry, mission

SMALL: dict[str, Any] = {"delays_ms": [0, 250], "jitters_ms": [0], "losses": [0, 0.5], "uavs": [3], "repeats": 2}


def linked(uavs: int = 10, **link: Any) -> Mission:
    """Return a mission with one link for all UAVs."""
    return Mission(uavs=uavs, link=[Link(**link)])


def test_the_default_grid_is_the_promised_one() -> None:
    """Every combination appears once, with as many seeds as repeats."""
    sweep = sweep_of({})
    assert len(sweep.cells) == 7 * 3 * 4 * 2
    runs = runs_of(sweep, "sim")
    assert set(runs) == set(sweep.cells)
    assert len({run.key for run in in_turn(runs)}) == len(sweep.cells) * sweep.repeats
    assert [run.mission.seed for run in in_turn(runs)[: len(sweep.cells)]] == [0] * len(sweep.cells)


def test_a_cell_is_a_mission() -> None:
    """The swept link comes first, so that links of the mission take precedence where they match."""
    own: dict[str, Any] = {"sender": "u001", "loss": 1.0}
    sweep = sweep_of({**SMALL, "link": {"distribution": "normal"}, "mission": {"area_m2": 2500, "link": [own]}})
    mission = mission_of(sweep, Cell(3, 0.5, 20.0, 0.1, 50.0), 7)
    assert mission.link == [Link(delay_ms=50, jitter_ms=20, loss=0.1, distribution="normal"), Link(**own)]
    assert (mission.uavs, mission.dt_s, mission.seed, mission.area_m2) == (3, 0.5, 7, 2500)
    assert run_name(mission) == "k3-slot500-delay50-jitter20-loss10-seed7"


def test_the_documented_sweep_file() -> None:
    """The sweep file in docs/latency.md is valid and contains what the text says."""
    text = Path(__file__).parents[2].joinpath("docs/latency.md").read_text(encoding="utf-8")
    sweep = sweep_of(msgspec.toml.decode(text.split("```toml\n")[1].split("```")[0]))
    assert (sweep.link.distribution, sweep.mission.area_m2, sweep.mission.link[0].range_m) == ("lognormal", 40_000, 80)


def test_limits_of_a_mission() -> None:
    """A mission in which UAVs can only hold is short; others have their own limit or the declared one."""
    cells = {cell.delay_ms: cell for cell in sweep_of(SMALL).cells}
    limits = [
        [mission_of(sweep_of({**SMALL, **extra}), cells[delay_ms], 0).max_slots for delay_ms in (0, 250)]
        for extra in ({}, {"max_slots": 77}, {"hold_slots": 33}, {"mission": {"max_slots": 55}})
    ]
    assert limits == [[0, 100], [77, 100], [0, 33], [55, 100]]


def test_processes_have_a_grid_of_their_own() -> None:
    """The runs use `edc-swarm run`, and have other keys than those of the simulator."""
    sweep = sweep_of({"engine": "processes"})
    assert sweep.uavs == DEFAULTS["processes"]["uavs"]
    (cell, *_) = sweep.cells
    real, simulated = runs_of(sweep, "processes")[cell][0], runs_of(sweep, "sim")[cell][0]
    assert real.command == simulated.command.replace("edc-swarm sim", "edc-swarm run")
    assert real.key != simulated.key


@pytest.mark.parametrize(
    ("raw", "field"),
    [
        ({"delays_ms": [-1]}, "delays_ms[0]"),
        ({"delays_ms": []}, "delays_ms"),
        ({"delays_ms": [5, 5]}, "delays_ms"),
        ({"delays_ms": [float("nan")]}, "delays_ms[0]"),
        ({"losses": [0.5, 1.5]}, "losses[1]"),
        ({"slots_s": [0.001]}, "slots_s[0]"),
        ({"uavs": [1]}, "uavs[0]"),
        ({"repeats": 0}, "repeats"),
        ({"repeats": 1000}, "repeats"),
        ({"engine": "cloud"}, "engine"),
        ({"delay": 5}, "delay"),
        ({"link": {"distribution": "pareto"}}, "link.distribution"),
        ({"link": {"receiver": "u099"}}, "link[0].receiver"),
        ({"mission": {"link": [{"sender": "u099"}]}}, "link[1].sender"),
        ({"mission": {"r_m": -1}}, "mission.r_m"),
        ({"mission": {"planner": "best"}}, "planner"),
        ({"mission": {"vehicle": {"model": "multirotor", "a_max_mps2": 0.0}}}, "vehicle.a_max_mps2"),
        ({"mission": {"fault": ["kill u099 @3"]}}, "fault"),
        ({"uavs": [3, 500]}, "uavs"),
    ],
)
def test_what_is_refused(raw: dict[str, Any], field: str) -> None:
    """The error has the field and the value, before any run starts."""
    with pytest.raises(InputError) as refused:
        sweep_of(raw)
    assert refused.value.field == field


@pytest.mark.parametrize("text", [None, "delays_ms = [", "\x00"])
def test_files_that_are_no_sweeps(tmp_path: Path, text: str | None) -> None:
    """A file that is missing or not TOML is reported."""
    file = tmp_path / "sweep.toml"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="sweep file"):
        read_toml("sweep file", file)


@pytest.mark.parametrize(("delay_ms", "holds"), [(0, False), (249.4, False), (249.5, True), (400, True)])
def test_two_delays_fill_a_slot(delay_ms: float, holds: bool) -> None:
    """Two transports of half a millisecond each count too."""
    assert only_holds(linked(delay_ms=delay_ms)) is holds
    assert in_time_share(linked(delay_ms=delay_ms)) == (0.0 if holds else 1.0)


def test_slots_are_as_long_as_on_the_wall() -> None:
    """A mission at time scale 2 leaves half the time for messages."""
    assert hold_delay_ms(Mission(dt_s=0.5, time_scale=2.0)) == 124.5
    assert hold_delay_ms(Mission(dt_s=1.0)) == 499.5
    late = [Link(delay_ms=201, jitter_ms=20)]
    assert in_time_share(Mission(dt_s=1.0, time_scale=2.0, link=late)) == in_time_share(Mission(link=late)) < 0.6


def test_share_in_time_with_loss() -> None:
    """A fix, or its second copy after a slot without a command, and a command must arrive."""
    for loss in (0.1, 0.3, 0.5):
        both = (1 - loss) ** 2
        assert in_time_share(linked(loss=loss)) == pytest.approx(both * (1 + loss) / (1 + loss * both), abs=0.02)
    assert in_time_share(linked(loss=1.0)) == 0.0


def test_share_in_time_within_radio_range() -> None:
    """A UAV too far from the head's start has no command; those near it have all."""
    places = (("far", 90.0, 1.0), ("head", 0.0, 9.0), ("near", 20.0, 1.0), ("edge", 49.0, 1.0))
    roster = [entry(uav, (x_m, 0.0), (x_m, 0.0), r_m=1.0, energy_j=energy_j) for uav, x_m, energy_j in places]
    link = Link(range_m=50.0, shadowing_db=0.0)
    assert in_time_share(mission(roster, link=[link])) == pytest.approx(2 / 3)


def test_nobody_is_waited_for_when_all_are_in() -> None:
    """A head with a long tau plans at once when it has all fixes, so that commands are in time."""
    assert in_time_share(Mission(tau_s=0.4, link=[Link(delay_ms=120)])) == 1.0


def test_too_few_commands_for_the_longest_way() -> None:
    """A way of 40 steps needs 40 commands in time within the limit."""
    roster = [entry("a", target_m=(100.0, 0.0), r_m=1.0), entry("b", (0.0, 50.0), (5.0, 50.0), r_m=1.0)]
    short = mission(roster)
    assert starves(short, 0.1, 399)
    assert not starves(short, 0.1, 401)


def test_so_few_commands_that_uavs_land() -> None:
    """Of ways of 42 steps in all 42 (1 - p)^20 landings are expected, if UAVs land after 20 slots; 1 % is few."""
    roster = [entry("a", target_m=(100.0, 0.0), r_m=1.0), entry("b", (0.0, 50.0), (5.0, 50.0), r_m=1.0)]
    assert lands(mission(roster), 0.33)
    assert not lands(mission(roster), 0.35)
    assert not lands(mission(roster, land_after_s=20.0), 0.33)
    assert not lands(mission(roster, failsafe="hold"), 0.1)


def test_share_in_time_beyond_tau() -> None:
    """With fixes spread beyond tau only a quorum's count; a longer wait is worse if commands are late then."""
    spread = in_time_share(linked(delay_ms=201, jitter_ms=20))
    assert spread == pytest.approx(5 / 9, abs=0.01)
    assert in_time_share(linked(delay_ms=150, jitter_ms=20)) == 1.0
    assert 0.0 < in_time_share(linked(delay_ms=200, jitter_ms=200)) < 0.05
