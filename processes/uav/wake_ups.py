"""When the loop of one UAV wakes: for its tick, for the fixes that a head needs, and for the report of its head.

Each wake-up has cold caches and costs several times the work itself, so a UAV wakes as rarely as it can.
"""

from __future__ import annotations

import time

from edc_swarm.mission.configuration import NS_PER_S
from processes.bus.outbox import Outbox
from processes.bus.subscriptions import Item, UavSubscriptions
from processes.runtime.clock import MissionClock
from processes.runtime.inbox import Inbox
from processes.uav.flight import Flight
from processes.uav.publisher import TRUTH_DELAY_S, Publisher

IDLE_S = 1.0
"""Longest wait of the loop while there is no mission."""
RETRY_S = 0.02
"""Longest wait of the loop while messages wait for a router."""
STANDBY_SETTLE_S = 0.01
"""Time in which a standby lets the fixes of a slot's start gather."""
HEAD_SETTLE_S = 20e-6
"""The same for a head, for each UAV of the mission: as long as it takes to read a few fixes of so many."""
READS_COMMAND = 0.7
"""Part of a slot after which a UAV reads its command without the head's report, which comes after all commands."""
CROWD = 100
"""Smallest swarm in which a UAV keeps its truth until it hears its head, or until it reads its command without."""
SPARE_S = 0.005
"""Least time to the next task in which the UAV answers a retransmission request."""


class WakeUps:
    """The waits of one UAV's loop, each until the next item or task.

    Attributes
    ----------
    flight
        The parts that need the mission, None until it has come.
    """

    def __init__(
        self,
        clock: MissionClock,
        inbox: Inbox[Item],
        outbox: Outbox,
        publisher: Publisher,
        subscriptions: UavSubscriptions,
    ) -> None:
        self._clock = clock
        self._inbox = inbox
        self._outbox = outbox
        self._publisher = publisher
        self._subscriptions = subscriptions
        self.flight: Flight | None = None

    @property
    def in_crowd(self) -> bool:
        """True if the fixes of a slot's start take so long that no truth may come between them."""
        return self.flight is not None and len(self.flight.mission.roster) >= CROWD

    def wait(self, peers_ns: int | None) -> list[Item]:
        """Wait for items and return them; none if a task is due first, such as a look at the peers at `peers_ns`."""
        timeout_s = min(self._timeout_s(peers_ns), RETRY_S if self._outbox.holds_back else IDLE_S)
        if self._publisher.delays_truth:
            timeout_s = min(timeout_s, TRUTH_DELAY_S if self._subscriptions.hears_swarm else self._reads_s())
        if self._inbox.quiet_until_s:
            timeout_s = min(timeout_s, self._inbox.quiet_until_s + SPARE_S - time.monotonic())
        if self._outbox.is_asked and timeout_s > SPARE_S:
            self._outbox.answer()
            timeout_s = 0.0
        start_s = time.monotonic()
        items = self._inbox.wait(timeout_s, min(self._settle_s, max(timeout_s, 0.0)))
        self._outbox.note_delay(time.monotonic() - start_s - timeout_s)
        if not items:
            self._publisher.send_truth()
        return items

    def await_report(self, flight: Flight) -> None:
        """Let what comes in wait for the head's report: one wake-up for all of it. Emulated links keep their own times.

        A follower leaves its command, a standby that trusts its head also the fixes of all: its work on them would
        delay the fixes of others, and the head.
        """
        hears = self._subscriptions.hears_swarm and not flight.node.trusts
        if not (hears or flight.postbox.links.has_rules):
            self._inbox.quiet_until_s = time.monotonic() + flight.left_s(READS_COMMAND, self._clock.now_ns())

    def _reads_s(self) -> float:
        """Return the time until the UAV reads its command without a report, at least a moment."""
        return max(TRUTH_DELAY_S, self.flight.left_s(READS_COMMAND, self._clock.now_ns())) if self.flight else IDLE_S

    @property
    def _settle_s(self) -> float:
        """Time in which a UAV that hears all fixes lets them gather; a standby leaves the processor to the head."""
        if self.flight is None or not self._subscriptions.hears_fixes:
            return 0.0
        gathers_s = HEAD_SETTLE_S * len(self.flight.mission.roster)
        return min(STANDBY_SETTLE_S, gathers_s if self.flight.node.leads else STANDBY_SETTLE_S)

    def _timeout_s(self, peers_ns: int | None) -> float:
        """Return the time until the next task, and note when the node is to tick."""
        if self.flight is None:
            return IDLE_S
        now_ns = self._clock.now_ns()
        self.flight.wake_ns = self.flight.node.wakeup_ns(now_ns)
        due_ns = (self.flight.wake_ns, self.flight.postbox.next_ns, peers_ns)
        return (min(when_ns for when_ns in due_ns if when_ns is not None) - now_ns) / NS_PER_S
