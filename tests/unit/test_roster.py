"""Random missions, and missions completed with all that their file leaves out."""

import math
import re
from itertools import combinations

import numpy as np
import pytest

from edc_swarm.errors import MissionError, PlacementError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.mission.power_models import EnergyModel
from edc_swarm.mission.roster import complete_mission, random_roster
from tests.builders import row


def test_positions_follow_the_promised_recipe() -> None:
    """Starts, then targets, by rejection sampling of `default_rng(seed).uniform(0, side, 2)`."""
    rng = np.random.default_rng(7)
    drawn: list[list[np.ndarray]] = []
    for _ in range(2):
        taken: list[np.ndarray] = []
        while len(taken) < 10:
            point = rng.uniform(0, 100, 2)
            if all(math.dist(point, other) >= 10.5 for other in taken):
                taken.append(point)
        drawn.append(taken)
    roster = random_roster(Mission(seed=7))
    assert [(e.start_x_m, e.start_y_m) for e in roster] == [tuple(p) for p in drawn[0]]
    assert [(e.target_x_m, e.target_y_m) for e in roster] == [tuple(p) for p in drawn[1]]


def test_random_uavs_keep_their_distance_and_their_range_of_charge() -> None:
    """Every pair is 1.05 R apart, inside the square, charged within the model's range."""
    roster = random_roster(Mission(uavs=50, seed=3))
    assert [e.uav for e in roster][:2] == ["u001", "u002"]
    for a, b in combinations(roster, 2):
        assert math.hypot(a.start_x_m - b.start_x_m, a.start_y_m - b.start_y_m) >= 10.5
        assert math.hypot(a.target_x_m - b.target_x_m, a.target_y_m - b.target_y_m) >= 10.5
    assert all(0 <= e.start_x_m <= 100 and 0 <= e.target_y_m <= 100 for e in roster)
    assert all(50_000 <= e.energy_j <= 100_000 for e in roster)


def test_charge_does_not_move_anyone() -> None:
    """Batteries have a generator of their own."""
    plain = random_roster(Mission())
    rich = random_roster(Mission(energy=EnergyModel(initial_min_j=1.0, initial_max_j=2.0)))
    assert [e.start_x_m for e in plain] == [e.start_x_m for e in rich]
    assert all(1 <= e.energy_j <= 2 for e in rich)


def test_an_unplaceable_density_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the field, the value and what would fit."""
    monkeypatch.setattr("edc_swarm.mission.roster.TRIES", 200)
    with pytest.raises(PlacementError, match=r"uavs = 200: must be few enough for area_m2 = 10000 and r_m = 5"):
        complete_mission(Mission(uavs=200))


@pytest.mark.parametrize("uavs", [100, 1000])
def test_the_area_that_the_error_names_has_room(uavs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who asks for more UAVs than fit need not search for the area."""
    with monkeypatch.context() as patch:
        patch.setattr("edc_swarm.mission.roster.TRIES", 50)
        with pytest.raises(PlacementError) as error:
            complete_mission(Mission(uavs=uavs))
    found = re.search(r"; area_m2 = (\d+) has room", str(error.value))
    assert found
    assert all(len(random_roster(Mission(uavs=uavs, area_m2=float(found[1]), seed=seed))) == uavs for seed in range(3))


def test_a_completed_mission_leaves_nothing_open() -> None:
    """Roster, wait and end are filled in, and completing again changes nothing."""
    mission = complete_mission(Mission(uavs=4))
    assert len(mission.roster) == 4
    assert mission.tau_s == pytest.approx(0.2)
    longest_m = max(e.straight_m for e in mission.roster)
    assert mission.max_slots == math.ceil(20 * longest_m / 2.5) + 200
    assert complete_mission(mission) == mission


def test_a_given_roster_is_kept() -> None:
    """Only what is missing is drawn."""
    roster = row("ab", gap_m=5.0, north_m=10.0, r_m=1.0, body_m=0.1, energy_j=1e4)
    mission = complete_mission(Mission(roster=roster, uavs=2, max_slots=9, tau_s=0.1))
    assert (mission.roster, mission.max_slots, mission.tau_s) == (roster, 9, 0.1)


def test_links_must_name_uavs_of_the_roster() -> None:
    """A link to nobody is refused with its place."""
    links = [Link(sender="*", receiver="u002"), Link(sender="u001", receiver="u009")]
    with pytest.raises(MissionError, match=r"link\[1\].receiver = 'u009'"):
        complete_mission(Mission(uavs=2, link=links))
