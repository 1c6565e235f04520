"""Missions with killed heads: the number in which every living UAV gets home, and the reasons in the others.

    python benchmarks/killed_heads.py                          1200 simulated missions of ten UAVs
    python benchmarks/killed_heads.py --seeds 7000-7059 --heads 1 --links none --jobs 2
    python benchmarks/killed_heads.py --failsafe hold          dead UAVs stay obstacles

Each cell has one or two killed heads and one kind of links, and contains the missions of all seeds. A fault kills the
head at (slot + phase) slots. Random(f"killed/{seed}/{heads}") draws `heads` distinct slots of 2 ... 25 by `sample`, in
increasing order, then a phase in [0, 1) for each by `random`. A kill is skipped if there is no head at its time.

The reasons why a living UAV is not home are those of `edc_swarm.protocol.hindrance`: a dead UAV, or the hull where it
can be, covers its target; dead UAVs hold it; they close it in. With the failsafe `land`, the default, dead UAVs leave
the airspace, and these reasons with them. The status is 1 if a living UAV without such a reason is not home, a UAV
lands that no fault has hit, or discs could overlap.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

import numpy as np
from rich.console import Console
from rich.progress import track

from edc_swarm.analysis.living import living_at_end
from edc_swarm.analysis.tracks import Tracks, tracks_of
from edc_swarm.experiments.fuzzing import overlaps
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.hindrance import hindrances, places_of, point
from edc_swarm.protocol.messages import Message, MissionMessage, Report, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation
from processes.experiments.workers import workers

UAVS = 10
MAX_SLOTS = 400
FIRST_SLOT, LAST_SLOT = 2, 25
LINKS: dict[str, list[dict[str, float]]] = {
    "none": [],
    "lossy": [{"loss": 0.05, "jitter_ms": 40.0}],
    "slow": [{"delay_ms": 120.0, "jitter_ms": 50.0}],
}


@dataclass(frozen=True)
class Flight:
    """The outcome of one mission, with a reason for each living UAV that is not home."""

    seed: int
    heads: int
    links: str
    slots: int
    killed: int
    landed: list[str]
    """UAVs that said that they land."""
    away: dict[str, str]
    """Reasons by UAV; "" for a UAV without a reason."""
    broken: list[str]

    @property
    def command(self) -> str:
        """The faults as options of `edc-swarm sim`."""
        return " ".join(f'--fault "{fault}"' for fault in faults(self.seed, self.heads, Mission().dt_s))

    @property
    def failed(self) -> bool:
        """True if a living UAV is not home for no reason, one has landed, or discs could overlap."""
        return "" in self.away.values() or bool(self.landed or self.broken)


def faults(seed: int, heads: int, dt_s: float) -> list[str]:
    """Return the faults that kill the heads of this mission."""
    random = Random(f"killed/{seed}/{heads}")
    slots = sorted(random.sample(range(FIRST_SLOT, LAST_SLOT + 1), heads))
    return [f"kill head @{(slot + random.random()) * dt_s:.3f}s" for slot in slots]


def fly(seed: int, heads: int, links: str, failsafe: str) -> Flight:
    """Simulate one mission and return its outcome."""
    fields = {"seed": seed, "uavs": UAVS, "max_slots": MAX_SLOTS, "link": LINKS[links], "failsafe": failsafe}
    mission = mission_from_dict({**fields, "fault": faults(seed, heads, Mission().dt_s)})
    message = mission_message(complete_mission(mission))
    said: list[Message] = []
    simulation = Simulation(
        message, lambda: make_planner(mission.planner, message), lambda _key, said_now, _ns: said.append(said_now)
    )
    end = simulation.run()
    recording = Recording.from_messages(said)
    tracks = tracks_of(recording)
    living = living_at_end(recording, tracks)
    plans = [report for report in recording.reports if report.has_quorum]
    plan = max(plans, key=lambda report: (report.term, report.slot), default=None)
    away = dict(_away(message, tracks, living, plan))
    landed = [event.source for event in recording.events if event.kind == EventKind.LANDED]
    broken = overlaps(message, end.motions, end.stepped_slot)
    return Flight(seed, heads, links, end.slots, int((~living).sum()), landed, away, broken)


def _away(
    mission: MissionMessage, tracks: Tracks, living: np.ndarray, plan: Report | None
) -> Iterator[tuple[str, str]]:
    """Each living UAV that is not at its target, and why."""
    centre_m, dead = tracks.centre_m[-1], np.flatnonzero(~living & ~tracks.grounded[-1]).tolist()
    places = [place for k in dead for place in places_of(mission.roster[k], point(centre_m[k]), plan)]
    at_m = {entry.uav: point(centre_m[k]) for k, entry in enumerate(mission.roster) if living[k]}
    away = [(e, at_m[e.uav]) for e in mission.roster if e.uav in at_m]
    away = [(e, here_m) for e, here_m in away if math.dist(here_m, (e.target_x_m, e.target_y_m)) > ARRIVED_M]
    found = hindrances(away, places, mission.zone)
    for entry, _ in away:
        yield entry.uav, str(found.get(entry.uav, ""))


def _range(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def _names(text: str) -> list[str]:
    names = text.split(",")
    if unknown := set(names) - set(LINKS):
        raise argparse.ArgumentTypeError(f"{', '.join(sorted(unknown))}: must be of {', '.join(LINKS)}")
    return names


def main() -> int:
    """Run all missions, and print one line per cell and one per UAV that is not home."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=_range, default="7000-7199", help="FIRST-LAST (7000-7199)")
    parser.add_argument("--heads", type=int, choices=(1, 2), help="heads killed (default: one, then two)")
    parser.add_argument("--links", type=_names, default=",".join(LINKS), help=f"of {', '.join(LINKS)} (default: all)")
    parser.add_argument("--failsafe", choices=("land", "hold"), default="land", help="of all missions (land)")
    parser.add_argument("--jobs", type=int, default=1, help="missions that run at the same time (1)")
    options = parser.parse_args()
    heads = (options.heads,) if options.heads else (1, 2)
    work = [(seed, h, link, options.failsafe) for link in options.links for h in heads for seed in options.seeds]
    warm_up(complete_mission(Mission(uavs=UAVS)))
    console = Console(stderr=True)
    with workers(options.jobs) as pool:
        done = pool.map(fly, *zip(*work, strict=True))
        flights = list(track(done, "killed heads", total=len(work), console=console))
    for link in options.links:
        for h in heads:
            _show([flight for flight in flights if (flight.links, flight.heads) == (link, h)])
    lost = [flight for flight in flights if flight.failed]
    print(f"{sum(not flight.away for flight in flights)} of {len(flights)} missions have all living UAVs home")
    print(f"{len(lost)} missions failed: a living UAV is not home for no reason, one landed, or discs could overlap")
    return 1 if lost else 0


def _show(flights: list[Flight]) -> None:
    """Print one cell: the number of missions with all living UAVs home, and the reasons in the others."""
    home = sum(not flight.away for flight in flights)
    slots = sorted(flight.slots for flight in flights)
    dead = dict(sorted(Counter(flight.killed for flight in flights).items()))
    print(
        f"links {flights[0].links}, kills {flights[0].heads}: {home} of {len(flights)} missions have all living UAVs"
        f" home; slots {slots[len(slots) // 2]} median, {slots[-1]} most; missions by UAVs dead: {dead}"
    )
    for flight in flights:
        for uav, reason in flight.away.items():
            why = reason or "FAILURE: its target is free, and nothing holds it"
            print(f"  seed {flight.seed}: {uav} is not home: {why}   ({flight.slots} slots; {flight.command})")
        for uav in flight.landed:
            print(f"  seed {flight.seed}: FAILURE: {uav} landed   ({flight.command})")
        for broken in flight.broken[:2]:
            print(f"  seed {flight.seed}: FAILURE: {broken}   ({flight.command})")


if __name__ == "__main__":
    sys.exit(main())
