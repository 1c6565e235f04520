"""What flying costs that has inertia: tables and figures of docs/vehicles.md.

    python benchmarks/vehicles.py straight          a straight flight, a turn and a stop: deviation, with a plot
    python benchmarks/vehicles.py missions          K = 50 in wind, beside `ideal` (--runs 30, --uavs 50)
    python benchmarks/vehicles.py price             largest speed and GPS error for discs of 2, 3 and 5 m
    python benchmarks/vehicles.py delay             collisions and deviation over delay and loss, with a plot
    python benchmarks/vehicles.py figure            one UAV that turns, brakes and is hit by a gust: a plot

Plots go to docs/figures/ (or --folder). Missions are simulated one after another, so no other figure is a time.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from rich.console import Console
from rich.table import Table

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.emulation.body import Flown
from edc_swarm.emulation.multirotor import Multirotor
from edc_swarm.errors import MissionError
from edc_swarm.mission.braking import braked
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declared_path import declared
from edc_swarm.mission.faults import Gust
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.vehicle_budget import budget_of, check_vehicles, step_change_m
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Circle

UAV = RosterEntry(uav="a", start_x_m=0.0, start_y_m=0.0, target_x_m=0.0, target_y_m=9.0, r_m=2.0, body_m=0.25)
FIRST_SEED = 1000


def simulated(fields: dict[str, Any]) -> tuple[Recording, Metrics, float]:
    """Simulate a mission; return its recording, its metrics, and the seconds that it took."""
    message = mission_message(complete_mission(mission_from_dict(fields)))
    said: list[Message] = []
    planner = make_planner(message.planner, message)
    begun_s = time.process_time()
    Simulation(message, lambda: planner, lambda _key, now, _ns: said.append(now)).run()
    took_s = time.process_time() - begun_s
    recording = Recording.from_messages(said)
    return recording, compute_metrics(recording), took_s


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
    courses = {
        "straight": [(full + 0j, 16)],
        "turn": [(full + 0j, 12), (full * 1j, 14)],
        "reversal": [(full + 0j, 12), (-full + 0j, 14)],
        "stop": [(full + 0j, 12), (0j, 14)],
    }
    table = Table(
        title=f"arducopter, 5 m/s, slots of 0.5 s: deviation from the declared path (bound {budget.tracking_m:.2f} m)"
    )
    for column in ("flight", "largest", "mean", "at the end"):
        table.add_column(column)
    figure, axes = plt.subplots(figsize=(7, 3.2))
    for name, course in courses.items():
        off_m = [abs(wanted - true) for wanted, true, _ in flown(mission, ramp(mission, course))]
        table.add_row(name, f"{max(off_m):.3f} m", f"{np.mean(off_m):.3f} m", f"{off_m[-1]:.3f} m")
        axes.plot(0.1 * np.arange(1, len(off_m) + 1), off_m, label=name)
    axes.axhline(budget.turn_m + budget.between_m, color="black", linestyle=":", label="bound (no GPS error)")
    axes.set(xlabel="time [s]", ylabel="deviation [m]")
    axes.legend()
    _save(figure, folder / "vehicle_straight.svg")
    Console().print(table)


def missions(uavs: int, runs: int, area_m2: float) -> None:
    """Random missions in wind, with GPS errors that change, beside the same missions of ideal vehicles."""
    table = Table(title=f"K = {uavs} on {area_m2:g} m2, {runs} missions each")
    names = ("vehicle", "wind", "GPS", "complete", "potential", "true", "outside", "extra", "makespan", "energy", "CPU")
    for column in names:
        table.add_column(column)
    cases = [("ideal", 0.0, "white")]
    cases += [("multirotor", wind, gps) for gps in ("white", "gauss-markov") for wind in (0.0, 4.0, 8.0)]
    for vehicle, mean_mps, gps in cases:
        wind = {"mean_mps": mean_mps, "gust_mps": mean_mps / 2}
        fields = {"uavs": uavs, "area_m2": area_m2, "gps_model": gps, "vehicle": {"model": vehicle}, "wind": wind}
        found = [simulated({**fields, "seed": FIRST_SEED + run}) for run in range(runs)]
        outside = sum(
            violation.kind == "outside-disc"
            for recording, *_ in found
            for result in check(recording)
            for violation in result.violations
        )
        each = [metrics for _, metrics, _ in found]
        table.add_row(
            vehicle, f"{mean_mps:g} m/s", gps, f"{sum(m.completed is True for m in each)} of {runs}",
            str(sum(m.potential_collisions or 0 for m in each)), str(sum(m.true_collisions or 0 for m in each)),
            str(outside), f"{np.mean([m.extra_distance_pct or 0.0 for m in each]):.1f} %",
            f"{np.mean([m.makespan_s or np.nan for m in each]):.1f} s",
            f"{np.mean([(m.energy_propulsion_j or np.nan) / 1e3 for m in each]):.1f} kJ",
            f"{1e3 * np.mean([took / (m.slots or 1) for _, m, took in found]):.0f} ms a slot",
        )  # fmt: skip
    Console().print(table)


def price() -> None:
    """The largest speed that the budget of a disc allows, and what it leaves for the GPS error at 5 m/s."""
    table = Table(title="multirotor: largest v_max, its braking way, and the GPS error bound that the disc leaves")
    for column in (
        "r",
        "slot",
        "calm: v_max",
        "brakes in",
        "GPS bound",
        "8 m/s, gusts 4: v_max",
        "brakes in",
        "GPS bound",
    ):
        table.add_column(column)
    for r_m in (2.0, 3.0, 5.0):
        for dt_s in (0.2, 0.5, 1.0):
            table.add_row(f"{r_m:g} m", f"{dt_s:g} s", *_dearest(r_m, dt_s, 0.0), *_dearest(r_m, dt_s, 8.0))
    Console().print(table)


def _dearest(r_m: float, dt_s: float, mean_mps: float) -> tuple[str, str, str]:
    """Return v_max, braking way and GPS bound as text: the fastest vehicle that brakes within its disc's diameter."""
    wind = {"mean_mps": mean_mps, "gust_mps": mean_mps / 2}
    fields = {"r_m": r_m, "dt_s": dt_s, "vehicle": {"model": "multirotor"}, "wind": wind}
    best: tuple[str, str, str] = ("-", "-", "-")
    for tenths in range(1, 300):
        mission = mission_from_dict({**fields, "v_max_mps": tenths / 10})
        entry = RosterEntry(uav="a", start_x_m=0.0, start_y_m=0.0, target_x_m=0.0, target_y_m=9.0, r_m=r_m, body_m=0.25)
        try:
            check_vehicles(
                Mission(**{**{f: getattr(mission, f) for f in mission.__struct_fields__}, "roster": [entry]})
            )
        except MissionError:
            break
        budget = budget_of(mission, entry)
        way_m = (tenths / 10) ** 2 / (2 * budget.a_max_mps2)
        if way_m > 2 * r_m:
            break
        best = (f"{tenths / 10:.1f} m/s", f"{way_m:.1f} m", f"{budget.gps_m:.2f} m")
    return best


