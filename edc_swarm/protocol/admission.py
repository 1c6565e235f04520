"""Admission of messages: rejection of every message of a mission that cannot be true.

A message that decodes may still be nonsense: an unknown sender or subject, a time before its slot, a
position that no UAV can have reached, a plan without a quorum. Receivers treat such a message as malformed, like
bytes that do not decode. A certified UAV that sends a plausible false message about itself is outside the
fault model.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import assert_never

import msgspec

from edc_swarm.errors import MessageError, MissionError
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.roles import OPERATOR, ROLES
from edc_swarm.mission.vehicle_budget import grown_r_m
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import NO_ONE, Command, Event, Fix, Goal, Message, MissionMessage, Report, Truth

SLACK_SLOTS = 1000
"""Most slots that a clock may be ahead of the mission's last slot."""
TERMS_PER_SLOT = 2000
"""Most terms in a slot. Receivers reject a higher term, so terms cannot run out."""
REACH_TOLERANCE = 1e-6


class Admission:
    """Admission rules of one mission."""

    def __init__(self, mission: MissionMessage) -> None:
        self._mission = mission
        self._roster = {entry.uav: entry for entry in mission.roster}
        self._ids = frozenset(self._roster)
        self._backing = Backing(mission)
        self._last_slot = mission.max_slots + SLACK_SLOTS
        self._last_term = TERMS_PER_SLOT * (mission.max_slots + SLACK_SLOTS)

    def refusal(self, message: Message) -> str | None:
        """Return the reason why `message` cannot be true, or None."""
        return next(self._reasons(message), None)

    def check(self, key: str, message: Message) -> None:
        """Raise `MessageError` if `refusal` has a reason."""
        reason = self.refusal(message)
        if reason is not None:
            raise MessageError(key, reason)

    def _reasons(self, message: Message) -> Iterator[str]:
        match message:
            case Fix():
                yield from self._of_fix(message)
            case Truth():
                yield from self._of_sender(message.uav, message.slot, message.sent_ns)
            case Command():
                yield from self._unknown([message.uav])
                yield from self._of_sender(message.head, message.slot - 1, message.sent_ns)
                yield from self._of_terms(message.term)
            case Report():
                yield from self._of_report(message)
            case Event():
                yield from self._unknown({message.source} - ROLES)
                if message.sent_ns < self._mission.sent_ns:
                    yield "sent before the mission"
                if message.kind == EventKind.FAULT:
                    yield from self._of_fault(message.detail)
            case Goal():
                yield from self._unknown([message.uav])
                if message.source != OPERATOR and self._mission.goals_from == "operator":
                    yield "goals come from the operator alone"
                if message.sent_ns < self._mission.sent_ns:
                    yield "sent before the mission"
            case MissionMessage():
                return
            case _:
                assert_never(message)

    def _of_sender(self, uav: str, slot: int, sent_ns: int) -> Iterator[str]:
        """Yield reasons against the sender: not in the roster, or its clock says that the slot has not begun."""
        yield from self._unknown([uav])
        if slot > self._last_slot:
            yield f"slot {slot} is after the end of the mission"
        if sent_ns < self._mission.epoch_ns + slot * self._mission.slot_ns:
            yield f"sent before slot {slot} began"

    def _of_terms(self, *terms: int) -> Iterator[str]:
        for term in terms:
            if term > self._last_term:
                yield f"there is no term {term} in a mission of {self._mission.max_slots} slots"

    def _of_fix(self, fix: Fix) -> Iterator[str]:
        yield from self._unknown({fix.uav, fix.head} - {NO_ONE})
        yield from self._of_sender(fix.uav, fix.slot, fix.sent_ns)
        yield from self._of_terms(fix.term)
        entry = self._roster[fix.uav]
        if not fix.course.fits(entry):
            yield "its course is no place in a route of this UAV"
        flown_m = math.hypot(fix.waypoint_x_m - entry.start_x_m, fix.waypoint_y_m - entry.start_y_m)
        if flown_m > self._mission.step_m(entry) * (fix.slot + 1) * (1 + REACH_TOLERANCE) + REACH_TOLERANCE:
            yield f"{flown_m:.6g} m from the start in slot {fix.slot}"
        if not entry.r_m <= fix.r_m <= grown_r_m(self._mission, entry):
            yield f"its disc has {fix.r_m:.6g} m, which that of this UAV cannot have"

    def _of_report(self, report: Report) -> Iterator[str]:
        yield from self._of_sender(report.head, report.slot, report.sent_ns)
        yield from self._of_terms(report.term, report.next_term)
        for uavs in filter(None, report.id_lists):
            named = set(uavs)
            yield from self._unknown(named)
            if len(named) < len(uavs):
                yield "a UAV is named twice"
        yield from self._unknown({report.successor} - {NO_ONE})
        if report.status != "no-quorum" and not self._backing.backs(report):
            yield "a plan or claim without a quorum"
        if len({len(report.hull_uav), *map(len, report.hull_columns)}) > 1:
            yield "its lists of hulls differ in length"

    def _of_fault(self, text: str) -> Iterator[str]:
        try:
            parse_faults(msgspec.structs.replace(self._mission, fault=[text]))
        except MissionError as error:
            yield str(error)

    def _unknown(self, uavs: Collection[str]) -> Iterator[str]:
        if not self._ids.issuperset(uavs):
            for uav in sorted({*uavs} - self._ids):
                yield f"no UAV {uav} in the roster"
