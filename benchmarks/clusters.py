"""Several clusters: what they cost against one head, and how far they go.

    python benchmarks/clusters.py --runs 30                    K = 200 in 1 and in 4 clusters, the same missions
    python benchmarks/clusters.py --scale 100 400 1000 2000    K UAVs in K / 100 clusters, 11 slots of 1 s each
    python benchmarks/clusters.py --scale 10000 --slots 4      the same for the largest mission, with one settled slot

Runs are kept in `--out`, so an interrupted one goes on where it stopped. Missions of the first kind are random, of
800 m2 for each UAV, with seeds from 1000. Those of the second kind have a square block of 80 000 m2 for each cluster,
side by side, in which 100 random UAVs have their starts and targets, so that every cluster has up to eight neighbours.

*overlaps*: pairs of discs that can overlap in continuous time, whatever pace each UAV keeps within a slot. *plan*: time
of the planner's thread, of all heads and slots. *fix to command*: on the virtual clock, so without plan times. *heard*:
messages that reach a head in a slot, its own left out; of them *fixes*. *slot*: processor time of the whole simulation
for a slot, mean of those after slot 2; below 1 s the simulation is faster than the mission. *head*: the most of it that
one head took in a slot; real ones are processes.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import statistics
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

from msgspec.structs import replace

from edc_swarm.agent.node import Effect, NodeEvent, Received, UavNode
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.timings import Timing
from edc_swarm.experiments.fuzzing import overlaps, with_braking
from edc_swarm.experiments.statistics import Kind, estimate
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission, random_roster, uav_ids
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.protocol.messages import Fix, Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation import computers
from edc_swarm.simulation.simulator import Simulation
from processes.experiments.timed_planner import TimedPlanner
from processes.experiments.workers import workers

AREA_M2 = 800.0
"""Area for each UAV."""
UAVS, CLUSTERS = 200, (1, 4)
FIRST_SEED = 1000
MOST_SLOTS = 600
SIZE = 100
"""UAVs of a cluster in the second kind of mission."""
SLOTS, SETTLED = 11, 3
"""Slots of a mission of the second kind, unless `--slots` says another number, and those before every cluster has a
head that plans.
"""

COMPARED: tuple[tuple[str, str, Kind], ...] = (
    ("completed", "completed, %", "share of runs"),
    ("arrived", "UAVs at their targets, %", "amount"),
    ("overlaps", "overlaps", "count"),
    ("extra_pct", "extra distance, %", "amount"),
    ("makespan_s", "makespan, s", "amount"),
    ("plan_ms", "plan, median ms", "amount"),
    ("plan_most_ms", "plan, greatest ms", "amount"),
    ("fix_to_command_ms", "fix to command, median ms", "amount"),
    ("messages", "messages per slot", "amount"),
    ("heard", "heard per head and slot", "amount"),
)
SCALED = (
    ("slot_s", "slot, s", ".2f"),
    ("head_s", "head, s", ".3f"),
    ("start_s", "start, s", ".1f"),
    ("memory_mb", "memory, MB", ".0f"),
    ("messages", "messages per slot", ".0f"),
    ("fixes", "fixes heard per head and slot, median", ".0f"),
    ("fixes_most", "most", ".0f"),
)


class CountingNode(UavNode):
    """A node that counts the messages it receives and the processor time it takes, in each slot in which it leads."""

    heard: ClassVar[Counter[tuple[str, int]]] = Counter()
    fixes: ClassVar[Counter[tuple[str, int]]] = Counter()
    used_s: ClassVar[dict[tuple[str, int], float]] = defaultdict(float)

    def step(self, event: NodeEvent, now_ns: int) -> list[Effect]:
        start_s = time.thread_time()
        effects = super().step(event, now_ns)
        if self.leads:
            at = (self.uav, self.slot)
            self.used_s[at] += time.thread_time() - start_s
            self.heard[at] += isinstance(event, Received)
            self.fixes[at] += isinstance(event, Received) and isinstance(event.message, Fix)
        return effects


def count_from_zero() -> None:
    """Let simulations fly nodes that count."""
    CountingNode.heard.clear()
    CountingNode.fixes.clear()
    CountingNode.used_s.clear()
    vars(computers)["UavNode"] = CountingNode


def compare(clusters: int, seed: int) -> dict[str, Any]:
    """Fly a random mission in one or several clusters."""
    drawn = Mission(uavs=UAVS, area_m2=AREA_M2 * UAVS, seed=seed, clusters=clusters, max_slots=MOST_SLOTS)
    mission = mission_message(complete_mission(drawn))
    warm_up(mission)
    said, timings = list[Message](), list[Timing]()
    count_from_zero()
    simulation = Simulation(mission, lambda: TimedPlanner(mission, timings), lambda _key, each, _ns: said.append(each))
    end = simulation.run()
    metrics = compute_metrics(Recording.from_messages(said), timings)
    return {
        "completed": 100.0 * end.completed,
        "arrived": 100.0 * metrics.arrived / UAVS if metrics.arrived is not None else None,
        "slots": end.slots,
        "overlaps": len(overlaps(mission, with_braking(mission, end.motions), end.stepped_slot)),
        "extra_pct": metrics.extra_distance_pct,
        "makespan_s": metrics.makespan_s,
        "plan_ms": statistics.median(timing.plan_ms for timing in timings),
        "plan_most_ms": max(timing.plan_ms for timing in timings),
        "fix_to_command_ms": metrics.fix_to_command_ms.p50,
        "messages": len(said) / end.slots,
        "heard": statistics.mean(CountingNode.heard.values()),
    }


def scale(uavs: int, seed: int, slots: int = SLOTS) -> dict[str, Any]:
    """Fly some slots of a mission whose clusters are blocks side by side."""
    mission = blocks(uavs, seed, slots)
    warm_up(mission)
    messages, slot_s = Counter[int](), list[float]()
    begun_s = time.process_time()
    count_from_zero()

    def count(_key: str, _message: Message, _ns: int) -> None:
        messages[simulation.slot] += 1

    simulation = Simulation(mission, lambda: make_planner(mission.planner, mission), count)
    start_s = time.process_time() - begun_s
    now_s = time.process_time()
    for _ in simulation.slots():
        before_s, now_s = now_s, time.process_time()
        slot_s.append(now_s - before_s)
    fixes = [found for (_, slot), found in CountingNode.fixes.items() if slot >= SETTLED]
    by_slot_s = [used_s for (_, slot), used_s in CountingNode.used_s.items() if slot >= SETTLED]
    return {
        "slot_s": statistics.mean(slot_s[SETTLED:]),
        "head_s": max(by_slot_s),
        "start_s": start_s + sum(slot_s[:SETTLED]),
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "messages": statistics.median(messages[slot] for slot in range(SETTLED, len(slot_s))),
        "fixes": statistics.median(fixes),
        "fixes_most": max(fixes),
        "slots": len(slot_s),
    }


def blocks(uavs: int, seed: int, slots: int = SLOTS) -> MissionMessage:
    """Return a mission of `uavs` in blocks of `SIZE`, each a cluster of its own."""
    count = uavs // SIZE
    columns = math.ceil(math.sqrt(count))
    block = Mission(uavs=SIZE, area_m2=AREA_M2 * SIZE)
    side_m = math.sqrt(block.area_m2) + 2 * block.r_m
    roster = list[RosterEntry]()
    for number in range(count):
        x_m, y_m = side_m * (number % columns), side_m * (number // columns)
        roster += [
            replace(
                entry,
                start_x_m=entry.start_x_m + x_m,
                start_y_m=entry.start_y_m + y_m,
                target_x_m=entry.target_x_m + x_m,
                target_y_m=entry.target_y_m + y_m,
                cluster=f"c{number + 1}" if count > 1 else "",
            )
            for entry in random_roster(replace(block, seed=seed + number))
        ]
    roster = [replace(entry, uav=uav) for entry, uav in zip(roster, uav_ids(uavs), strict=True)]
    drawn = Mission(uavs=uavs, seed=seed, roster=roster, fence="none", dt_s=1.0, max_slots=slots)
    return mission_message(complete_mission(drawn))


def read(path: Path) -> dict[tuple[str, int, int], dict[str, Any]]:
    """Return what is measured so far, by kind, size and seed."""
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text().splitlines() if line.endswith("}")]
    return {(row["kind"], row["size"], row["seed"]): row["measured"] for row in rows}


def fly(runs: Sequence[tuple[str, int, int]], path: Path, slots: int) -> None:
    """Fly the runs that are missing, each in a process of its own, whose memory is that of the run."""
    missing = [run for run in runs if run not in read(path)]
    with path.open("a") as stream:
        for done, (kind, size, seed) in enumerate(missing):
            print(f"run {done + 1} of {len(missing)}: {kind} {size}, seed {seed}", flush=True)
            with workers(1) as pool:
                what = (compare, size, seed) if kind == "compare" else (scale, size, seed, slots)
                measured = pool.submit(*what).result()
            row = {"kind": kind, "size": size, "seed": seed, "measured": measured}
            stream.write(json.dumps(row) + "\n")
            stream.flush()


def compared(measured: dict[tuple[str, int, int], dict[str, Any]]) -> Iterator[str]:
    """Yield the table of the first kind of mission, of the seeds that were flown in both ways."""
    seeds = set.intersection(
        *({seed for kind, size, seed in measured if (kind, size) == ("compare", each)} for each in CLUSTERS)
    )
    yield f"| K = {UAVS} | runs | " + " | ".join(title for _, title, _ in COMPARED) + " |"
    yield "|---" * (2 + len(COMPARED)) + "|"
    for clusters in CLUSTERS:
        runs = [measured["compare", clusters, seed] for seed in sorted(seeds)]
        cells = []
        for name, _, kind in COMPARED:
            values = [row[name] for row in runs if row[name] is not None]
            found = estimate(values, kind) if values else None
            span = f" ({found.low:.3g}-{found.high:.3g})" if found and found.low is not None else ""
            cells.append(f"{found.mean:.3g}{span}" if found else "-")
        yield f"| {clusters} cluster{'s' * (clusters > 1)} | {len(runs)} | " + " | ".join(cells) + " |"


def scaled(measured: dict[tuple[str, int, int], dict[str, Any]]) -> Iterator[str]:
    """Yield the table of the second kind of mission; of several runs it has the median."""
    yield "| K | clusters | " + " | ".join(title for _, title, _ in SCALED) + " |"
    yield "|---" * (2 + len(SCALED)) + "|"
    for uavs in sorted({size for kind, size, _ in measured if kind == "scale"}):
        runs = [row for (kind, size, _), row in measured.items() if (kind, size) == ("scale", uavs)]
        cells = [format(statistics.median(row[name] for row in runs), form) for name, _, form in SCALED]
        yield f"| {uavs} | {uavs // SIZE} | " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--scale", type=int, nargs="+", metavar="K", help="multiples of 100; fly the second kind")
    parser.add_argument("--out", type=Path, default=Path("clusters.jsonl"))
    parser.add_argument("--slots", type=int, default=SLOTS, help="slots of the second kind")
    options = parser.parse_args()
    kind, sizes = ("scale", options.scale) if options.scale else ("compare", CLUSTERS)
    if any(uavs < SIZE or uavs % SIZE for uavs in options.scale or ()):
        parser.error(f"argument --scale: multiples of {SIZE}")
    if options.slots <= SETTLED:
        parser.error(f"argument --slots: above {SETTLED}")
    seeds = range(FIRST_SEED, FIRST_SEED + options.runs)
    fly([(kind, size, seed) for seed in seeds for size in sizes], options.out, options.slots)
    print("\n".join((scaled if kind == "scale" else compared)(read(options.out))))


if __name__ == "__main__":
    main()
