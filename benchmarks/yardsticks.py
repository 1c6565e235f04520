"""Published figures of other planners beside ours, on the same circles, squares and maps: docs/yardsticks.md.

    python benchmarks/yardsticks.py                        all of them; hours, but an interrupted run goes on
    python benchmarks/yardsticks.py --only gbp --runs 3    one of them, three seeds
    python benchmarks/yardsticks.py --only lsc,mapf --data FOLDER   files of others, which this project does not ship
    python benchmarks/yardsticks.py --json                 the results as JSON alone on standard output

Every mission is simulated whole: election, fixes, commands, lost messages, every guarantee checked. Each result is
appended to --results at once, and is not flown again while it is there. Published figures stand in `Case.published`
with their source in `SOURCES`; nobody else's program runs here.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from rich.console import Console
from rich.progress import track

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.formats.assemble import Settings, assemble
from edc_swarm.formats.content import Options
from edc_swarm.formats.registry import read_files
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation
from processes.experiments.workers import workers

FIRST_SEED = 1000
RESENDS = 40
"""Budget of repeats per UAV and slot, which suffices for 90 % loss."""
SOURCES = {
    "gbp": "A. Patwardhan, R. Murai, A. J. Davison, Distributing Collaborative Multi-Robot Planning with Gaussian "
    "Belief Propagation, IEEE RA-L 8(2), 2023 (arXiv 2203.11618): circle of 50 m, 21 robots, radius U(2, 3) m, 10 m/s",
    "rvo2": "J. van den Berg et al., RVO2 Library, examples/Circle: 250 agents, circle of 200 m, radius 1.5 m, 2 m/s",
    "lsc": "J. Park et al., Online Distributed Trajectory Planning for Quadrotor Swarm, ICRA 2022, files of "
    "qwerty35/lsc_planner",
    "mapf": "R. Stern et al., Multi-Agent Pathfinding: Definitions, Variants, and Benchmarks, SoCS 2019: "
    "random-32-32-10",
    "loss": "this project: random missions on a good, a lossy and a bursty network",
}
GBP_MAKESPAN_S = {0: 19.5, 30: 25.7, 50: 35.6, 70: 51.3, 90: 146.9}
"""Published makespan of GBP planning by the share of messages that fail, in percent."""
GBP_GOAL_S = {0: 12.5, 30: 20.0, 50: 28.0, 70: 45.0}
"""What this project wants to reach, from the start of the mission to the last arrival; at 90 % it is to complete."""
BURST_LEAVE = 0.1
"""A burst lasts ten messages in the mean."""


@dataclass(frozen=True)
class Case:
    """One row of a table: a mission for each seed, and what others and this project aim at say about it."""

    yardstick: str
    label: str
    fields: dict[str, Any]
    runs: int = 1
    published: str = ""
    goal: str = ""

    def mission(self, seed: int, more: dict[str, Any]) -> MissionMessage:
        """Return the mission of a seed, with `more` fields."""
        fields = {**self.fields, "name": "yardstick", "seed": seed, **more}
        if self.yardstick == "gbp":
            fields["roster"] = gbp_roster(seed)
        return mission_message(complete_mission(mission_from_dict(fields)))


def circle(uavs: int, radius_m: float) -> list[dict[str, Any]]:
    """Return UAVs at equal distances on a circle, each with the place opposite as its target."""
    turns = [2 * math.pi * k / uavs for k in range(uavs)]
    places = [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
    return [
        {"uav": f"u{k + 1:03d}", "start_x_m": x_m, "start_y_m": y_m, "target_x_m": -x_m, "target_y_m": -y_m}
        for k, (x_m, y_m) in enumerate(places)
    ]


def gbp_roster(seed: int) -> list[dict[str, Any]]:
    """Return the robots of the GBP circle: the disc of each is its body, so no GPS error is left."""
    random = Random(f"gbp/{seed}")
    radii_m = [random.uniform(2.0, 3.0) for _ in range(21)]
    return [{**entry, "r_m": r_m, "body_m": r_m} for entry, r_m in zip(circle(21, 50.0), radii_m, strict=True)]


def network(percent: int, kind: str = "each") -> dict[str, Any]:
    """Return the links of a mission: each message is lost by itself, or in bursts with the same mean."""
    share = percent / 100
    if not percent:
        return {}
    if kind == "each":
        return {"link": [{"loss": share}]}
    enter = BURST_LEAVE * share / (1 - share)
    return {"link": [{"burst_enter": enter, "burst_leave": BURST_LEAVE, "burst_loss": 1.0}]}


def gbp_cases(_: argparse.Namespace) -> Iterator[Case]:
    """Yield the circle of GBP planning at each share of lost messages, for least distance and for least time."""
    for percent, published_s in GBP_MAKESPAN_S.items():
        goal_s = GBP_GOAL_S.get(percent)
        fields = {"v_max_mps": 10.0, "dt_s": 0.2, "r_m": 3.0, "gps_model": "none", **network(percent)}
        for minimise in ("distance", "time"):
            yield Case(
                "gbp",
                f"{percent} % of messages lost, minimise = {minimise}",
                {**fields, "minimise": minimise},
                runs=10,
                published=f"{published_s} s",
                goal=f"{goal_s:g} s" if goal_s else "completes",
            )


def rvo2_cases(_: argparse.Namespace) -> Iterator[Case]:
    """Yield the circle of the RVO2 library, and the same flown by ORCA (the library itself, through `pyrvo`)."""
    fields = {"v_max_mps": 2.0, "r_m": 1.5, "body_m": 1.5, "gps_model": "none", "roster": circle(250, 200.0)}
    fields["energy"] = {"initial_min_j": 1e6, "initial_max_j": 1e6}  # Agents of the library have no battery.
    goal = "25 %, 1.7 times the least makespan"
    yield Case("rvo2", "250 agents", fields, published="none", goal=goal)
    yield Case("rvo2", "250 agents, responses = 4", {**fields, "responses": 4}, published="none", goal=goal)
    yield Case("rvo2", "250 agents, planner orca", {**fields, "planner": "orca"}, published="none")


def lsc_cases(options: argparse.Namespace) -> Iterator[Case]:
    """Yield the planar missions of the LSC planner that the folder holds."""
    for path in found(options.data, "*circle*.json", "*square*.json"):
        yield Case("lsc", path.stem, imported([path]), published="none")


def mapf_cases(options: argparse.Namespace) -> Iterator[Case]:
    """Yield the map random-32-32-10 with more and more agents."""
    files = [*found(options.data, "random-32-32-10.map"), *found(options.data, "random-32-32-10*.scen")]
    for agents in (10, 25, 50, 75, 100) if len(files) > 1 else ():
        yield Case("mapf", f"{agents} agents", imported(files[:2], agents), published="none")


def loss_cases(_: argparse.Namespace) -> Iterator[Case]:
    """Yield random missions at each share of lost messages, lost one by one or in bursts."""
    for uavs in (10, 30, 50):
        for kind in ("each", "bursts"):
            for percent in (0, 30, 50, 70, 90) if kind == "each" else (30, 50, 70, 90):
                fields = {"uavs": uavs, "area_m2": 800.0 * uavs, "fence": "none", **network(percent, kind)}
                yield Case("loss", f"K = {uavs}, {percent} % lost, {kind}", fields, runs=3)


Job = tuple[Case, int]
YARDSTICKS = {"gbp": gbp_cases, "rvo2": rvo2_cases, "lsc": lsc_cases, "mapf": mapf_cases, "loss": loss_cases}


def found(folder: Path | None, *patterns: str) -> list[Path]:
    """Return the files of the folder, or of a folder in it, whose names fit a pattern."""
    return sorted(path for pattern in patterns for path in folder.rglob(pattern)) if folder is not None else []


def imported(files: Sequence[Path], agents: int = 10) -> dict[str, Any]:
    """Return the mission in files of other programs."""
    sources = read_files([(str(path), path.read_bytes()) for path in files], Options(agents=agents))
    return assemble(sources, Settings()).mission


def fly(case: Case, seed: int, resends: int) -> dict[str, Any]:
    """Simulate one mission and return what the tables show."""
    mission = case.mission(seed, {"resends": resends})
    said: list[Message] = []
    planner = make_planner(mission.planner, mission)
    Simulation(mission, lambda: planner, lambda _key, message, _ns: said.append(message)).run()
    recording = Recording.from_messages(said)
    results = check(recording)
    return {
        "yardstick": case.yardstick,
        "label": case.label,
        "seed": seed,
        "resends": resends,
        **measured(recording, compute_metrics(recording)),
        "broken": [result.guarantee for result in results if result.broken],
    }


def measured(recording: Recording, metrics: Metrics) -> dict[str, Any]:
    """Return times, distances and messages of one mission; a mission that did not complete has no time."""
    mission = recording.mission
    swarm = len(recording.fixes) + len(recording.commands) + len(recording.reports)
    first_slot = min((command.slot for command in recording.commands), default=None)
    home_s = None
    if metrics.completed and metrics.makespan_s is not None and first_slot is not None:
        home_s = first_slot * mission.dt_s + metrics.makespan_s
    return {
        "completed": metrics.completed,
        "home_s": home_s,
        "makespan_ratio": metrics.makespan_ratio if metrics.completed else None,
        "extra_distance_pct": metrics.extra_distance_pct if metrics.completed else None,
        "collisions": metrics.potential_collisions,
        "first_command_s": None if first_slot is None else first_slot * mission.dt_s,
        "terms": len(metrics.heads),
        "per_uav_and_slot": swarm / len(mission.roster) / (metrics.slots or 1),
    }


def read_results(path: Path) -> list[dict[str, Any]]:
    """Return the results so far; a line that a break has cut off does not count."""
    lines = path.read_text().splitlines() if path.exists() else []
    results = []
    for line in lines:
        try:
            results.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return results


def key_of(result: dict[str, Any]) -> tuple[Any, ...]:
    """Return what a mission is known by."""
    return result["yardstick"], result["label"], result["seed"], result["resends"]


def missing(cases: Sequence[Case], options: argparse.Namespace, results: Sequence[dict[str, Any]]) -> list[Job]:
    """Return the missions that are still to be flown."""
    known = {key_of(result) for result in results}
    runs = {case.label: options.runs or case.runs for case in cases}
    wanted = [(case, FIRST_SEED + run) for case in cases for run in range(runs[case.label])]
    return [(case, seed) for case, seed in wanted if (case.yardstick, case.label, seed, options.resends) not in known]


def fly_all(jobs: Sequence[Job], options: argparse.Namespace) -> None:
    """Fly missions side by side, and append each result to the file as soon as it is there."""
    with (
        options.results.open("a") as file,
        workers(options.jobs) as pool,
    ):
        flights = [pool.submit(fly, case, seed, options.resends) for case, seed in jobs]
        shown = track(as_completed(flights), "missions", total=len(flights), console=Console(stderr=True))
        for flight in shown:
            file.write(json.dumps(flight.result()) + "\n")
            file.flush()


def of_case(case: Case, results: Sequence[dict[str, Any]], options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield the results of a case that this call asks for."""
    runs = options.runs or case.runs
    for result in results:
        known = result["yardstick"], result["label"], result["resends"]
        if known == (case.yardstick, case.label, options.resends) and result["seed"] < FIRST_SEED + runs:
            yield result


