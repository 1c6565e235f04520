"""Quality and time of the planner, and comparison of OSQP with other solvers on the same slot QPs.

    python benchmarks/planner.py                  all cases, 30 missions each (seeds 1000-1029)
    python benchmarks/planner.py --quick          two missions each of the small cases
    python benchmarks/planner.py --only open,dense --runs 10 --jobs 2 --json out.json

The planner runs alone in a closed loop: every command is executed (except in the case with lost commands), and every
motion is checked by exact closest approach. Times are processor time of the planning thread, so that other work on
the machine matters less. Tune the planner only on seeds below 1000.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from edc_swarm.emulation.energy import propulsion_powers_w
from edc_swarm.geometry import Floats, closest_approach_m, length_m, near_pairs
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.field_types import Minimise
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner.interface import PlanRequest
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.solver import slot_qp, solution
from processes.experiments.workers import workers

FIRST_SEED = 1000


@dataclass(frozen=True)
class Case:
    """Missions of one kind. `runs` is their default number; `circle` puts starts and targets on a circle."""

    uavs: int
    area_m2: float
    r_m: float = 5.0
    loss: float = 0.0
    minimise: Minimise = "distance"
    runs: int = 30
    circle: bool = False
    target: str = ""
    planner: str = "edc"
    responses: int = 1


CASES = {
    "open": Case(50, 40_000, target="3.5 % 1.12 p 4/12 ms"),
    "lossy": Case(50, 40_000, loss=0.2, target="5 % 1.28"),
    "lossy-floor": Case(50, 40_000, loss=0.2, planner="straight", target="no avoidance: the least makespan"),
    "energy": Case(50, 40_000, minimise="energy", target="energy 12 %"),
    "time": Case(50, 40_000, minimise="time"),
    "dense": Case(50, 10_000, target="40 % 2.2 p 12/45 ms"),
    "wide": Case(50, 90_000, target="1.5 % 1.06 p 2/8 ms"),
    "r1": Case(50, 40_000, r_m=1.0, target="0.2 % 1.02"),
    "r10": Case(50, 40_000, r_m=10.0, target="42 % 2.1"),
    "circle10": Case(10, 10_000, circle=True, runs=5, target="12 % 1.8"),
    "circle20": Case(20, 10_000, circle=True, runs=5, target="12 % 1.8"),
    "circle50": Case(50, 10_000, circle=True, runs=5, target="12 % 1.8"),
    "circle100": Case(100, 10_000, circle=True, runs=3, target="12 % 1.8"),
    "K200": Case(200, 160_000, runs=10, target="3.5 % 1.10 p99 45 ms"),
    "K1000": Case(1000, 800_000, runs=5, target="4 % 1.10 p99 150 ms"),
    "K2000": Case(2000, 1_600_000, runs=1, target="p99 400 ms"),
}
CASES |= {
    f"{name}-3": replace(CASES[name], responses=3, target=target)
    for name, target in (
        ("open", ""), ("energy", "energy 11 %"), ("dense", "33 %"), ("circle10", ""), ("circle20", "8 % 1.6"),
        ("circle50", "10 % 1.7"), ("circle100", "15 % 2.0"),
    )
}  # fmt: skip
"""Those ending in -3 with `responses` 3."""
QUICK = ("open", "lossy", "dense", "circle10", "circle20")
SOLVERS = ("osqp", "clarabel", "piqp", "daqp")


def mission_of(case: Case, seed: int) -> tuple[Mission, Floats, Floats]:
    """Return the mission with its starts and targets, (K, 2) each."""
    mission = Mission(
        uavs=case.uavs,
        area_m2=case.area_m2,
        r_m=case.r_m,
        minimise=case.minimise,
        responses=case.responses,
        seed=seed,
        fence="none",  # benchmarks/zones.py says what a fence costs
    )
    if case.circle:
        radius_m = max(40.0, 10.5 * case.uavs / (2 * math.pi))
        angle = np.arange(case.uavs) * 2 * math.pi / case.uavs
        start_m = radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return mission, start_m, -start_m
    mission = complete_mission(mission)
    start_m = np.array([(e.start_x_m, e.start_y_m) for e in mission.roster])
    target_m = np.array([(e.target_x_m, e.target_y_m) for e in mission.roster])
    return msgspec.structs.replace(mission, roster=[]), start_m, target_m


def fly(name: str, seed: int) -> dict[str, Any]:
    """Run one mission with the planner alone."""
    warnings.simplefilter("ignore")
    case = CASES[name]
    mission, start_m, target_m = mission_of(case, seed)
    warm_up(mission)
    planner = make_planner(case.planner, mission, time.thread_time_ns)
    log = Log(mission, start_m, target_m)
    lost = np.random.default_rng([seed, 1])
    position_m, r_m = start_m, np.full(case.uavs, case.r_m)
    for slot in range(math.ceil(20 * log.straight_m.max() / mission.u_max_m) + 200):
        started_ns = time.thread_time_ns()
        plan = planner.plan(PlanRequest(slot, range(case.uavs), position_m, target_m, r_m))
        plan_ms = (time.thread_time_ns() - started_ns) / 1e6
        after_m = np.array(plan.waypoint_m)
        if case.loss:
            after_m = np.where((lost.random(case.uavs) < case.loss)[:, None], position_m, after_m)
        log.add(position_m, after_m, [plan_ms, plan.guidance_ms, plan.assemble_ms + plan.solve_ms])
        position_m = after_m
        if not log.away.any():
            break
    return {"case": name, "seed": seed, **log.summary()}


class Log:
    """The measurements of one mission."""

    def __init__(self, mission: Mission, start_m: Floats, target_m: Floats) -> None:
        self.mission, self.target_m = mission, target_m
        self.straight_m = length_m(target_m - start_m)
        self.path_m = np.zeros(len(start_m))
        self.energy_j = np.zeros(len(start_m))
        self.waiting_j = np.zeros(len(start_m))
        self.arrival_slots = np.zeros(len(start_m))
        self.away = self.straight_m >= ARRIVED_M
        self.least_gap_m = math.inf
        self.overlaps: set[tuple[int, int]] = set()
        self.times_ms: list[list[float]] = []

    def add(self, before_m: Floats, after_m: Floats, times_ms: list[float]) -> None:
        """Add one slot, in which every UAV flies straight from `before_m` to `after_m`."""
        mission = self.mission
        step_m = length_m(after_m - before_m)
        self.path_m += step_m
        was_away, self.away = self.away, length_m(self.target_m - after_m) >= ARRIVED_M
        # Time at the target counts only if the UAV has to leave it again.
        self.waiting_j += propulsion_powers_w(step_m / mission.dt_s, mission.energy) * mission.dt_s
        active = was_away | self.away
        self.energy_j[active] += self.waiting_j[active]
        self.waiting_j[active] = 0.0
        self.arrival_slots[active] = len(self.times_ms) + 1
        self.times_ms.append(times_ms)
        self._audit(before_m, after_m)

    def _audit(self, before_m: Floats, after_m: Floats) -> None:
        reach_m = 2 * self.mission.r_m
        k, other = near_pairs(before_m, reach_m + 2 * self.mission.u_max_m)
        if len(k):
            near_m = closest_approach_m(before_m[k], after_m[k], before_m[other], after_m[other])
            self.least_gap_m = min(self.least_gap_m, float(near_m.min() - reach_m))
            hit = near_m < reach_m - 1e-9
            self.overlaps |= set(zip(k[hit].tolist(), other[hit].tolist(), strict=True))

    def summary(self) -> dict[str, Any]:
        """Return the results of one mission."""
        mission = self.mission
        cruise_w = float(propulsion_powers_w(np.array([mission.v_max_mps]), mission.energy)[0])
        straight_j = cruise_w * self.straight_m.sum() / mission.v_max_mps
        return {
            "completed": not self.away.any(),
            "overlaps": len(self.overlaps),
            "least_gap_m": self.least_gap_m,
            "extra_distance_pct": 100 * (float(self.path_m.sum() / self.straight_m.sum()) - 1),
            "makespan_ratio": float(self.arrival_slots.max() * mission.u_max_m / self.straight_m.max()),
            "extra_energy_pct": 100 * (float(self.energy_j.sum() / straight_j) - 1),
            "times_ms": self.times_ms,
        }


def summarise(flights: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the results of one case: means over missions, quantiles over all their slots."""
    times_ms = np.concatenate([flight["times_ms"] for flight in flights])
    return {
        "completed": f"{sum(f['completed'] for f in flights)}/{len(flights)}",
        "overlaps": sum(f["overlaps"] for f in flights),
        "least_gap_m": min(f["least_gap_m"] for f in flights),
        **{
            key: float(np.mean([f[key] for f in flights]))
            for key in ("extra_distance_pct", "makespan_ratio", "extra_energy_pct")
        },
        **quantiles("plan_ms", times_ms[:, 0]),
        **quantiles("guidance_ms", times_ms[:, 1]),
        **quantiles("qp_ms", times_ms[:, 2]),
        "first_plan_ms": float(np.median([f["times_ms"][0][0] for f in flights])),
        "target": CASES[flights[0]["case"]].target,
    }


