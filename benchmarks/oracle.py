"""RotorPy's vehicle on this project's commands: does it keep to the bound that `hummingbird` declares?

    pip install 'edc-swarm[oracle]'               RotorPy, by S. Folk, J. Paulos and V. Kumar (arXiv 2306.04485)
    pip install torch torchdiffeq roma            optional: its vehicles in PyTorch, all flights at once
    python benchmarks/oracle.py --flights 1000

The vehicle is RotorPy's: a rigid body in space with four rotors that lag, drag of rotors and frame, and an attitude
controller. The controller of the horizontal motion is the one that `mission.control_loop` declares, 100 times a
second; a second one holds the height. What the inertial unit feels comes from RotorPy's own accelerations.

Commands come from simulated missions (`recorded`), from chance (`random`) and from a search (`worst`): a linear program
finds the steps for which this project's own model deviates most at a given time. The wind is RotorPy's Dryden model on
all three axes, cut off at the mission's `gust_mps`, and for `worst` the gusts that deviate most at that time.
`--controller se3` flies RotorPy's own law instead, which knows no drag.
"""

from __future__ import annotations

import argparse
import cmath
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from random import Random
from typing import Any

import numpy as np
from msgspec import to_builtins
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from rotorpy_fleet import GRAVITY_MPS2, HAS_TORCH, Batch, Fleet, One, turbulence
from scipy.optimize import linprog

from edc_swarm.emulation.multirotor import Multirotor
from edc_swarm.mission.braking import BRAKE_SLACK
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.control_loop import loop_step, worst_gusts
from edc_swarm.mission.declared_path import declared
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.vehicle_budget import Budget, budget_of, step_change_m, vehicle_of
from edc_swarm.mission.wind_model import WindModel
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Fix, Message, mission_message
from edc_swarm.simulation.simulator import Simulation

Floats = NDArray[np.float64]
Vectors = NDArray[np.complexfloating[Any, Any]]
Course = tuple[Vectors, Floats]
"""Steps of a flight (`SLOTS`) and its wind in each step of the controller (C, 3)."""
UAV = RosterEntry(uav="a", start_x_m=0.0, start_y_m=0.0, target_x_m=0.0, target_y_m=9.0, r_m=3.0, body_m=0.25)
HEIGHT_GAINS = (15.0, 9.0)
"""RotorPy's gains for the height, in 1/s² and 1/s."""
SLOTS = 16
SETTLING_S = 2.0
"""Time at rest in which vehicle and controller find their tilt in the mean wind, before the flight."""
INTENSITY = 6.0
"""Turbulence intensity that RotorPy is given for each m/s of `gust_mps`: its noise depends on the time step."""
DRAWN_WINDS = 40
"""Courses of the turbulence in each case; flights share them in directions of their own."""
CASES: dict[str, dict[str, Any]] = {
    "calm, exact GPS": {"gps_model": "none"},
    "4 m/s, gusts of 1.5, exact GPS": {"gps_model": "none", "wind": {"mean_mps": 4.0, "gust_mps": 1.5}},
    "4 m/s, gusts of 1.5, GPS to 1 m": {"gps_model": "white", "wind": {"mean_mps": 4.0, "gust_mps": 1.5}},
}


@dataclass(frozen=True)
class Flight:
    """One flight of `hummingbird`.

    Attributes
    ----------
    case, kind
        The row of the table that it belongs to.
    steps_m
        (`SLOTS`) steps, x + i y.
    wind_mps
        (C, 3) wind in each step of the controller.
    errors_m
        (`SLOTS` + 1) errors of the estimated position at the ends of slots.
    own_m
        Largest deviation of this project's model on the same steps and errors, in its own wind.
    """

    case: str
    kind: str
    steps_m: Vectors
    wind_mps: Floats
    errors_m: Vectors
    own_m: float


