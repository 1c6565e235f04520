"""Keys distinguish the runs of a sweep, and commands repeat them."""

from __future__ import annotations

from pathlib import Path

import pytest

from edc_swarm.errors import InputError
from edc_swarm.experiments.figures.catalogue import LONG_FILE, LONG_MISSION, NAMES, chosen, runs_of
from edc_swarm.experiments.sweeps import Run, command_of, mission_toml
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.mission.power_models import EnergyModel
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import load_mission


def test_key_depends_on_measure_and_mission() -> None:
    """The same mission with the same measure has one key; anything else has another."""
    run = Run("m:f", Mission(seed=1))
    assert run.key == Run("m:f", Mission(seed=1)).key
    assert len({run.key, Run("m:g", Mission(seed=1)).key, Run("m:f", Mission(seed=2)).key}) == 3


def test_command_says_every_field() -> None:
    """The options of `sim` give every field that is not at its default."""
    mission = Mission(
        uavs=50, area_m2=40_000.0, r_m=2.5, seed=7, planner="paper", link=[Link(loss=0.1)], fault=["kill head @10"]
    )
    assert command_of(mission) == (
        "edc-swarm sim --seed 7 --uavs 50 --area 40000 --gps-error 2.5 --planner paper --loss 0.1"
        " --fault 'kill head @10'"
    )


def test_command_says_numbers_to_the_last_digit() -> None:
    """A number is short if that is exact, and otherwise has all its digits."""
    assert command_of(Mission(r_m=1 / 3, area_m2=40_000.0)).endswith("--area 40000 --gps-error 0.3333333333333333")


@pytest.mark.parametrize(
    "mission",
    [
        Mission(lease_slots=3),
        Mission(link=[Link(loss=0.1, sender="u001")]),
        Mission(link=[Link(loss=0.1), Link(loss=0.2)]),
    ],
)
def test_what_no_option_says_is_refused(mission: Mission) -> None:
    """A command of another mission is never printed."""
    with pytest.raises(InputError):
        command_of(mission)


def test_a_mission_file_says_every_field(tmp_path: Path) -> None:
    """A file gives the fields without an option, and reads as the same mission."""
    mission = complete_mission(
        Mission(
            name="odd",
            dt_s=0.25,
            lease_slots=3,
            link=[Link(sender="u001", distribution="normal"), Link(range_m=1e-7, loss=0.1)],
            fault=["kill head @10", "heal @12"],
            energy=EnergyModel(rotor_solidity=0.1),
        )
    )
    (tmp_path / "odd.toml").write_text(mission_toml(mission), encoding="utf-8")
    assert load_mission(tmp_path / "odd.toml") == mission
    assert Run("m:f", mission, file="a b.toml", verb="run").command == "edc-swarm run 'a b.toml'"


def test_figures_share_runs() -> None:
    """Each run is declared once, and Fig. 5 adds no run to those of Fig. 4."""
    runs = runs_of(NAMES, 3)
    assert len({run.key for run in runs}) == len(runs)
    assert {r.key for r in runs_of(["4a", "4b", "5a", "5b"], 3)} == {r.key for r in runs_of(["4a", "4b"], 3)}


def test_every_run_can_be_flown_again() -> None:
    """Every run of every figure has a command."""
    assert all(run.command.startswith("edc-swarm sim") for run in runs_of(NAMES, 30))


def test_long_mission_is_the_scenario() -> None:
    """The mission in the catalogue equals the shipped file."""
    assert load_mission(LONG_FILE) == LONG_MISSION


def test_unknown_figure_is_refused() -> None:
    """The error lists the figures."""
    with pytest.raises(InputError, match="4a, 4b"):
        chosen(["7a"])
