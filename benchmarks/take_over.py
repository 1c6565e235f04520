"""Take-over: the effort of a new head's first plan, in priced steps, and what a swarm loses to it.

    python benchmarks/take_over.py                       50 UAVs on 40 000 m2, 20 seeds
    python benchmarks/take_over.py --uavs 30 --seeds 0-9 --slots 8

The head is killed in simulated missions. The same missions are flown with three kinds of planners:

- warm: all UAVs share one planner, so a new head knows all that the dead one knew;
- cold: each has its own, and a first plan has the whole budget of a slot;
- edc: each has its own, and the first plan of a new head has `Tuning.first_share` of the budget.

Priced steps do not depend on the machine. "of the median" compares a first plan with the median of all plans of its
mission. Extra distance is that of all living UAVs against straight lines; differences are those to `warm`, mean and
standard error over the missions.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.edc import Edc
from edc_swarm.planner.guidance import Tuning
from edc_swarm.planner.interface import Plan, Planner, PlanRequest, stopped
from edc_swarm.planner.registry import warm_up
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation
from processes.experiments.workers import workers

KINDS = ("warm", "cold", "edc")
AREA_M2 = 800.0
"""Area for each UAV, the density of 50 UAVs on 40 000 m2."""


@dataclass(frozen=True)
class Flight:
    """One mission: the priced steps of the new head's first plan and the median of all, and how the mission went."""

    first: int
    median: float
    slots: int
    extra_pct: float | None
    completed: bool


class Counted:
    """A UAV's planner that notes the priced steps of each plan, by UAV."""

    def __init__(self, planner: Edc, log: list[tuple[int, int]], number: int) -> None:
        self._planner, self._log, self._number = planner, log, number

    def plan(self, request: PlanRequest) -> Plan:
        """Return the planner's plan."""
        plan = self._planner.plan(request)
        self._log.append((self._number, self._planner.priced_steps))
        return plan


def fly(kind: str, uavs: int, seed: int, slot: int) -> Flight | None:
    """Fly one mission whose head is killed in `slot`; return None if no new head took over."""
    fields = {"uavs": uavs, "area_m2": AREA_M2 * uavs, "seed": seed, "fault": [f"kill head @{slot}"]}
    message = mission_message(complete_mission(mission_from_dict(fields)))
    log: list[tuple[int, int]] = []
    said: list[Message] = []
    end = Simulation(message, _maker(kind, message, log), lambda _key, said_now, _ns: said.append(said_now)).run()
    change = next((n for n in range(1, len(log)) if log[n][0] != log[n - 1][0]), None)
    if change is None:
        return None
    extra_pct = compute_metrics(Recording.from_messages(said)).extra_distance_pct
    return Flight(log[change][1], statistics.median(steps for _, steps in log), end.slots, extra_pct, end.completed)


def _maker(kind: str, mission: MissionMessage, log: list[tuple[int, int]]) -> Callable[[], Planner]:
    """Return what makes the planner of each UAV that may lead."""
    tuning = Tuning(first_share=1.0) if kind == "cold" else None
    shared = Edc(mission, stopped, tuning)
    made = iter(range(10**9))
    return lambda: Counted(shared if kind == "warm" else Edc(mission, stopped, tuning), log, next(made))


def _shown(differences: list[float], form: str) -> str:
    if len(differences) < 2:
        return "-"
    error = statistics.stdev(differences) / len(differences) ** 0.5
    return f"{statistics.mean(differences):{form}} +- {error:.2f}"


def _range(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def main() -> None:
    """Fly all missions with each kind of planner, and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uavs", type=int, default=50)
    parser.add_argument("--seeds", type=_range, default="0-19", help="FIRST-LAST (0-19)")
    parser.add_argument("--slots", type=int, nargs="+", default=[12], help="in which the head is killed (12)")
    parser.add_argument("--jobs", type=int, default=1, help="missions that run at the same time (1)")
    options = parser.parse_args()
    warm_up(complete_mission(Mission(uavs=2)))
    cases = list(product([options.uavs], options.seeds, options.slots))
    work = [(kind, *case) for kind in KINDS for case in cases]
    with workers(options.jobs) as pool:
        done = dict(zip(work, pool.map(fly, *zip(*work, strict=True)), strict=True))
    print("planner  missions  first plan, steps (most)  of the median (most)  extra distance, %  slots")
    for kind in KINDS:
        pairs = [(now, warm) for case in cases if (now := done[kind, *case]) and (warm := done["warm", *case])]
        first = [now.first for now, _ in pairs]
        ratio = [now.first / now.median for now, _ in pairs]
        extra = [a.extra_pct - b.extra_pct for a, b in pairs if a.extra_pct is not None and b.extra_pct is not None]
        print(
            f"{kind:7}  {sum(now.completed for now, _ in pairs):3} of {len(pairs):3}"
            f"  {statistics.median(first):9.0f} ({max(first)})  {statistics.median(ratio):.2f} ({max(ratio):.2f})"
            f"  {_shown(extra, '+.2f')}  {_shown([float(a.slots - b.slots) for a, b in pairs], '+.1f')}"
        )


if __name__ == "__main__":
    main()
