"""The teller of a story: it hears the messages of a mission and tells, slot by slot, what has happened.

Every happening rests on messages that were heard. What messages lack is told as unknown: a silence that sequence
numbers explain by missing fixes, and a hold without the commands that could explain it, lose their names as soon as the
numbers say so.
"""

from __future__ import annotations

import re

from edc_swarm.mission.clusters import cluster_names, cluster_of, of_cluster
from edc_swarm.mission.faults import Freeze, Kill, Restart, read_fault
from edc_swarm.mission.prospect import GIVEN_UP, NOBODY_LEFT, STALLED
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.events import EVENT_FORMS, EventKind
from edc_swarm.protocol.messages import Event, Message, MissionMessage, Report
from edc_swarm.story.fleet import Fleet
from edc_swarm.story.happening import Happening, Kind, Level, State
from edc_swarm.story.heard import Heard, Inbox
from edc_swarm.story.log import Log
from edc_swarm.story.uav import Ended

NO_PLAN_SLOTS = 3
"""Slots in a row without a plan after which no head plans."""
QUIET_SLOTS = 10
"""Slots without a late tick after which an overload is over."""
MANY = 0.1
"""Share of late UAVs from which an overload is a warning."""
ENDS = {
    GIVEN_UP: "out of slots",
    STALLED: "stalled: nothing could change any more",
    NOBODY_LEFT: "no UAV flew any more",
}
"""Reasons for the end of a mission in words, by the detail of the operator's event `end`; others are words already."""
PLAIN = {
    EventKind.PLANNER_FAILED: "the planner failed: ",
    EventKind.GOAL_REFUSED: "goal refused: ",
    EventKind.GOAL_UNANSWERED: "goal unanswered: ",
    EventKind.GROUND_COMMAND: "commanded from the ground: ",
    EventKind.GROUND_REFUSED: "refused to the ground: ",
    EventKind.STRAYED: "strays: ",
    EventKind.GROUNDED: "stays on the ground: ",
    EventKind.AUTOPILOT: "autopilot: ",
    EventKind.CLOCK_JUMP: "the wall clock jumped: ",
    EventKind.RECORDER_DROPPED: "messages that could not be written: ",
    EventKind.RECORDING_FAILED: "the recording failed: ",
    EventKind.FAULT_WITHOUT_TARGET: "a fault without a target: ",
}
"""Events that are told as they are, with the words before their detail."""