def deviations_m(flights: list[Flight], fleet: Fleet, *, cancels: bool = True) -> Floats:
    """Return the (N, C) distances of RotorPy's vehicles from their declared paths after each step of the controller.

    Without `cancels` the controller leaves out the force that the inertial unit feels: RotorPy's SE(3) law, whose gains
    are those of `hummingbird`.
    """
    mission = mission_of(flights[0].case)
    vehicle, dt_s = vehicle_of(mission, UAV), mission.dt_s
    steps_m, errors_m, winds_mps = (
        np.array([getattr(flight, name) for flight in flights]) for name in ("steps_m", "errors_m", "wind_mps")
    )
    step = loop_step(vehicle.lag_s, vehicle.drag_per_s, dt_s)
    h, kp, kv = step.step_s, vehicle.position_gain_per_s, vehicle.velocity_gain_per_s
    ends = np.concatenate([np.zeros((len(flights), 2)), np.cumsum(steps_m, axis=1)], axis=1)
    start_m = -errors_m[:, 0]  # Where the estimate is at the first waypoint.

    def flat_m() -> Vectors:
        x = fleet.position_m
        return start_m + x[:, 0] + 1j * x[:, 1]

    def control(ref: tuple[Any, Any, Any], error: Any, wind_mps: Floats) -> None:
        x, (v, felt) = fleet.position_m, fleet.sense(wind_mps)
        ref_x, ref_v, ref_a = ref
        flat_v = v[:, 0] + 1j * v[:, 1]
        command = ref_a + kv * (ref_v - flat_v + kp * (ref_x - flat_m() - error))
        up = -HEIGHT_GAINS[0] * x[:, 2] - HEIGHT_GAINS[1] * v[:, 2]
        if cancels:
            command = command - (felt[:, 0] + 1j * felt[:, 1])
            up = up - felt[:, 2]
        command *= np.minimum(1.0, vehicle.limit_mps2 / np.maximum(np.abs(command), 1e-9))
        fleet.fly(np.stack([command.real, command.imag, up + GRAVITY_MPS2[2]], axis=-1), wind_mps, h)

    for _ in range(round(SETTLING_S / h)):
        control((0.0, 0.0, 0.0), errors_m[:, 0], winds_mps[:, 0])
    found = []
    for slot in range(SLOTS):
        before, here, there = ends[:, slot], ends[:, slot + 1], ends[:, slot + 2]
        ref_x, ref_v, ref_a = (before + here) / 2, (here - before) / dt_s, (there - 2 * here + before) / dt_s**2
        print(f"slot {slot + 1} of {SLOTS}", file=sys.stderr, flush=True)
        for n in range(step.steps):
            share = n / step.steps
            error = (1 - share) * errors_m[:, slot] + share * errors_m[:, slot + 1]
            control((ref_x, ref_v, ref_a), error, winds_mps[:, slot * step.steps + n])
            ref_x, ref_v = ref_x + ref_v * h + 0.5 * ref_a * h * h, ref_v + ref_a * h
            found.append(np.abs(flat_m() - ref_x))
    return np.stack(found, axis=1)


def mission_of(case: str, seed: int = 0) -> Mission:
    """Return a mission whose GPS bound is 1 m, so the tracking bound does not depend on what else fits in the disc."""
    return mission_from_dict(
        {"vehicle": {"model": "hummingbird"}, "gps_m": 1.0, "r_m": 3.0, "seed": seed, **CASES[case]}
    )


def bound_m(mission: Mission) -> float:
    """Return the bound on the deviation; with exact GPS without the parts for errors of GPS."""
    budget: Budget = budget_of(mission, UAV)
    exact_m = budget.turn_m + budget.gust_m + budget.between_m
    return exact_m if mission.gps_model == "none" else budget.gps_m + budget.tracking_m


def random_steps(mission: Mission, rng: Random) -> Vectors:
    """Steps that change by at most a_max dt^2, often by all of it, and often turn or reverse."""
    change_m, step, heading, found = step_change_m(mission, UAV) or 0.0, 0j, 0.0, []
    for _ in range(SLOTS):
        heading += rng.choice([0.0, 0.0, math.pi, math.pi / 2, rng.uniform(0.0, math.tau)])
        step += cmath.rect(change_m * rng.choice([0.0, 1.0, 1.0, rng.random()]), heading)
        step *= min(1.0, mission.u_max_m / abs(step)) if step else 1.0
        found.append(step)
    return np.array(found)


@cache
def recorded_steps(wind: WindModel, seed: int) -> list[Vectors]:
    """Return the first `SLOTS` steps of the UAVs of a simulated mission in `wind`.

    Wind lowers the acceleration of plans, so steps that were planned for calm air are not allowed in it.
    """
    fields = {
        "uavs": 20,
        "area_m2": 8000.0,
        "seed": seed,
        "vehicle": {"model": "hummingbird"},
        "wind": to_builtins(wind),
    }
    message = mission_message(complete_mission(mission_from_dict(fields)))
    said: list[Message] = []
    planner = make_planner(message.planner, message)
    Simulation(message, lambda: planner, lambda _key, now, _ns: said.append(now)).run()
    flown: dict[str, list[complex]] = {}
    for fix in sorted((each for each in said if isinstance(each, Fix)), key=lambda fix: fix.slot):
        steps = flown.setdefault(fix.uav, [])
        if len(steps) == fix.slot:
            steps.append(complex(fix.waypoint_x_m - fix.from_x_m, fix.waypoint_y_m - fix.from_y_m))
    return [np.array(steps[:SLOTS]) for steps in flown.values() if len(steps) >= SLOTS]


