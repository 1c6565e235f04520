"""The body with inertia: it stays within its declared bound, whatever moves it, and the bound is tight."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import pytest

from edc_swarm.emulation import multirotor, slot_flight
from edc_swarm.emulation.body import BodyState, Flown
from edc_swarm.emulation.energy import flight_power_w, propulsion_power_w
from edc_swarm.emulation.multirotor import Multirotor
from edc_swarm.emulation.slot_flight import flight
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.control_loop import loop_bounds, loop_step, worst_turns
from edc_swarm.mission.declared_path import declared
from edc_swarm.mission.faults import ChangeGps, Gust, WeakMotor
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.stated import with_stated
from edc_swarm.mission.validation import load_mission, mission_from_dict
from edc_swarm.mission.vehicle_budget import budget_of, step_change_m, vehicle_of
from edc_swarm.mission.vehicle_model import FIGURES, SETS
from processes.cli.main import main
from tests.builders import entry

NAMES = [name for name in SETS if name != "multirotor"]
SLOTS = 60
UAV = entry("a", (0.0, 0.0), r_m=3.0, body_m=0.25)
STANDING = [0j] * SLOTS


def mission(name: str = "arducopter", **fields: Any) -> Mission:
    """A mission of one vehicle, whose disc has room for 1 m of GPS error."""
    vehicle = {"model": name, **fields.pop("vehicle", {})}
    return mission_from_dict({"vehicle": vehicle, "r_m": 3.0, "gps_m": 1.0, **fields})


def body(mission: Mission, state: BodyState | None = None, uav: RosterEntry = UAV) -> Multirotor:
    """The body of the mission's vehicle, at the origin."""
    return Multirotor(mission, uav, (0.0, 0.0), state)


def random_steps(mission: Mission, rng: Random) -> list[complex]:
    """Steps as a plan has them: each changes by at most a_max dt^2, often by all of it, and often turns or reverses."""
    change_m, step, heading, found = step_change_m(mission, UAV), 0j, 0.0, []
    assert change_m is not None
    for _ in range(SLOTS):
        heading += rng.choice([0.0, 0.0, math.pi, math.pi / 2, rng.uniform(0.0, math.tau)])
        step += cmath.rect(change_m * rng.choice([0.0, 1.0, 1.0, rng.random()]), heading)
        step *= min(1.0, mission.u_max_m / abs(step)) if step else 1.0
        found.append(step)
    return found


def flown(flying: Multirotor, steps: list[complex], first: int = 0) -> Iterator[tuple[Flown, float]]:
    """Fly, and yield each slot with the largest distance of its true path from the declared one."""
    before = here = complex(*flying.state.at_m)
    for slot, step in enumerate(steps, first):
        there = here + step
        done = flying.fly(slot, (here.real, here.imag), (there.real, there.imag))
        path = [done.from_m, *(done.between_m or []), done.to_m]
        shares = [i / (len(path) - 1) for i in range(len(path))]
        yield done, max(abs(complex(*x) - declared(before, here, there, s)) for x, s in zip(path, shares, strict=True))
        before, here = here, there


def largest_m(flying: Multirotor, steps: list[complex], first: int = 0) -> float:
    """The largest deviation of a flight."""
    return max(off_m for _, off_m in flown(flying, steps, first))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("gps_model", ["none", "bias", "white", "gauss-markov"])
def test_it_stays_within_its_budget(name: str, gps_model: str) -> None:
    """In wind, turbulence and a gust, on steps that turn and reverse, with each GPS model."""
    for seed in range(4):
        wind = {"mean_mps": 4.0, "gust_mps": 3.0}
        flying_mission = mission(name, gps_model=gps_model, seed=seed, wind=wind, fault=["gust a 4mps @20 for 10"])
        flying = body(flying_mission)
        flying.disturb(Gust("a", 4.0, at_s=10.0, for_s=5.0))
        budget = budget_of(flying_mission, UAV)
        slots = list(flown(flying, random_steps(flying_mission, Random(seed))))
        assert max(off_m for _, off_m in slots) <= budget.gps_m + budget.tracking_m
        assert not any(done.saturated for done, _ in slots)


@pytest.mark.parametrize("name", NAMES)
def test_the_worst_turns_reach_the_bound(name: str) -> None:
    """No bound is worth much that nothing reaches: a sequence of turns comes to within 2 % of it, none beyond."""
    calm = mission(name, gps_model="none", v_max_mps=10.0, vehicle={"drag_per_s": 0.01})
    change_m, budget = step_change_m(calm, UAV), budget_of(calm, UAV)
    assert change_m is not None
    step, steps = 0j, []
    for sign in worst_turns(vehicle_of(calm, UAV), calm.dt_s)[-12:]:
        step += sign * change_m
        steps.append(step)
    off_m = largest_m(body(calm), steps)
    assert 0.98 * budget.turn_m <= off_m <= budget.turn_m + budget.between_m
    assert max(map(abs, steps)) <= calm.u_max_m