class ClusterTeller:
    """The story of one cluster, told into the log of the mission.

    Parameters
    ----------
    mission
        The mission as the cluster flies it.
    log
        The log of all clusters.
    first_slot
        The first slot to tell.
    tells_mission
        True for the cluster that also tells what the operator says.
    """

    def __init__(self, mission: MissionMessage, log: Log, first_slot: int, *, tells_mission: bool) -> None:
        self._mission = mission
        self._log = log
        self._tells_mission = tells_mission
        self._fleet = Fleet(mission, self._log, from_first=first_slot == 0)
        self._inbox = Inbox(self._fleet.uavs.keys(), mission.quorum, first_slot)
        self._plan: Report | None = None
        self._claimed = 0
        self._without_plan = 0
        self._gap: Happening | None = None
        self._overload: Happening | None = None
        self._late_slot = -1
        self._over = False

    @property
    def next_slot(self) -> int:
        """The slot that is to be told next."""
        return self._inbox.next_slot

    @property
    def states(self) -> dict[str, State]:
        """State of every UAV in the slot that was told last."""
        return {name: uav.state for name, uav in self._fleet.uavs.items()}

    @property
    def whys(self) -> dict[str, str]:
        """Return why a UAV is kept where it is, in words, for each UAV that something keeps."""
        return {name: uav.span.detail for name, uav in self._fleet.uavs.items() if uav.span is not None}

    def hear(self, message: Message) -> None:
        """Keep a message until its slot is told."""
        self._inbox.hear(message)

    def close(self, slot: int) -> None:
        """Tell a slot, of which nothing more will be heard."""
        heard = self._inbox.take(slot)
        if not self._over:
            before = self._plan if self._plan is not None and self._plan.slot == slot - 1 else None
            for event in heard.events:
                if event.kind != EventKind.END:
                    self._take_event(event)
            self._take_reports(heard)
            self._fleet.take(heard, before)
            self._take_late_ticks(heard)
            for event in heard.events:
                if event.kind == EventKind.CLOSED and event.source in self._fleet.uavs:
                    self._fleet.close(event)
                if event.kind == EventKind.END:
                    self._take_event(event)

    # --- the mission ---------------------------------------------------------------------------

    def _take_event(self, event: Event) -> None:
        if not self._tells_mission and event.source not in self._fleet.uavs:
            self._take_untold(event)
            return
        time_s = self._sent_s(event) if event.source == OPERATOR else None
        match event.kind:
            case EventKind.FAULT:
                self._log.tell("fault", detail=_shorter(event.detail), level="warning", time_s=time_s)
                self._take_fault(event)
            case EventKind.EXITED:
                name, _, how = event.detail.partition(" ")
                self._fleet.stop(name, Ended("dead", f"its process {how}"))
                self._notice(name, f"{how}, and no fault had asked for it")
            case EventKind.OFF_BUS:
                self._notice(event.detail, "has left the bus: its process, its host or its link")
            case EventKind.BATTERY_EMPTY if event.source in self._fleet.uavs:
                self._fleet.stop(event.source, Ended("silent", "its battery is empty"))
                self._log.tell("battery-empty", [event.source], "the battery is empty", level="warning")
            case EventKind.LANDED if event.source in self._fleet.uavs:
                self._fleet.land(event.source, event.detail)
            case EventKind.END:
                self._log.tell("end", detail=ENDS.get(event.detail, event.detail), time_s=time_s)
                self._over = True
            case kind if kind in PLAIN:
                level: Level = "warning" if EVENT_FORMS[EventKind(kind)].warning else "news"
                who = [event.source] if event.source in self._fleet.uavs else []
                self._log.tell("notice", who, f"{PLAIN[EventKind(kind)]}{event.detail}", level=level)
            case _:
                pass

    def _notice(self, name: str, words: str) -> None:
        """Warn of a process, which is that of a UAV or any other."""
        is_uav = name in self._fleet.uavs
        self._log.tell("notice", [name] if is_uav else [], words if is_uav else f"{name} {words}", level="warning")

    def _take_untold(self, event: Event) -> None:
        """Take what another cluster's teller tells."""
        if event.kind == EventKind.FAULT:
            self._take_fault(event)
        if event.kind == EventKind.EXITED:
            name, _, how = event.detail.partition(" ")
            self._fleet.stop(name, Ended("dead", f"its process {how}"))
        self._over = self._over or event.kind == EventKind.END

    def _take_fault(self, event: Event) -> None:
        fault, at_s = read_fault(event.detail, self._mission.dt_s), self._sent_s(event)
        # The slot of the time, whatever slot the event is told in: a story ends with the last slot that has a fix.
        slot = event.slot if at_s is None else (event.sent_ns - self._mission.epoch_ns) // self._mission.slot_ns
        match fault:
            case Kill(target=uav) | Freeze(target=uav):
                kind: Kind = "dead" if isinstance(fault, Kill) else "frozen"
                how = f"{'killed' if kind == 'dead' else kind}{' mid-step' * fault.mid_step} by a fault in slot {slot}"
                self._fleet.stop(uav, Ended(kind, how, at_s or 0.0, slot, fault.mid_step))
            case Restart(target=uav):
                self._fleet.stop(uav, Ended("dead", f"restarted by a fault in slot {slot}", at_s or 0.0, slot))
            case _:
                pass

    def _take_reports(self, heard: Heard) -> None:
        for claim in heard.claims:
            if claim.term > self._claimed and claim.head in self._fleet.uavs:
                self._claimed = claim.term
                count = len(claim.grants)
                why = "without a head" if self._plan is None else "suspecting the head"
                words = f"claims term {claim.term}: {count} UAV{'s' * (count != 1)} {why}"
                self._log.tell("claim", [claim.head], words, time_s=self._within_slot_s(claim))
        plan = heard.plan
        if plan is None:
            self._miss_plan()
            return
        self._without_plan = 0
        self._end_gap()
        if self._plan is None or plan.term > self._plan.term:
            after = f" after {self._plan.head}" if self._plan is not None and self._plan.head != plan.head else ""
            words = f"leads term {plan.term}{after}, granted by {len(plan.grants)} of {len(self._fleet.uavs)}"
            self._log.tell("term", [plan.head], words, time_s=self._within_slot_s(plan))
        self._plan = plan
        for name in plan.landed:
            self._fleet.land(name, f"out of the airspace, by the report of head {plan.head}")

    def _sent_s(self, message: Event | Report) -> float | None:
        """Return the mission time of sending by the clock of the publisher, None if the message does not say."""
        if not message.sent_ns:
            return None
        return max(0.0, (message.sent_ns - self._mission.epoch_ns) * self._mission.time_scale / 1e9)

    def _within_slot_s(self, report: Report) -> float | None:
        """Return the same in the slot of a report, whatever the clock of its publisher says."""
        sent_s, dt_s = self._sent_s(report), self._mission.dt_s
        return None if sent_s is None else min(max(sent_s, report.slot * dt_s), (report.slot + 1) * dt_s)

    def _miss_plan(self) -> None:
        self._without_plan += 1
        if self._plan is not None and self._without_plan == NO_PLAN_SLOTS:
            since = self._log.slot - NO_PLAN_SLOTS + 1
            cluster = self._mission.roster[0].cluster
            whom = f" for cluster {cluster}" if cluster else ""
            words = f"no head plans{whom} since slot {since}; the last was {self._plan.head}, term {self._plan.term}"
            self._gap = self._log.tell("no-head", detail=words, level="warning", slot=since, lasts=True)

    def _end_gap(self) -> None:
        if self._gap is not None:
            self._gap.last_slot, self._gap = self._log.slot - 1, None

    def _take_late_ticks(self, heard: Heard) -> None:
        plan, limit_ms = heard.plan, 1e3 * (self._mission.dt_s - self._mission.tau_s) / self._mission.time_scale
        late = self._fleet.late
        slow = plan is not None and plan.plan_ms > limit_ms
        if late or slow:
            self._late_slot = self._log.slot
            if self._overload is None:
                words = f"{len(late)} of {len(self._fleet.uavs)} UAVs began the slot late" if late else ""
                if slow and plan is not None:
                    words += (
                        f"{'; ' if late else ''}the plan took {plan.plan_ms:.0f} ms, the limit is {limit_ms:.0f} ms"
                    )
                level: Level = "warning" if slow or len(late) >= MANY * len(self._fleet.uavs) else "detail"
                self._overload = self._log.tell("overload", detail=words, level=level, lasts=True)
        elif self._overload is not None and self._log.slot - self._late_slot >= QUIET_SLOTS:
            self._overload.last_slot, self._overload = self._late_slot, None