class Search:
    """The steps and gusts for which this project's own model deviates most."""

    def __init__(self, mission: Mission) -> None:
        self._change_m, self._most_m = step_change_m(mission, UAV) or 0.0, mission.u_max_m
        calm = mission_from_dict({"vehicle": {"model": "hummingbird"}, "gps_model": "none", "gps_m": 1.0, "r_m": 3.0})
        *_, one = _own_flight(
            calm, np.full(SLOTS, 0.1 + 0j)
        )  # The response to an acceleration in the first slot alone.
        self.samples = len(one) // SLOTS
        self._response = one.real / 0.1
        self._found: dict[tuple[int, int], Vectors] = {}

    def steps(self, slots: int, sample: int) -> Vectors:
        """Return the steps that deviate most at a sample of the last of `slots` slots, then a stop."""
        if (slots, sample) not in self._found:
            last = (slots - 1) * self.samples + sample
            gain = np.array([self._response[last - slot * self.samples] for slot in range(slots)])
            sums = np.tril(np.ones((slots, slots)))
            rows, most = np.concatenate([sums, -sums]), np.full(2 * slots, self._most_m)
            changes = linprog(-gain, A_ub=rows, b_ub=most, bounds=(-self._change_m, self._change_m)).x
            assert changes is not None, "all steps at rest are a solution"
            self._found[slots, sample] = self._completed(np.cumsum(changes) + 0j)
        return self._found[slots, sample]

    def _completed(self, steps: Vectors) -> Vectors:
        """Return the steps with those that stop, `SLOTS` in all."""
        found = list(steps)
        while len(found) < SLOTS:
            size = abs(found[-1])
            found.append(found[-1] * max(0.0, size - self._change_m) / size if size else 0j)
        return np.array(found)

    def disturbed(self, steps: Vectors, rng: Random) -> Vectors:
        """Return the steps with some changes drawn anew."""
        step, found = 0j, []
        for change in np.diff(steps, prepend=0j):
            turned = cmath.rect(self._change_m, rng.uniform(0.0, math.tau)) if rng.random() < 0.15 else change
            step += turned
            step *= min(1.0, self._most_m / abs(step)) if step else 1.0
            found.append(step)
        return np.array(found)


def _own_flight(mission: Mission, steps_m: Vectors) -> tuple[Vectors, Vectors]:
    """Return the errors of the estimate at the ends of slots, and the deviation at each sample."""
    body, before, here = Multirotor(mission, UAV, (0.0, 0.0), None), 0j, 0j
    errors, off_m = [complex(*body.state.error_m)], []
    for slot, step in enumerate(steps_m):
        there = here + complex(step)
        done = body.fly(slot, (here.real, here.imag), (there.real, there.imag))
        path = [*(done.between_m or []), done.to_m]
        off_m += [complex(*x) - declared(before, here, there, n / len(path)) for n, x in enumerate(path, 1)]
        errors.append(complex(*body.state.error_m))
        before, here = here, there
    return np.array(errors), np.array(off_m)


class Winds:
    """The winds of one mission, in each step of the controller."""

    def __init__(self, mission: Mission, rng: Random) -> None:
        vehicle = vehicle_of(mission, UAV)
        self._signs = worst_gusts(vehicle, mission.dt_s)
        self._per_slot = loop_step(vehicle.lag_s, vehicle.drag_per_s, mission.dt_s).steps
        self._count = SLOTS * self._per_slot
        self._wind, self._rng = mission.wind, rng
        self._step_s = mission.dt_s / self._per_slot

    @cached_property
    def _drawn(self) -> list[Floats]:
        return [self._dryden() for _ in range(DRAWN_WINDS if self._wind.gust_mps else 1)]

    def turbulence(self) -> Floats:
        """Return the mean wind with RotorPy's turbulence, turned to a direction at random."""
        gusts = self._rng.choice(self._drawn)
        flat = (gusts[:, 0] + 1j * gusts[:, 1]) * cmath.rect(1.0, self._rng.uniform(0.0, math.tau))
        return self._blown(flat, gusts[:, 2])

    def worst(self, last_slots: float, direction: complex) -> Floats:
        """Return the mean wind with the gusts that deviate most after so many slots."""
        gusts, end = np.zeros(self._count), round(last_slots * self._per_slot)
        used = min(end, len(self._signs))
        gusts[end - used : end] = self._signs[-used:]
        return self._blown(self._wind.gust_mps * direction * gusts, np.zeros(self._count))

    def _blown(self, flat: Vectors, up: Floats) -> Floats:
        return np.stack([flat.real + self._wind.mean_mps, flat.imag, up], axis=-1)

    def _dryden(self) -> Floats:
        intensity_mps = INTENSITY * self._wind.gust_mps
        gusts = turbulence(intensity_mps, self._count, self._step_s, self._rng.randrange(2**32))
        for axes in (slice(0, 2), slice(2, 3)):
            size = np.linalg.norm(gusts[:, axes], axis=1, keepdims=True)
            gusts[:, axes] *= np.minimum(1.0, self._wind.gust_mps / np.maximum(size, 1e-9))
        return gusts