def quantiles(name: str, values: Floats) -> dict[str, float]:
    return {f"{name}_p{q}": float(np.percentile(values, q)) for q in (50, 99)}


def recorded_problems(seed: int, slots: int) -> Iterator[solution.Program]:
    """Yield the slot QPs of a dense mission, as the planner assembles them."""
    mission, position_m, target_m = mission_of(CASES["dense"], seed)
    planner = make_planner("edc", mission)
    kept: list[solution.Program] = []
    solve = solution.solve

    def spy(problem: slot_qp.Problem, program: solution.Program, memory: solution.Memory) -> solution.Solution:
        kept.append(program)
        return solve(problem, program, memory)

    solution.solve = spy
    try:
        for slot in range(slots):
            request = PlanRequest(slot, range(len(position_m)), position_m, target_m, np.full(50, 5.0))
            position_m = np.array(planner.plan(request).waypoint_m)
    finally:
        solution.solve = solve
    yield from (program for program in kept if len(program.bound_m))


def compare_solvers(slots: int) -> list[dict[str, Any]]:
    """Run each solver on the same slot QPs without warm start; return time, gap to the best optimum, violation."""
    programs = list(recorded_problems(FIRST_SEED, slots))
    answers = {name: [timed(name, program) for program in programs] for name in SOLVERS}
    rows = []
    for name in SOLVERS:
        times_ms = [ms for _, ms in answers[name]]
        steps = [x for x, _ in answers[name]]
        rows.append(
            {
                "solver": name,
                "problems": len(programs),
                "failed": sum(x is None for x in steps),
                **quantiles("solve_ms", np.array(times_ms)),
                "worst_violation_m": max(
                    float((p.matrix @ x - p.bound_m).max())
                    for p, x in zip(programs, steps, strict=True) if x is not None
                ),
                "worst_error_m": max(
                    float(np.abs(x - best).max())
                    for x, (best, _) in zip(steps, answers["clarabel"], strict=True)
                    if x is not None and best is not None
                ),
            }
        )  # fmt: skip
    return rows


