"""The simulator: a whole swarm in one process, with virtual time, a seeded faulty network and the very same `UavNode`.

It follows deterministic simulation testing: production code, injected time, a fault vocabulary
(`edc_swarm.mission.faults`), and one seed that replays any run to the byte. A heap ordered by (time, sequence)
(`simulation.schedule`), and nothing else, decides what happens next.

The simulator also sees what a recording cannot: every step that was accepted, also by a UAV that
died or froze before it could publish it (`SimulationEnd.motions`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from random import Random

import msgspec

from edc_swarm.mission.faults import Fault, Restart, parse_faults
from edc_swarm.mission.prospect import COMPLETED, GIVEN_UP, NOBODY_LEFT, STALLED
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.planner.interface import Planner
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.simulation.computers import Computer, Motion, World
from edc_swarm.simulation.faults import Swarm, inject
from edc_swarm.simulation.network import Network, Recorder
from edc_swarm.simulation.schedule import Schedule


@dataclass(frozen=True, slots=True)
class SimulationEnd:
    """The end of a simulated mission, and its reason (one of `edc_swarm.mission.prospect`).

    `stepped_slot` has the slot of each UAV's last accepted step, -1 for none, which no recording tells for certain.
    """

    completed: bool
    reason: str
    slots: int
    motions: list[Motion]
    stepped_slot: dict[str, int]


class Simulation:
    """One mission on a virtual clock.

    Parameters
    ----------
    mission
        As run: with roster, `tau_s` and `max_slots` filled in, `epoch_ns` set.
    make_planner
        Makes a planner for a UAV that may have to lead.
    record
        Receives every message that is published, in order.
    """

    def __init__(self, mission: MissionMessage, make_planner: Callable[[], Planner], record: Recorder) -> None:
        self.mission = mission
        self._faults = parse_faults(mission)
        self._schedule = Schedule(mission)
        self._network = Network(mission, self._schedule, record)
        self._world = World(
            mission,
            self._schedule,
            self._network,
            make_planner,
            Random(f"{mission.seed}/mid-step"),
            _restarts_s(self._faults),
        )
        self._computers = {entry.uav: Computer(entry, self._world) for entry in mission.roster}
        self._network.connect(self._computers)

    @property
    def monitor(self) -> MissionMonitor:
        """Progress of the mission, as the operator follows it."""
        return self._network.monitor

    @property
    def slot(self) -> int:
        """The slot of true time."""
        return self._schedule.slot

    def run(self) -> SimulationEnd:
        """Fly to the end: all there, nobody left, nothing that can change any more, or `max_slots` over."""
        for _ in self.slots():
            pass
        return self.end()

    def slots(self) -> Iterator[int]:
        """Fly, yielding each slot as it is over; ends with the mission."""
        self._begin()
        for slot in range(self.mission.max_slots):
            self._schedule.run_until(self.mission.epoch_ns + (slot + 1) * self.mission.slot_ns - 1)
            yield slot
            if self._reason(slot) != GIVEN_UP:
                break

    def end(self) -> SimulationEnd:
        """Close every publisher and return how the mission ended."""
        reason = self._reason(self.slot)
        for computer in self._computers.values():
            computer.close()
        self._network.publish_event(EventKind.END, reason)
        self._network.publish_event(EventKind.CLOSED, msgspec.json.encode(self._network.last_seqs).decode())
        self._schedule.clear()
        stepped_slot = {uav: computer.disk.airframe.stepped_slot for uav, computer in self._computers.items()}
        return SimulationEnd(reason == COMPLETED, reason, self.slot + 1, self._world.motions, stepped_slot)

    def _reason(self, slot: int) -> str:
        """Return the reason why the mission ends with `slot`: `GIVEN_UP` if it need not."""
        if self.monitor.complete(slot):
            return COMPLETED
        if all(computer.ended for computer in self._computers.values()):
            return NOBODY_LEFT
        return STALLED if self.monitor.stalled(slot) else GIVEN_UP

    def _begin(self) -> None:
        now_ns = self._schedule.now_ns
        self._network.publish_mission(msgspec.structs.replace(self.mission, instance=OPERATOR, sent_ns=now_ns))
        for computer in self._computers.values():
            computer.start()
        swarm = Swarm(self._schedule, self._network, self._computers)
        for fault in self._faults:
            self._schedule.at(self._schedule.ns_of(fault.at_s), partial(inject, swarm, fault))


def _restarts_s(faults: list[Fault]) -> dict[str, list[float]]:
    """Return the times at which faults restart each process."""
    times_s = defaultdict[str, list[float]](list)
    for fault in faults:
        if isinstance(fault, Restart):
            times_s[fault.target].append(fault.at_s)
    return times_s
