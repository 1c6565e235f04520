"""Virtual time: a clock and a heap of actions, ordered by (time, sequence) and by nothing else."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import count

from edc_swarm.emulation.links import mission_s
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.protocol.messages import MissionMessage


class Schedule:
    """The actions that are still to come, and the time of the one that runs.

    Attributes
    ----------
    now_ns
        True time, in nanoseconds of the Unix epoch.
    """

    def __init__(self, mission: MissionMessage) -> None:
        self._mission = mission
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()
        self.now_ns = mission.epoch_ns

    @property
    def slot(self) -> int:
        """The slot of true time."""
        return (self.now_ns - self._mission.epoch_ns) // self._mission.slot_ns

    @property
    def mission_s(self) -> float:
        """Mission time, in seconds."""
        return mission_s(self.now_ns - self._mission.epoch_ns, self._mission.time_scale)

    def ns_of(self, at_s: float) -> int:
        """Return the true time of mission time `at_s`."""
        return self._mission.epoch_ns + self.duration_ns(at_s)

    def duration_ns(self, for_s: float) -> int:
        """Return the true duration of `for_s` seconds of mission time."""
        return round(for_s * NS_PER_S / self._mission.time_scale)

    def at(self, when_ns: int, action: Callable[[], None]) -> None:
        """Run `action` at `when_ns`, at once if that has passed."""
        heapq.heappush(self._heap, (max(when_ns, self.now_ns), next(self._order), action))

    def run_until(self, end_ns: int) -> None:
        """Run every action up to `end_ns`, each at its time."""
        while self._heap and self._heap[0][0] <= end_ns:
            self.now_ns, _, action = heapq.heappop(self._heap)
            action()
        self.now_ns = end_ns

    def clear(self) -> None:
        """Drop the actions that are left, which tie a swarm, planners and all, into a cycle."""
        self._heap.clear()
