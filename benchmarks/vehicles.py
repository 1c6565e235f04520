"""The cost of flying with inertia: tables and figures of docs/vehicles.md.

    python benchmarks/vehicles.py straight          a straight flight, a turn and a stop: deviation, with a plot
    python benchmarks/vehicles.py price             largest speed and GPS error for discs of 2, 3 and 5 m
    python benchmarks/vehicles.py figure            one UAV that turns, brakes and is hit by a gust: a plot

Plots go to docs/figures/ (or --folder). `benchmarks/vehicle_missions.py` has the figures of whole missions.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from edc_swarm.emulation.body import Flown
from edc_swarm.emulation.multirotor import Multirotor
from edc_swarm.errors import MissionError
from edc_swarm.mission.braking import braked, braking_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declared_path import declared
from edc_swarm.mission.faults import Gust
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.vehicle_budget import budget_of, check_vehicles, step_change_m
from edc_swarm.mission.vehicle_speed import greatest_speed_mps

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Circle

UAV = RosterEntry(uav="a", start_x_m=0.0, start_y_m=0.0, target_x_m=0.0, target_y_m=9.0, r_m=2.0, body_m=0.25)
WINDS = ({"mean_mps": 0.0, "gust_mps": 0.0}, {"mean_mps": 4.0, "gust_mps": 2.0}, {"mean_mps": 8.0, "gust_mps": 4.0})


def flown(mission: Mission, steps: list[complex], gust: Gust | None = None) -> Iterator[tuple[complex, complex, Flown]]:
    """Fly steps with the mission's vehicle; yield (declared, true) positions ten times a second, and the slot."""
    body, before, here = Multirotor(mission, UAV, (0.0, 0.0), None), 0j, 0j
    if gust is not None:
        body.disturb(gust)
    for slot, step in enumerate(steps):
        there = here + step
        done = body.fly(slot, (here.real, here.imag), (there.real, there.imag))
        path = [*(done.between_m or []), done.to_m]
        for number, place in enumerate(path, 1):
            yield declared(before, here, there, number / len(path)), complex(*place), done
        before, here = here, there


def ramp(mission: Mission, course: list[tuple[complex, int]]) -> list[complex]:
    """Return the steps that approach each wished step of `course` as fast as the vehicle allows, for so many slots."""
    change_m = step_change_m(mission, UAV) or 0.0
    step, steps = 0j, []
    for wish, slots in course:
        for _ in range(slots):
            apart = wish - step
            step += apart * min(1.0, change_m / abs(apart)) if apart else 0j
            steps.append(step)
    return steps


def straight(folder: Path) -> None:
    """A straight flight, a turn by 90 degrees and a stop, with ArduCopter's figures."""
    mission = mission_from_dict({"vehicle": {"model": "arducopter"}, "gps_model": "none", "r_m": 2.0})
    full, budget = mission.u_max_m, budget_of(mission, UAV)
    bound_m = budget.turn_m + budget.between_m
    courses = {
        "straight": [(full + 0j, 16)],
        "turn": [(full + 0j, 12), (full * 1j, 14)],
        "reversal": [(full + 0j, 12), (-full + 0j, 14)],
        "stop": [(full + 0j, 12), (0j, 14)],
    }
    table = Table(title=f"arducopter, 5 m/s, slots of 0.5 s: deviation from the declared path (bound {bound_m:.2f} m)")
    for column in ("flight", "largest", "mean", "at the end"):
        table.add_column(column)
    figure, axes = plt.subplots(figsize=(7, 3.2))
    for name, course in courses.items():
        off_m = [abs(wanted - true) for wanted, true, _ in flown(mission, ramp(mission, course))]
        table.add_row(name, f"{max(off_m):.3f} m", f"{np.mean(off_m):.3f} m", f"{off_m[-1]:.3f} m")
        axes.plot(0.1 * np.arange(1, len(off_m) + 1), off_m, label=name)
    axes.axhline(bound_m, color="black", linestyle=":", label="bound (no GPS error)")
    axes.set(xlabel="time [s]", ylabel="deviation [m]", ylim=(0.0, 1.5 * bound_m))
    axes.legend(loc="upper center", ncols=3)
    _save(figure, folder / "vehicle_straight.svg")
    Console().print(table)


def price() -> None:
    """The largest speed that a disc allows, as Markdown; a row for each disc and slot."""
    print(
        "`v_max` at the full a_max / `v_max` that brakes within 2 r, with the a_max left there / GPS bound left there"
    )
    print(f"| r | slot | {' | '.join(map(_named, WINDS))} |\n|---|---|{'---|' * len(WINDS)}")
    for r_m in (2.0, 3.0, 5.0):
        for dt_s in (0.2, 0.5, 1.0):
            print(f"| {r_m:g} m | {dt_s:g} s | {' | '.join(_prices(r_m, dt_s, wind) for wind in WINDS)} |")