def timed(name: str, program: solution.Program) -> tuple[Floats | None, float]:
    """Return steps and milliseconds of one solver on one program, without the conversion of matrices."""
    import qpsolvers  # noqa: PLC0415 (a development dependency)
    import scipy.sparse  # noqa: PLC0415

    size = program.matrix.shape[1]
    wish = -2 * program.wish_step_m.ravel()
    cost: Any = 2 * np.eye(size)
    matrix: Any = program.matrix.toarray()
    if name != "daqp":
        cost, matrix = scipy.sparse.csc_matrix(cost), program.matrix
    options = solution.SETTINGS if name == "osqp" else {}
    started_ns = time.thread_time_ns()
    answer = qpsolvers.solve_qp(cost, wish, matrix, program.bound_m, solver=name, **options)
    return answer, (time.thread_time_ns() - started_ns) / 1e6


def show(results: dict[str, dict[str, Any]], solvers: list[dict[str, Any]], console: Console) -> None:
    table = Table(title="planner edc, closed loop")
    heads = ("case", "completed", "overlaps", "extra %", "makespan", "energy %", "plan p50", "p99", "first",
             "QP p50", "p99", "to reach")  # fmt: skip
    for head in heads:
        table.add_column(head, justify="right")
    for name, r in results.items():
        table.add_row(
            name, r["completed"], str(r["overlaps"]), f"{r['extra_distance_pct']:.2f}",
            f"{r['makespan_ratio']:.3f}", f"{r['extra_energy_pct']:.1f}", f"{r['plan_ms_p50']:.1f}",
            f"{r['plan_ms_p99']:.1f}", f"{r['first_plan_ms']:.0f}", f"{r['qp_ms_p50']:.2f}",
            f"{r['qp_ms_p99']:.2f}", r["target"],
        )  # fmt: skip
    console.print(table)
    table = Table(title="the slot QPs of one dense mission, without warm start, by solver")
    for head in solvers[0]:
        table.add_column(head, justify="right")
    for row in solvers:
        table.add_row(*(f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()))
    console.print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two missions each of the small cases")
    parser.add_argument("--only", default="", help=f"comma-separated cases of {', '.join(CASES)}")
    parser.add_argument("--runs", type=int, default=0, help="missions per case (default: as declared for the case)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", metavar="FILE", default="", help="write the results to FILE ('-': standard output)")
    args = parser.parse_args()
    chosen = args.only.split(",") if args.only else list(QUICK if args.quick else CASES)
    if unknown := set(chosen) - set(CASES):
        parser.error(f"unknown cases: {', '.join(sorted(unknown))}")
    runs = args.runs or (2 if args.quick else 0)
    work = [(name, FIRST_SEED + i) for name in chosen for i in range(min(runs or 99, CASES[name].runs))]
    console = Console(stderr=True, width=max(150, Console().width))
    with workers(args.jobs) as pool:
        flights = list(track(pool.map(fly, *zip(*work, strict=True)), "flying", total=len(work), console=console))
    results = {name: summarise([f for f in flights if f["case"] == name]) for name in chosen}
    solvers = compare_solvers(20 if args.quick else 100)
    show(results, solvers, console)
    if args.json:
        text = json.dumps({"cases": results, "solvers": solvers}, indent=1)
        with sys.stdout if args.json == "-" else open(args.json, "w", encoding="utf-8") as file:
            file.write(text + "\n")


if __name__ == "__main__":
    main()