def summary(case: Case, results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return a row of a table: means over the missions that completed, and how many there are."""
    done = [result for result in results if result["completed"]]

    def mean(name: str, of: Sequence[dict[str, Any]] = done) -> float | None:
        values = [result[name] for result in of if result[name] is not None]
        return statistics.fmean(values) if values else None

    return {
        "yardstick": case.yardstick,
        "case": case.label,
        "runs": len(results),
        "completed": len(done),
        "home_s": mean("home_s"),
        "home_range_s": [min(r["home_s"] for r in done), max(r["home_s"] for r in done)] if done else None,
        "makespan_ratio": mean("makespan_ratio"),
        "extra_distance_pct": mean("extra_distance_pct"),
        "collisions": sum(r["collisions"] or 0 for r in results) if results else None,
        "per_uav_and_slot": mean("per_uav_and_slot", results),
        "broken": sorted({name for result in results for name in result["broken"]}),
        "published": case.published,
        "goal": case.goal,
    }


COLUMNS = {
    "case": "case",
    "published": "published",
    "home_s": "ours, s",
    "home_range_s": "least, most",
    "goal": "our goal",
    "completed": "completed",
    "makespan_ratio": "x least makespan",
    "extra_distance_pct": "extra %",
    "collisions": "overlaps",
    "per_uav_and_slot": "messages per UAV and slot",
    "broken": "broken",
}


def shown(row: dict[str, Any], name: str) -> str:
    """Return a value of a row as text; what is unknown is a dash."""
    value = row[name]
    if name == "completed":
        return f"{value} of {row['runs']}"
    values = value if isinstance(value, list) else [] if value in {None, ""} else [value]
    digits = 2 if name == "makespan_ratio" else 1
    return ", ".join(f"{each:.{digits}f}" if isinstance(each, float) else str(each) for each in values) or "-"


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """Return the tables of docs/yardsticks.md, one for each yardstick."""
    lines = []
    for name in dict.fromkeys(row["yardstick"] for row in rows):
        lines += [f"\n### {name}\n", f"{SOURCES[name]}.\n"]
        lines += ["| " + " | ".join(COLUMNS.values()) + " |", "|---" * len(COLUMNS) + "|"]
        own = [row for row in rows if row["yardstick"] == name]
        lines += ["| " + " | ".join(shown(row, column) for column in COLUMNS) + " |" for row in own]
    return "\n".join(lines)


def main() -> None:
    """Fly what is missing, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(YARDSTICKS), help=f"yardsticks, of {', '.join(YARDSTICKS)}")
    parser.add_argument("--runs", type=int, default=0, help="missions of each case (as many as the page has)")
    parser.add_argument("--resends", type=int, default=RESENDS, help="budget of repeats, 0 for none")
    parser.add_argument("--data", type=Path, help="folder with files of others, for lsc and mapf")
    parser.add_argument("--results", type=Path, default=Path("yardsticks.jsonl"), help="file of results")
    parser.add_argument("--jobs", type=int, default=2, help="missions side by side")
    parser.add_argument("--json", action="store_true", help="print JSON alone")
    options = parser.parse_args()
    names = options.only.split(",")
    if unknown := set(names) - YARDSTICKS.keys():
        sys.exit(f"error: --only: {', '.join(sorted(unknown))}: must be of {', '.join(YARDSTICKS)}")
    cases = [case for name in names for case in YARDSTICKS[name](options)]
    jobs = missing(cases, options, read_results(options.results))
    try:
        fly_all(jobs, options)
    except KeyboardInterrupt:
        sys.exit("interrupted: the same command goes on from here")
    results = read_results(options.results)
    rows = [summary(case, list(of_case(case, results, options))) for case in cases]
    print(json.dumps(rows, indent=2) if options.json else markdown(rows))


if __name__ == "__main__":
    main()
