"""The numbers of the figures equal those of the simulator and of independent counts."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edc_swarm.analysis.columns import columns_of
from edc_swarm.analysis.energy_bill import energy_bills, exhausted
from edc_swarm.experiments.figures.catalogue import FIGURES, LONG_MISSION, Figure
from edc_swarm.experiments.figures.table import rows_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.power_models import EnergyModel
from edc_swarm.mission.roster import complete_mission
from edc_swarm.planner.registry import make_planner
from edc_swarm.simulation.closed_loop import AS_PRINTED, closed_loop
from processes.experiments.measures import fly, fly_long, fly_plan, simulate, time_forms, time_plans

sys.path.insert(0, str(Path(__file__).parents[1] / "paper"))
from tests.paper.test_paper_straight_counts import BY_UAVS, overlapping_pairs

COLLISION_FIGURES = [figure for figure in FIGURES if figure.name in {"4a", "4b", "4c"}]


@pytest.mark.parametrize("figure", COLLISION_FIGURES, ids=lambda figure: figure.name)
def test_straight_line_counts(figure: Figure) -> None:
    """The count equals the direct one, except for pairs that meet while a UAV slows down."""
    straight = replace(figure, series=figure.series[:1], axis=replace(figure.axis, values=figure.axis.values))
    results = {
        run.key: fly_plan(run.mission)
        for x in straight.axis.values
        for (run,) in straight.samples(straight.series[0], x, 1)
    }
    for row in rows_of(straight, 1, results):
        assert row.mean == pytest.approx(overlapping_pairs(straight.mission(row.x, 0)), abs=1)


@pytest.mark.parametrize("planner", ["straight", "paper"])
def test_plans_alone_give_the_simulators_numbers(planner: str) -> None:
    """For planners without avoidance, every number equals that of the simulated swarm."""
    mission = Mission(uavs=12, seed=4, planner=planner)
    flown, planned = fly(mission), fly_plan(mission)
    assert planned["potential_collisions"] > 0
    assert planned == pytest.approx({name: flown[name] for name in planned}, rel=1e-9, abs=1e-6)


def test_straight_line_mean_over_thirty_seeds() -> None:
    """For ten UAVs, the point of Fig. 4a equals the independent measurement."""
    figure = replace(FIGURES[0], series=FIGURES[0].series[:1], axis=replace(FIGURES[0].axis, values=(10,)))
    results = {run.key: fly_plan(run.mission) for (run,) in figure.samples(figure.series[0], 10, 30)}
    (row,) = rows_of(figure, 30, results)
    assert row.runs == 30
    assert row.mean == pytest.approx(BY_UAVS[10], abs=1)


@pytest.mark.parametrize(("uavs", "seed"), [(8, 0), (20, 1), (30, 2)])
def test_closed_loop_flies_what_the_swarm_flies(uavs: int, seed: int) -> None:
    """Planning without agents gives the simulator's path to the last bit."""
    mission = Mission(uavs=uavs, seed=seed)
    recording, _ = simulate(mission)
    whole = complete_mission(mission)
    first = min(command.slot for command in recording.commands)
    path_m, _ = closed_loop(whole, make_planner("edc", whole), first)
    flown_m = columns_of(recording).centre_m[first:]
    assert np.array_equal(path_m, flown_m[: len(path_m)])


@pytest.mark.parametrize("uavs", [10, 20])
def test_forms_of_the_papers_model_agree(uavs: int) -> None:
    """The printed and the eliminated form differ by less than 1e-5 m, and the printed one is slower."""
    found = time_forms(Mission(uavs=uavs))
    assert found["apart_m"] < 1e-5
    assert found["printed_s"] > found["eliminated_s"]


def test_printed_planner_flies_as_the_eliminated_one() -> None:
    """Both forms give the same path and collisions for the same mission."""
    printed, eliminated = (fly(Mission(uavs=6, planner=planner)) for planner in (AS_PRINTED, "paper"))
    assert printed["path_m"] == pytest.approx(eliminated["path_m"], abs=1e-4)
    assert printed["potential_collisions"] == eliminated["potential_collisions"]


def test_plan_times_are_of_all_slots() -> None:
    """Total, median and longest slot are consistent."""
    found = time_plans(Mission(uavs=6))
    assert found["median_s"] <= found["max_s"] <= found["total_s"] <= found["slots"] * found["max_s"]
    assert found["compute_j"] == pytest.approx(5.0 * found["total_s"])


def test_bills_are_what_the_batteries_lost() -> None:
    """Cruise, hover and radio of each UAV sum to the loss of its battery."""
    mission = Mission(uavs=6, energy=EnergyModel(radio_j_per_message=0.25))
    recording, _ = simulate(mission)
    for bill, entry in zip(energy_bills(recording), recording.mission.roster, strict=True):
        assert None not in (bill.left_j, bill.cruise_j, bill.hover_j, bill.radio_j)
        lost_j = entry.energy_j - (bill.left_j or 0.0)
        sent_after_j = 0.25 * (2 + len(recording.mission.roster))
        spent_j = sum(part_j or 0.0 for part_j in (bill.cruise_j, bill.hover_j, bill.radio_j))
        assert -1e-6 <= spent_j - lost_j <= sent_after_j + 1e-6
        assert (bill.cruise_j or 0.0) > 0
    assert sum(bill.slots_led or 0 for bill in energy_bills(recording)) == len({r.slot for r in recording.reports})


def test_an_empty_battery_is_an_event() -> None:
    """UAVs with an empty battery are listed with the slot."""
    recording, _ = simulate(Mission(uavs=3, energy=EnergyModel(initial_min_j=800.0, initial_max_j=900.0), max_slots=40))
    assert {found.uav for found in exhausted(recording)} == {"u001", "u002", "u003"}
    assert all(0 < found.slot < 40 for found in exhausted(recording))


def test_long_mission_rotates_the_head() -> None:
    """Election by energy gives many terms, several heads, and a higher radio bill for heads."""
    found = fly_long(LONG_MISSION)
    heads = found["metrics"]["heads"]
    assert found["metrics"]["completed"]
    assert len(heads) >= 5
    assert len({head["head"] for head in heads}) >= 4
    led = max(found["bills"], key=lambda bill: bill["slots_led"])
    least = min(found["bills"], key=lambda bill: bill["slots_led"])
    assert led["radio_j"] > 2 * least["radio_j"]