def test_it_steers_by_the_measured_position() -> None:
    """With a GPS error that never changes it rests where GPS says that it should, off by just that error."""
    flying = body(mission(gps_model="bias", seed=5))
    *_, (done, off_m) = flown(flying, [0.5 + 0j, 1.0 + 0j, 0.5 + 0j, *STANDING])
    assert off_m == pytest.approx(math.hypot(*flying.state.error_m), abs=1e-6)
    assert off_m > 0.1
    assert done.measured_m == pytest.approx((2.0, 0.0), abs=1e-6)


def square_wave_off_m(flying_mission: Mission) -> float:
    """The largest deviation while the GPS error changes from one end of its disc to the other, every four seconds."""
    flying, g = body(flying_mission), budget_of(flying_mission, UAV).gps_m
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flying._gps, "next_error_m", lambda slot: ((-g, g)[slot // 8 % 2], 0.0))
        return largest_m(flying, STANDING)


def test_a_gps_error_that_changes_is_in_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    """The worst change stays inside its part; an estimate that jumps to each fix is what no budget has room for."""
    jumping = mission(gps_m=4.0, r_m=5.0)
    budget = budget_of(jumping, UAV)
    assert 3.0 < square_wave_off_m(jumping) <= budget.gps_m + budget.correction_m + budget.between_m
    reckless = vehicle_of(mission(vehicle={"correction_mps": 100.0}), UAV)
    monkeypatch.setattr(multirotor, "FILTER_SHARE", 1.0)
    monkeypatch.setattr(multirotor, "vehicle_of", lambda *_: reckless)
    assert square_wave_off_m(jumping) > budget.gps_m + budget.correction_m + budget.between_m


def test_every_gps_model_flies_another_path() -> None:
    """The same mission under `none`, `bias`, `white` and `gauss-markov` has four different true paths."""
    steps = random_steps(mission(), Random(1))
    ends = set()
    for model in ("none", "bias", "white", "gauss-markov"):
        *_, (done, _) = flown(body(mission(gps_model=model, seed=1)), steps)
        ends.add(done.to_m)
    assert len(ends) == 4


def test_without_gps_the_disc_grows_and_then_shrinks_again() -> None:
    """The error of the estimate stays inside bound plus growth, and needs the growth."""
    beyond_m = 0.0
    for seed in range(8):
        blind = mission(gps_model="bias", seed=seed, gps_m=0.2, fault=["gps a outage @4 for 20"])
        flying = body(blind)
        budget, grown_m = budget_of(blind, UAV), []
        for slot, (done, off_m) in enumerate(flown(flying, STANDING)):
            if slot == 3:
                flying.disturb(ChangeGps("a", "outage", at_s=2.0, for_s=10.0))
            grown_m.append(done.grown_m)
            assert off_m <= budget.gps_m + budget.tracking_m + done.grown_m
            assert math.hypot(*flying.state.error_m) <= 0.2 + done.grown_m + 1e-12
            beyond_m = max(beyond_m, math.hypot(*flying.state.error_m) - 0.2)
        assert grown_m[3] == 0.0
        assert max(grown_m) == grown_m[23] == pytest.approx(10.0 * 0.2)
        assert grown_m[-1] < 0.1 * grown_m[23]
    assert beyond_m > 1.5


def test_a_weak_motor_saturates_and_strays() -> None:
    """With a tenth of its acceleration the vehicle cannot follow, and says so."""
    calm = mission(gps_model="none")
    flying = body(calm)
    flying.disturb(WeakMotor("a", (("share", 0.1),)))
    slots = list(flown(flying, [0.6 * k + 0j for k in (1, 2, 3, 4)]))
    assert any(done.saturated for done, _ in slots)
    assert max(off_m for _, off_m in slots) > budget_of(calm, UAV).tracking_m


def test_it_goes_on_after_a_restart_bit_for_bit() -> None:
    """The state on disk is all that a body needs, turbulence included; slots that were missed were held."""
    windy = mission(gps_model="bias", wind={"mean_mps": 3.0, "gust_mps": 2.0})
    steps = [0.5 + 0j, 0.8 + 0.2j, 0.8j, 0j]
    whole, first = body(windy), body(windy)
    ends = [done.to_m for done, _ in flown(whole, [*steps, 0j, 0j, 0.3 + 0j])]
    list(flown(first, steps))
    again = body(windy, first.state)
    here = complex(*first.state.at_m)
    assert again.fly(6, (here.real, here.imag), (here.real + 0.3, here.imag)).to_m == ends[-1]


def test_energy_goes_by_air_speed_and_acceleration() -> None:
    """Hovering, hovering in a wind of 15 m/s, and turning hard."""
    still = [done.propulsion_j for done, _ in flown(body(mission(gps_model="none")), STANDING)][-1]
    head_wind = mission(gps_model="none", wind={"mean_mps": 15.0})
    windy = [done.propulsion_j for done, _ in flown(body(head_wind), STANDING)][-1]
    turns = [0.3 + 0j, -0.3 + 0j] * 20
    turning = [done.propulsion_j for done, _ in flown(body(mission(gps_model="none")), turns)][-1]
    assert still == pytest.approx(0.5 * (79.86 + 88.63))
    assert windy == pytest.approx(0.5 * flight_power_w(15.0, 15.0 * 0.1, head_wind.energy))
    assert flight_power_w(3.0, 4.0, head_wind.energy) > flight_power_w(3.0, 0.0, head_wind.energy)
    assert flight_power_w(3.0, 0.0, head_wind.energy) == pytest.approx(propulsion_power_w(3.0, head_wind.energy))
    assert turning > still


def test_one_step_is_exact() -> None:
    """Two half steps with the same command are one whole step, and a long one reaches the steady speed."""
    half, whole = loop_step(0.15, 0.1, 0.005), loop_step(0.15, 0.1, 0.01)
    x, v, a = 1.0, 2.0, 3.0
    once = (
        x + whole.xv * v + whole.xa * a + whole.xc * 0.7 + whole.xw * 4.0,
        whole.vv * v + whole.va * a + whole.vc * 0.7 + whole.vw * 4.0,
        whole.aa * a + (1 - whole.aa) * 0.7,
    )
    for _ in range(2):
        x, v, a = (
            x + half.xv * v + half.xa * a + half.xc * 0.7 + half.xw * 4.0,
            half.vv * v + half.va * a + half.vc * 0.7 + half.vw * 4.0,
            half.aa * a + (1 - half.aa) * 0.7,
        )
    assert (x, v, a) == pytest.approx(once, rel=1e-14)


@pytest.mark.parametrize("dt_s", [0.02, 0.2, 0.25, 0.5, 1.0, 2.0])
def test_steps_and_samples_fill_a_slot(dt_s: float) -> None:
    """The controller works at 100 Hz or faster, and samples are at most 0.1 s apart."""
    step = loop_step(0.15, 0.1, dt_s)
    assert step.step_s <= 0.01 + 1e-12
    assert step.steps % step.samples == 0
    assert step.samples >= dt_s / 0.1 - 1e-9
    assert step.steps * step.step_s == pytest.approx(dt_s)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"r_m": 2.0, "gps_m": 2.0}, "gps 2.00 + tracking 0.53 + body 0.25 > r 2: lower gps_m"),
        ({"r_m": 0.4}, "gps 0.00 + tracking 0.30 + body 0.25 > r 0.4"),
        (
            {"vehicle": {"model": "multirotor", "a_max_mps2": 0.01}},
            "vehicle.a_max_mps2 = 0.01: must be at least 0.05, or left out",
        ),
        ({"vehicle": {"model": "multirotor", "lag_s": 0.6}}, "vehicle.lag_s = 0.6: must be at most a slot"),
        ({"vehicle": {"model": "multirotor", "position_gain_per_s": 40}}, "must be gains that settle within 60 s"),
        ({"wind": {"mean_mps": 40.0}}, "wind.mean_mps, gust_mps = (40.0, 0.0): must be less than multirotor can hold"),
        ({"guard_s": 0.01}, "guard_s = 0.01: must be 0 with multirotor"),
        ({"vehicle": {"model": "multirotor", "drift_mps": 1.0}}, "vehicle.drift_mps = 1.0: must be at most"),
    ],
)
def test_vehicles_that_cannot_fly_are_refused_in_one_line(fields: dict[str, Any], said: str) -> None:
    """With the arithmetic."""
    with pytest.raises(MissionError) as caught:
        complete_mission(mission_from_dict({"vehicle": {"model": "multirotor"}, **fields}))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_stated_tracking_bound_replaces_the_computed_one() -> None:
    """The budget then has the user's figure."""
    stated = mission(vehicle={"tracking_m": 1.5})
    assert budget_of(stated, UAV).tracking_m == 1.5
    assert str(budget_of(stated, UAV)) == "gps 1.00 + tracking 1.50 + body 0.25 <= r 3"