def delay(folder: Path, uavs: int) -> None:
    """Missions over delay and loss of all links: collisions, and the largest deviation."""
    delays_ms, losses = (0, 100, 200, 300, 400), (0.0, 0.1, 0.3)
    table = Table(title=f"multirotor, K = {uavs}: collisions (potential, true) and largest deviation")
    for column in ("delay", *(f"loss {100 * loss:g} %" for loss in losses)):
        table.add_column(column)
    figure, axes = plt.subplots(figsize=(7, 3.2))
    off_m: dict[float, list[float]] = {loss: [] for loss in losses}
    for delay_ms in delays_ms:
        row = [f"{delay_ms} ms"]
        for loss in losses:
            link = [{"delay_ms": float(delay_ms), "jitter_ms": delay_ms / 5, "loss": loss}]
            wind = {"mean_mps": 4.0, "gust_mps": 2.0}
            fields = {"uavs": uavs, "area_m2": 800.0 * uavs, "vehicle": {"model": "multirotor"}, "wind": wind}
            _, m, _ = simulated({**fields, "gps_model": "white", "link": link, "seed": FIRST_SEED, "max_slots": 400})
            off_m[loss].append(m.max_deviation_m or np.nan)
            row.append(
                f"{m.potential_collisions}, {m.true_collisions}; {m.max_deviation_m or np.nan:.2f} m; {m.slots} slots"
            )
        table.add_row(*row)
    for loss, values in off_m.items():
        axes.plot(delays_ms, values, marker="o", label=f"loss {100 * loss:g} %")
    axes.set(xlabel="delay [ms]", ylabel="largest deviation [m]", ylim=(0.0, None))
    axes.legend()
    _save(figure, folder / "vehicle_delay.svg")
    Console().print(table)


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
    for centre in wanted[::5]:
        plane.add_patch(Circle((centre.real, centre.imag), 2.0, color="tab:blue", alpha=0.06))
    plane.plot(wanted.real, wanted.imag, color="tab:blue", label="declared path, with discs")
    plane.plot(true.real, true.imag, color="tab:red", label="true path")
    plane.plot(*np.cumsum([[s.real, s.imag] for s in [0j, *steps]], axis=0).T, "k.", markersize=3, label="waypoints")
    plane.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    plane.legend(loc="lower right")
    times_s = 0.1 * np.arange(1, len(rows) + 1)
    over.plot(times_s, np.abs(wanted - true), color="tab:red", label="deviation")
    over.axhline(budget.gps_m + budget.tracking_m, color="black", linestyle=":", label="GPS + tracking bound")
    for begin_s, end_s, name in ((3.5, 5.5, "turns"), (6.5, 8.5, "brakes"), (7.0, 10.0, "gust")):
        over.axvspan(begin_s, end_s, alpha=0.1)
        over.text(begin_s, 0.03 + 0.05 * (name == "gust"), name)
    over.set(xlabel="time [s]", ylabel="distance [m]", ylim=(0.0, None))
    over.legend()
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
    parser.add_argument("what", choices=["straight", "missions", "price", "delay", "figure"])
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--uavs", type=int, default=50)
    parser.add_argument("--area", type=float, default=40_000.0)
    parser.add_argument("--folder", type=Path, default=Path("docs/figures"))
    given = parser.parse_args()
    match given.what:
        case "straight":
            straight(given.folder)
        case "missions":
            missions(given.uavs, given.runs, given.area)
        case "price":
            price()
        case "delay":
            delay(given.folder, given.uavs)
        case "figure":
            figure(given.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
