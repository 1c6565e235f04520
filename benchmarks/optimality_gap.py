"""The optimality gap of planner `edc` in distance, against the solver of the paper's eq. 13-21 (edc_swarm.reference).

    python benchmarks/optimality_gap.py                     K = 2..6, ten seeds: some minutes; table and figure
    python benchmarks/optimality_gap.py --uavs 3 --runs 2   a few seconds
    python benchmarks/optimality_gap.py --circle            UAVs that swap places across a circle, one mission each

`edc` flies alone, with every command executed. The reference has exactly the slots that `edc` took, and looks for the
least distance in them. It is the better of what its own starts and a start from the flight of `edc` lead to, so the gap
is below 0 by the tolerance of the solver at most. Random missions have 650 m2 a UAV: discs of 5 m cover an eighth of
the area.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from edc_swarm.experiments.statistics import Estimate, estimate
from edc_swarm.geometry import Floats, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import random_roster
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.reference.problem import Problem
from edc_swarm.reference.search import STARTS, Reference, solve

AREA_M2 = 650.0
CIRCLE_M = 40.0
MOST_SLOTS = 400
OUT = Path(__file__).parents[1] / "docs" / "figures" / "optimality-gap"


@dataclass(frozen=True)
class Flown:
    """A flight of `edc` as a problem, what it flew, and the reference for it."""

    problem: Problem
    distance_m: float
    overlaps: bool
    reference: Reference

    @property
    def gap_pct(self) -> float:
        return 100 * (self.distance_m / self.reference.distance_m - 1)

    @property
    def reference_extra_pct(self) -> float:
        return 100 * (self.reference.distance_m / self.reference.straight_m - 1)

    @property
    def extra_pct(self) -> float:
        return 100 * (self.distance_m / self.reference.straight_m - 1)

    @property
    def proven_pct(self) -> float:
        """Return how far the reference can be from the optimum at most."""
        return 100 * (self.reference.distance_m / self.reference.bound_m - 1)


def places(mission: Mission, circle: bool) -> tuple[Floats, Floats]:
    """Return starts and targets, (K, 2) each."""
    if circle:
        angle = np.arange(mission.uavs) * 2 * math.pi / mission.uavs
        start_m = CIRCLE_M * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return start_m, -start_m
    roster = random_roster(mission)
    return (
        np.array([(entry.start_x_m, entry.start_y_m) for entry in roster]),
        np.array([(entry.target_x_m, entry.target_y_m) for entry in roster]),
    )


def fly(uavs: int, seed: int, circle: bool, starts: int) -> Flown | None:
    """Fly a mission and solve it; None if the flight does not end or no reference is found."""
    mission = Mission(uavs=uavs, area_m2=AREA_M2 * uavs, seed=seed, fence="none")
    start_m, target_m = places(mission, circle)
    radius_m = np.full(uavs, mission.r_m)
    planner, path = make_planner("edc", mission), [start_m]
    while (length_m(path[-1] - target_m) > ARRIVED_M).any():
        if len(path) > MOST_SLOTS:
            return None
        request = PlanRequest(len(path) - 1, range(uavs), path[-1], target_m, radius_m)
        path.append(np.array(planner.plan(request).waypoint_m))
    path_m = np.array(path)
    problem = Problem(start_m, target_m, radius_m, np.full(uavs, mission.u_max_m), len(path_m) - 1)
    path_m[-1] = target_m
    reference = solve(problem, starts=starts, seed=seed, also=[path_m])
    if reference is None:
        return None
    distance_m = float(length_m(np.diff(path_m, axis=0)).sum())
    return Flown(problem, distance_m, problem.least_gap_m(path_m) < -1e-6, reference)


def shown(value: Estimate, digits: int = 2) -> str:
    if value.low is None or value.high is None:
        return f"{value.mean:.{digits}f}"
    return f"{value.mean:.{digits}f} ({value.low:.{digits}f} to {value.high:.{digits}f})"


def row(uavs: int, runs: int, flown: list[Flown]) -> str:
    columns = ("extra_pct", "reference_extra_pct", "gap_pct", "proven_pct")
    means = [
        shown(estimate([getattr(flight, name) for flight in flown], "amount")) if flown else "-" for name in columns
    ]
    overlaps = sum(flight.overlaps for flight in flown)
    largest = f"{max(flight.gap_pct for flight in flown):.2f}" if flown else "-"
    return f"| {uavs} | {len(flown)} of {runs} | {overlaps} | {' | '.join(means)} | {largest} |"


def draw(gaps: dict[int, list[float]], extras: dict[int, list[float]], out: Path) -> None:
    """Write the figure: the extra distance of the reference, and the gap above it, by the number of UAVs."""
    import matplotlib as mpl  # noqa: PLC0415  (an extra)

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "edc"
    from matplotlib import pyplot as plt  # noqa: PLC0415  (after the choice of the backend)

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for name, values, colour, mark in (
        ("planner edc above the reference", gaps, "#0072b2", "o"),
        ("reference above straight ways", extras, "#d55e00", "s"),
    ):
        estimates = [estimate(runs, "amount") for runs in values.values()]
        mean = [value.mean for value in estimates]
        low = [value.mean if value.low is None else value.low for value in estimates]
        high = [value.mean if value.high is None else value.high for value in estimates]
        axes.fill_between(list(values), low, high, color=colour, alpha=0.2, linewidth=0)
        axes.plot(list(values), mean, color=colour, marker=mark, label=name)
    axes.set(xlabel="UAVs", ylabel="distance, %", xticks=list(gaps), ylim=(0, None))
    figure.legend(loc="outside upper left", ncols=2, frameon=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    metadata: dict[str, Any] = {"Date": None}
    figure.savefig(out.with_suffix(".svg"), metadata=metadata)
    figure.savefig(out.with_suffix(".png"), dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uavs", type=int, nargs="+", default=[2, 3, 4, 5, 6])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--starts", type=int, default=STARTS)
    parser.add_argument("--circle", action="store_true", help="UAVs that swap places across a circle of radius 40 m")
    parser.add_argument("--out", type=Path, default=OUT, help="figure, without suffix")
    options = parser.parse_args()
    warm_up(Mission())
    runs = 1 if options.circle else options.runs
    print(
        "| K | solved | overlaps | edc over straight, % | reference over straight, % | edc over reference, % "
        "| reference over bound, % | largest gap, % |\n|---|---|---|---|---|---|---|---|"
    )
    gaps: dict[int, list[float]] = {}
    extras: dict[int, list[float]] = {}
    for uavs in options.uavs:
        tried = [fly(uavs, seed, options.circle, options.starts) for seed in range(runs)]
        flown = [flight for flight in tried if flight is not None]
        print(row(uavs, runs, flown), flush=True)
        if flown:
            gaps[uavs] = [flight.gap_pct for flight in flown]
            extras[uavs] = [flight.reference_extra_pct for flight in flown]
    if gaps and not options.circle:
        draw(gaps, extras, options.out)


if __name__ == "__main__":
    main()