class Storyteller:
    """The story of one mission. Call `hear` with every message, and `close` with every slot once it has been heard.

    Attributes
    ----------
    happenings
        All that was told, in order; what lasts is completed when it is over.
    left_out
        Number of happenings beyond the most that are kept.
    """

    def __init__(self, mission: MissionMessage, first_slot: int = 0) -> None:
        self._log = Log(mission.dt_s)
        self._cluster = cluster_of(mission)
        self._tellers = {
            name: ClusterTeller(of_cluster(mission, name), self._log, first_slot, tells_mission=index == 0)
            for index, name in enumerate(cluster_names(mission.roster))
        }

    @property
    def happenings(self) -> list[Happening]:
        """All that was told, in order of telling; what lasts is completed when it is over."""
        return self._log.happenings

    @property
    def left_out(self) -> int:
        """Number of happenings beyond the most that are kept."""
        return self._log.left_out

    @property
    def next_slot(self) -> int:
        """The slot that is to be told next."""
        return next(iter(self._tellers.values())).next_slot

    @property
    def states(self) -> dict[str, State]:
        """State of every UAV, in roster order, in the slot that was told last."""
        of = {name: teller.states for name, teller in self._tellers.items()}
        return {uav: of[name][uav] for uav, name in self._cluster.items()}

    @property
    def whys(self) -> dict[str, str]:
        """Return why a UAV is kept where it is, in words, for each UAV that something keeps."""
        of = {name: teller.whys for name, teller in self._tellers.items()}
        return {uav: of[name][uav] for uav, name in self._cluster.items() if uav in of[name]}

    def hear(self, message: Message) -> None:
        """Keep a message until its slot is told."""
        sender = getattr(message, "head", "") if isinstance(message, Report) else getattr(message, "uav", "")
        if isinstance(message, Event):
            sender = message.source
        if sender in self._cluster:
            self._tellers[self._cluster[sender]].hear(message)
            return
        for teller in self._tellers.values():
            teller.hear(message)

    def close(self, slot: int) -> list[Happening]:
        """Tell a slot, of which nothing more will be heard; return what is told now."""
        self._log.begin(slot)
        for teller in self._tellers.values():
            teller.close(slot)
        return self._log.told


def _shorter(fault: str) -> str:
    """Return the text of a fault with long lists of UAVs cut."""
    return re.sub(r"(?<![\w-])[\w-]++(?:,[\w-]++){6,}+", lambda names: _cut(names[0].split(",")), fault)


def _cut(names: list[str]) -> str:
    return f"{','.join(names[:2])},...({len(names)} UAVs)"