def test_wind_lowers_the_acceleration_of_plans() -> None:
    """What the wind takes of the tilt, no plan may use; the mission is still valid."""
    calm, windy = mission(), mission(wind={"mean_mps": 12.0, "gust_mps": 4.0})
    assert budget_of(calm, UAV).a_max_mps2 == 2.5
    assert 0.5 < budget_of(windy, UAV).a_max_mps2 < 2.3
    assert complete_mission(windy).lag_slots == 1


def test_an_entry_has_a_vehicle_of_its_own() -> None:
    """Its figures are those of its set; the mission's table is for the others."""
    mixed = mission("ideal")
    assert vehicle_of(mixed, UAV).is_ideal
    assert vehicle_of(mixed, entry("b", vehicle="hummingbird")) == SETS["hummingbird"]
    assert loop_bounds(SETS["hummingbird"], 0.5) is not None


@pytest.mark.parametrize("name", FIGURES)
def test_a_file_that_states_a_vehicle_without_a_figure_is_refused(name: str, tmp_path: Path) -> None:
    """Zero would stand for the figure of the set, so the user would fly another vehicle than the file states."""
    file = tmp_path / "mission.toml"
    for model in ('model = "multirotor"\n', ""):
        file.write_text(f"[vehicle]\n{model}{name} = 0\n", encoding="utf-8")
        with pytest.raises(MissionError, match=rf"^vehicle.{name} = 0: must be above 0, or left out"):
            load_mission(file)
    file.write_text(f'[vehicle]\nmodel = "ideal"\n{name} = 0\n', encoding="utf-8")
    assert load_mission(file) == Mission()
    with pytest.raises(MissionError, match=rf"^vehicle.{name} = 0: must be above 0"):
        with_stated(Mission(), {"vehicle": {"model": "multirotor", name: 0}})


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["[vehicle]", 'model = "multirotor"', "a_max_mps2 = 0"], "vehicle.a_max_mps2 = 0: must be above 0"),
        (["[vehicle]", 'model = "multirotor"', "lag_s = 0.6"], "vehicle.lag_s = 0.6: must be at most a slot"),
        (["--vehicle", "multirotor", "--slot", "0.1"], "vehicle.lag_s = 0.15: must be at most a slot"),
        (["--vehicle", "multirotor", "--wind-mps", "40"], "must be less than multirotor can hold"),
        (["[vehicle]", 'model = "multirotor"', "[wind]", "mean_mps = 40"], "must be less than multirotor can hold"),
        (["--vehicle", "multirotor", "--gps-error", "0.5"], "gps 0.00 + tracking 0.30 + body 0.25 > r 0.5"),
        (["gps_m = 4.9", "[vehicle]", 'model = "multirotor"'], "gps 4.90 + tracking 0.64 + body 0.25 > r 5"),
    ],
)
def test_the_command_line_says_why_in_one_line(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An impossible vehicle, wind that it cannot hold, and a budget that does not fit; by options and by file."""
    file = tmp_path / "mission.toml"
    if not options[0].startswith("--"):
        file.write_text("\n".join(options), encoding="utf-8")
        options = [str(file)]
    assert main(["sim", *options, "--out", str(tmp_path / "a.mcap")]) == 2
    *_, error = capsys.readouterr().err.strip().splitlines()
    assert error.startswith("error: ")
    assert said in error


def test_responses_add_up_to_the_flight_step_by_step() -> None:
    """A slot is flown by responses, with a limit that it could reach step by step: the flight is the same.

    A limit that it does reach saturates it.
    """
    rng, vehicle = Random(3), SETS["hummingbird"]
    cut = 0
    for _ in range(50):
        y, dv, a, rv, ra, shift, wind, dwind = (cmath.rect(rng.random(), rng.uniform(0.0, math.tau)) for _ in range(8))
        given = (0.2 * y, 4.0 * rv + 0.3 * dv, 2.0 * a, 4.0 * rv, 2.0 * ra, 0.3 * shift, 3.0 * wind, 0.01 * dwind)
        summed, summed_cut = flight(vehicle, 0.5, given, 100.0)
        _, sizes = slot_flight._stepped(vehicle, loop_step(vehicle.lag_s, vehicle.drag_per_s, 0.5), given, math.inf)
        stepped, stepped_cut = flight(vehicle, 0.5, given, max(sizes))
        assert (summed_cut, stepped_cut) == (False, False)
        for one, other in zip(summed, stepped, strict=True):
            assert one == pytest.approx(other, abs=1e-12)
        cut_samples, was_cut = flight(vehicle, 0.5, given, 0.9 * max(sizes))
        cut += was_cut and cut_samples != summed
    assert cut == 50