def flights_of(count: int) -> list[Flight]:
    """Return so many flights, and up to eight more, in equal shares of all cases and kinds."""
    found = list[Flight]()
    each = range(math.ceil(count / len(CASES) / len(KINDS)))
    for case in CASES:
        mission = mission_of(case)
        for kind, make in KINDS.items():
            courses = make(mission, Random(f"{kind}/{case}"))
            found += [flight_of(case, kind, seed, course) for seed, course in zip(each, courses, strict=False)]
    return found


def flight_of(case: str, kind: str, seed: int, course: Course) -> Flight:
    """Return the flight of a course of steps and winds; the errors of its GPS depend on the seed.

    Its steps must be ones that a mission in this wind may command.
    """
    mission, steps_m = mission_of(case, seed), course[0]
    change_m = step_change_m(mission, UAV)
    assert change_m is not None
    assert np.abs(np.diff(steps_m, prepend=0j)).max() <= change_m * (1 + BRAKE_SLACK) + BRAKE_SLACK
    assert np.abs(steps_m).max() <= mission.u_max_m + BRAKE_SLACK
    errors_m, off_m = _own_flight(mission, steps_m)
    return Flight(case, kind, *course, errors_m, float(np.abs(off_m).max()))


def _random(mission: Mission, rng: Random) -> Iterator[Course]:
    winds = Winds(mission, rng)
    while True:
        yield random_steps(mission, rng), winds.turbulence()


def _recorded(mission: Mission, rng: Random) -> Iterator[Course]:
    winds = Winds(mission, rng)
    for seed in range(1000):
        for steps_m in recorded_steps(mission.wind, seed):
            yield steps_m, winds.turbulence()


def _worst(mission: Mission, rng: Random) -> Iterator[Course]:
    """First the worst flights for each length, then the same with some changes drawn anew."""
    search, winds = Search(mission), Winds(mission, rng)
    for turn in range(1000):
        for slots in range(SLOTS, 2, -1):
            for sample in range(search.samples):
                direction = cmath.rect(1.0, rng.uniform(0.0, math.tau))
                steps_m = direction * search.steps(slots, sample)
                steps_m = search.disturbed(steps_m, rng) if turn else steps_m
                yield steps_m, winds.worst(slots - 1 + (sample + 1) / search.samples, direction)


KINDS: dict[str, Callable[[Mission, Random], Iterator[Course]]] = {
    "recorded": _recorded,
    "random": _random,
    "worst": _worst,
}


def main() -> int:
    """Fly, and print the largest deviation of each kind beside its bound."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=1000, help="in all, a third each recorded, random and worst")
    parser.add_argument("--controller", choices=["declared", "se3"], default="declared")
    given = parser.parse_args()
    table = Table(title=f"RotorPy's hummingbird, {SLOTS} slots of 0.5 s, controller: {given.controller}")
    for column in ("wind, GPS", "commands", "flights", "own model", "RotorPy", "bound", "outside"):
        table.add_column(column)
    flights = flights_of(given.flights)
    fleet = Batch(len(flights)) if HAS_TORCH else One(len(flights))
    most_m = deviations_m(flights, fleet, cancels=given.controller == "declared").max(axis=1)
    outside = 0
    for case in CASES:
        limit_m = bound_m(mission_of(case))
        for kind in KINDS:
            chosen = [n for n, flight in enumerate(flights) if (flight.case, flight.kind) == (case, kind)]
            beyond = sum(most_m[n] > limit_m for n in chosen)
            outside += beyond
            own_m, their_m = max(flights[n].own_m for n in chosen), max(most_m[chosen])
            row = (f"{own_m:.3f} m", f"{their_m:.3f} m", f"{limit_m:.3f} m", str(beyond))
            table.add_row(case, kind, str(len(chosen)), *row)
    Console().print(table)
    return 1 if outside else 0


if __name__ == "__main__":
    sys.exit(main())