def _named(wind: dict[str, float]) -> str:
    return f"{wind['mean_mps']:g} + {wind['gust_mps']:g} m/s" if wind["mean_mps"] else "calm"


def _prices(r_m: float, dt_s: float, wind: dict[str, float]) -> str:
    """Return speeds, acceleration and GPS error bound; "-" for none."""
    entry = msgspec.structs.replace(UAV, r_m=r_m)
    mission = mission_from_dict({"r_m": r_m, "dt_s": dt_s, "vehicle": {"model": "multirotor"}, "wind": wind})
    fastest_mps = greatest_speed_mps(mission, entry)
    fastest = "-" if fastest_mps is None else f"{fastest_mps:.1f}"
    fits: list[Mission] = []
    for tenths in range(1, 1000):
        speed_mps = tenths / 10
        now = msgspec.structs.replace(mission, v_max_mps=speed_mps, roster=[entry])
        try:
            check_vehicles(now)
        except MissionError:
            break
        if braking_m(speed_mps * dt_s, step_change_m(now, entry) or 0.0) > 2 * r_m:
            break
        fits.append(now)
    if not fits:
        return f"{fastest} / - / -"
    budget = budget_of(fits[-1], entry)
    return f"{fastest} / {fits[-1].v_max_mps:.1f} m/s, {budget.a_max_mps2:.1f} m/s² / {budget.gps_m:.2f} m"


def figure(folder: Path) -> None:
    """One UAV that turns, brakes on a lost command, and is hit by a gust: path, true path, disc, and deviation."""
    fault = ["gust a 12mps @7s for 3s"]
    fields = {
        "vehicle": {"model": "arducopter"},
        "gps_model": "white",
        "gps_m": 0.6,
        "r_m": 2.0,
        "fault": fault,
        "seed": 4,
    }
    mission = mission_from_dict(fields)
    full, change_m = mission.u_max_m, step_change_m(mission, UAV) or 0.0
    steps = ramp(mission, [(full + 0j, 7), (full * 1j, 6)])
    before, here = ((0.0, 0.0), (steps[-1].real, steps[-1].imag))
    for _ in range(12):  # No command comes any more.
        before, here = braked(before, here, change_m)
        steps.append(complex(here[0] - before[0], here[1] - before[1]))
    budget, rows = budget_of(mission, UAV), list(flown(mission, steps, Gust("a", 12.0, at_s=7.0, for_s=3.0)))
    wanted, true = (np.array([row[column] for row in rows]) for column in (0, 1))
    picture, (plane, over) = plt.subplots(1, 2, figsize=(10, 4.2))
    drawn = complex("inf")
    for centre in wanted:
        if abs(centre - drawn) > 1.5:
            plane.add_patch(Circle((centre.real, centre.imag), 2.0, color="tab:blue", alpha=0.08))
            drawn = centre
    plane.plot(wanted.real, wanted.imag, color="tab:blue", label="declared path, with discs")
    plane.plot(true.real, true.imag, color="tab:red", label="true path")
    plane.plot(*np.cumsum([[s.real, s.imag] for s in [0j, *steps]], axis=0).T, "k.", markersize=3, label="waypoints")
    plane.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    plane.legend(loc="upper left")
    times_s = 0.1 * np.arange(1, len(rows) + 1)
    over.plot(times_s, np.abs(wanted - true), color="tab:red", label="deviation")
    over.axhline(budget.gps_m + budget.tracking_m, color="black", linestyle=":", label="GPS + tracking bound")
    for begin_s, end_s, name, height_m in (
        (3.5, 5.5, "turns", 0.8),
        (6.5, 8.5, "brakes", 0.8),
        (7.0, 10.0, "gust", 0.7),
    ):
        over.axvspan(begin_s, end_s, alpha=0.1)
        over.text(begin_s + 0.1, height_m, name)
    over.set(xlabel="time [s]", ylabel="distance [m]", ylim=(0.0, 1.25))
    over.legend(loc="upper left")
    _save(picture, folder / "vehicle_flight.svg")
    print(f"deviation at most {np.abs(wanted - true).max():.2f} m, bound {budget.gps_m + budget.tracking_m:.2f} m")


def _save(picture: Any, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.tight_layout()
    picture.savefig(path, metadata={"Date": None})
    print(path)


def main() -> int:
    """Make what the words ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["straight", "price", "figure"])
    parser.add_argument("--folder", type=Path, default=Path("docs/figures"))
    given = parser.parse_args()
    match given.what:
        case "straight":
            straight(given.folder)
        case "price":
            price()
        case "figure":
            figure(given.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
