"""Knowledge that one UAV has of the others: the newest fix of each, and the hulls that reports relay.

Rules kept here (named as in ARCHITECTURE.md):

- *heard*: a fix counts for a slot only if it is a fix of that slot and carries the right grant;
- *newest*: fixes are ordered by (slot, term), so late, duplicated or reordered ones change nothing;
- *no fix from the future*: a fix of a slot that has not begun here waits until the slot begins;
- *hull*: all places where an unheard UAV can be, for the head of one term that plans one slot;
- *landed*: a UAV whose failsafe has taken it out of the airspace has no hull;
- *lost memory*: the fix of a UAV that lost its promise does not tell its position;
- *stray*: a UAV whose vehicle does not follow its commands is unheard, and its hull grows until it says that it is on
  the ground.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import TypeVar

from msgspec import UNSET

from edc_swarm.mission.braking import Point, reach_m, rest_point
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.planner.interface import Hull
from edc_swarm.protocol.messages import Command, Fix, Report

Key = TypeVar("Key")
Grant = tuple[int, str]
"""(term, head): a UAV's promise to obey one head in one term; (0, "") stands for no promise."""
ABSENT_SLOTS = 3
"""The head does not wait for a UAV that it has not heard for more slots than this."""


class Knowledge:
    """Newest fix of every UAV heard, and newest relayed hull of the others."""

    def __init__(
        self, roster: Sequence[RosterEntry] | Mapping[str, RosterEntry], index: Mapping[str, int] | None = None
    ) -> None:
        """Take the UAVs to know, and the roster index of each where they are not the whole roster."""
        self._roster = roster if isinstance(roster, Mapping) else {entry.uav: entry for entry in roster}
        self.index = index or {uav: index for index, uav in enumerate(self._roster)}
        self.roster = self._roster.keys()
        self.newest: dict[str, Fix] = {}
        self._granting: Counter[tuple[int, int, str]] = Counter()
        self._suspecting: Counter[tuple[int, int]] = Counter()
        self._early: dict[str, Fix] = {}
        self._relayed: dict[str, tuple[int, int, Hull]] = {}
        self._free_from: dict[str, int] = {}
        self._strays: dict[str, tuple[int, Hull]] = {}
        self.straying: Set[str] = self._strays.keys()

    def hear_fix(self, fix: Fix, slot: int) -> None:
        """Keep a fix if it is the newest of its UAV; `slot` is the receiver's current slot."""
        if fix.uav not in self._roster or not fix.voter:
            self._hear_stray(fix)
            return
        table = self._early if fix.slot > slot else self.newest
        known = table.get(fix.uav)
        if known is not None and _age(fix, known) <= 0:
            return
        table[fix.uav] = fix
        if table is self.newest:
            self._count(known, -1)
            self._count(fix, 1)

    def _hear_stray(self, fix: Fix) -> None:
        """Keep where a UAV is by the end of the slot of its fix, if it strays; or that it is on the ground for good."""
        if fix.uav not in self._roster or fix.stray_m is UNSET:
            return
        if fix.on_ground is True:
            self._free_from.setdefault(fix.uav, fix.slot)
        self._note_stray(fix.uav, fix.slot, self._place(fix.uav, fix.x_m, fix.y_m, fix.x_m, fix.y_m, fix.stray_m))

    def _note_stray(self, uav: str, slot: int, place: Hull) -> None:
        known = self._strays.get(uav)
        if known is None or slot > known[0]:
            self._strays[uav] = slot, place

    def strays(self, uav: str) -> bool:
        """Return True if `uav` does not follow its commands."""
        return uav in self._strays

    def is_on_ground(self, uav: str, slot: int) -> bool:
        """Return True if a UAV that strays has said that it is on the ground; it may fly for any time before."""
        return uav in self._free_from and slot >= self._free_from[uav]

    def stray_hull(self, uav: str, slot: int, free_m: float) -> Hull:
        """Return where a UAV that strays can be at the end of `slot`, if it flies at most `free_m` in a slot."""
        of_slot, place = self._strays[uav]
        return _grown(place, free_m * max(0, slot - of_slot))

    def _count(self, fix: Fix | None, by: int) -> None:
        if fix is not None:
            _add(self._granting, (fix.slot, fix.term, fix.head), by)
            if fix.suspects:
                _add(self._suspecting, (fix.slot, fix.term), by)

    def hear_report(self, report: Report) -> None:
        """Keep the hulls of a report: of the UAVs that its head did not hear, and of the head itself.

        A UAV that the report gives as landed has left the airspace for good: what proves it holds in every term.
        """
        for uav in report.landed:
            self._free_from[uav] = min(report.slot + 1, self._free_from.get(uav, report.slot + 1))
        age = report.slot, report.term
        strays = set() if report.strays is UNSET else set(report.strays) & self.roster
        for uav, *shape in zip(report.hull_uav, *report.hull_columns, strict=False):
            known = self._relayed.get(uav)
            if uav in self._roster and (known is None or age > known[:2]):
                self._relayed[uav] = (*age, self._place(uav, *shape))
            if uav in strays:
                self._note_stray(uav, report.slot + 1, self._place(uav, *shape))

    def begin_slot(self, slot: int) -> list[str]:
        """Process the fixes that came too early, now that `slot` has begun; return the ids of their UAVs."""
        due = [fix for fix in self._early.values() if fix.slot <= slot]
        for fix in due:
            del self._early[fix.uav]
            self.hear_fix(fix, slot)
        return [fix.uav for fix in due]

    def heard(self, slot: int, grant: Grant) -> list[str]:
        """Return the ids, in roster order, of the UAVs with a fix of `slot` that carries `grant`."""
        return [
            uav
            for uav in self._roster
            if (fix := self.newest.get(uav)) is not None and fix.slot == slot and (fix.term, fix.head) == grant
        ]

    def count_heard(self, slot: int, grant: Grant) -> int:
        """Return the length of `heard` without making the list."""
        return self._granting.get((slot, *grant), 0)

    def recent(self, since_slot: int) -> Iterator[Fix]:
        """Yield the newest fixes, in roster order, that are not older than `since_slot`."""
        if len(self.newest) == 1:  # A UAV that hears no fixes has its own one alone.
            yield from (fix for fix in self.newest.values() if fix.slot >= since_slot)
            return
        for uav in self._roster:
            fix = self.newest.get(uav)
            if fix is not None and fix.slot >= since_slot:
                yield fix

    def count_granting(self, grant: Grant, since_slot: int, besides: str) -> int:
        """Return the number of recent fixes that carry `grant`, without those of UAV `besides`."""
        return sum((fix.term, fix.head) == grant for fix in self.recent(since_slot) if fix.uav != besides)

    def suspecting(self, since_slot: int, term: int, besides: str) -> list[str]:
        """Return the ids, without `besides`, whose recent fix of at most `term` says that they suspect their head."""
        recent = self.recent(since_slot)
        return [fix.uav for fix in recent if fix.suspects and fix.uav != besides and fix.term <= term]

    def count_suspecting(self, since_slot: int, term: int, besides: str) -> int:
        """Return the length of `suspecting` without making the list."""
        own = self.newest.get(besides)
        own_counts = own is not None and own.suspects and own.slot >= since_slot and own.term <= term
        counts = self._suspecting.items()
        return sum(count for (slot, of), count in counts if slot >= since_slot and of <= term) - own_counts

    def last_slot(self, uav: str) -> int:
        """Return the slot of the newest fix of `uav`, -1 if there is none."""
        fix = self.newest.get(uav)
        return -1 if fix is None else fix.slot

    def hull(self, uav: str, grant: Grant, t0: int, sent: Mapping[str, Command], rules: HullRules) -> Hull:
        """Return the hull of unheard `uav`: all places where it can be in any slot that the head of `grant` plans.

        (a) Its newest fix carries `grant`: the segment of the command sent for the slot after that fix, else its
            waypoint. `sent` has the last command of this term to each UAV.
        (b) Otherwise: the place x known for the end of slot s, grown by u_max * max(0, t0 + 1 - s), where u_max is the
            longest step of this UAV. The head had its first quorum of the term in slot `t0`; no older plan exists for
            a slot after t0 + 1, so growth ends there.

        All of these contain the braking paths: in (a) that of the fix's step and that of the command, in (b) that of
        the fix's step, or after growth that of the fastest step (`reach_m`).
        """
        fix = self.newest.get(uav)
        if fix is not None and (fix.term, fix.head) == grant:
            return self._after_own_command(fix, sent.get(uav), rules)
        return min(self._grown_places(uav, grant[0], t0, rules), key=lambda hull: hull.radius_m)

    def place_after(self, uav: str, slot: int, rules: HullRules, r_m: float) -> Hull:
        """Return where a UAV of another cluster is at the end of `slot` and while it brakes; `r_m` is its widest disc.

        Any head of its cluster may have moved it, by one step in a slot, since what is known: since its newest fix,
        since the slot of the newest report with a hull of it, or since it began.
        """
        fix, relayed, entry = self.newest.get(uav), self._relayed.get(uav), self._roster[uav]
        places = list[tuple[float, Hull]]()
        if fix is not None:
            slots = slot - fix.slot
            reach_m = rules.reach_m(uav, slots, math.dist(*_last_step(fix)))
            places.append((reach_m, self._about(fix, rules, brakes=slots <= 0)))
        if relayed is not None:
            by_m = rules.reach_m(uav, slot - relayed[0], rules.u_max_m[uav])
            places.append((relayed[2].radius_m + by_m, relayed[2]))
        if not places:
            start_m = entry.start_x_m, entry.start_y_m
            places.append((rules.reach_m(uav, slot + 1, 0.0), self._place(uav, *start_m, *start_m)))
        radius_m, place = min(places, key=itemgetter(0))
        return Hull(place.uav, place.ax_m, place.ay_m, place.bx_m, place.by_m, radius_m, r_m)

    def last_step(self, uav: str, grant: Grant, t0: int, sent: Mapping[str, Command]) -> int:
        """Return a slot after which unheard `uav` has accepted no step in the slots that `grant` and older terms plan.

        (a) Its newest fix carries `grant`: the slot of the command sent for the slot after that fix, else of the fix.
        (b) Otherwise: the slot of the fix, or t0 + 1 if that is later and the fix carries an older term.
        """
        fix = self.newest.get(uav)
        if fix is None:
            return t0 + 1
        if (fix.term, fix.head) == grant:
            command = sent.get(uav)
            return max(fix.slot, command.slot if command is not None else -1)
        return max(fix.slot, t0 + 1)

    def has_landed(self, uav: str, slot: int, free_slot: int) -> bool:
        """Return True if `uav` is out of the airspace before `slot` begins; the own evidence says: from `free_slot`."""
        if slot >= free_slot:
            self._free_from.setdefault(uav, free_slot)
        return slot >= self._free_from.get(uav, free_slot)

    def _grown_places(self, uav: str, term: int, t0: int, rules: HullRules) -> Iterator[Hull]:
        """Yield hulls (b) of `uav`: by its fix, by a head's report, else by the roster.

        A report of slot s from the term just before `term` holds for the end of slot s + 1 too. No term lies between,
        and in slot s its head sent no command to the unheard UAVs; to itself it sent the step that its hull covers.
        """
        fix, relayed, entry = self.newest.get(uav), self._relayed.get(uav), self._roster[uav]
        if fix is not None:
            slots = t0 + 1 - fix.slot
            place = self._about(fix, rules, brakes=slots <= 0)
            yield _grown(place, rules.reach_m(uav, slots, math.dist(*_last_step(fix))))
        if relayed is not None:
            slot, of_term, place = relayed
            slots = t0 + 1 - slot - (of_term + 1 == term)
            yield _grown(place, rules.reach_m(uav, slots, rules.u_max_m[uav]))
        if fix is None and relayed is None:
            place = self._place(uav, entry.start_x_m, entry.start_y_m, entry.start_x_m, entry.start_y_m)
            yield _grown(place, rules.reach_m(uav, t0 + 2, 0.0))

    def _about(self, fix: Fix, rules: HullRules, *, brakes: bool = True) -> Hull:
        """Return the waypoint of a fix, with the braking path if it `brakes`.

        With lag it is also the segment to the waypoint, which the UAV may still fly.
        """
        from_m, to_m = _last_step(fix)
        end_m = rest_point(from_m, to_m, rules.change_of(fix.uav)) if brakes else to_m
        return self._place(fix.uav, *(from_m if rules.lag_slots else to_m), *end_m)

    def _after_own_command(self, fix: Fix, command: Command | None, rules: HullRules) -> Hull:
        """Return hull (a): the segment of the command sent for the slot after the fix, else the waypoint.

        Both with their braking paths; the UAV may or may not have heard the command.
        """
        about = self._about(fix, rules)
        if command is None or command.slot != fix.slot + 1:
            return about
        change_m, (_, here_m) = rules.change_of(fix.uav), _last_step(fix)
        stop_m = rest_point(here_m, (command.target_x_m, command.target_y_m), change_m)
        heard, rest_m = replace(about, bx_m=stop_m[0], by_m=stop_m[1]), (about.bx_m, about.by_m)
        heard = _grown(heard, max(_distance_to_segment_m(*point_m, heard) for point_m in (here_m, rest_m)))
        unheard = _grown(about, _distance_to_segment_m(*stop_m, about))
        # A UAV that stops at once has no braking path; of two braking paths the longer one is the better axis.
        return unheard if rest_m != here_m and unheard.radius_m < heard.radius_m else heard

    def _place(self, uav: str, ax_m: float, ay_m: float, bx_m: float, by_m: float, radius_m: float = 0.0) -> Hull:
        fix = self.newest.get(uav)
        r_m = self._roster[uav].r_m if fix is None else fix.r_m
        return Hull(self.index[uav], ax_m, ay_m, bx_m, by_m, radius_m, r_m)


@dataclass(frozen=True, slots=True)
class HullRules:
    """Constants of the mission that hulls depend on: the longest step of each UAV, the lag, and the step changes.

    `change_m` has the UAVs that cannot stop at once.
    """

    u_max_m: Mapping[str, float]
    lag_slots: int
    change_m: Mapping[str, float] = field(default_factory=dict)

    def change_of(self, uav: str) -> float:
        """Return the largest change of consecutive steps of `uav`, in metres."""
        return self.change_m.get(uav, math.inf)

    def reach_m(self, uav: str, slots: int, length_m: float) -> float:
        """Return the greatest distance that `uav` flies in `slots` slots and while it brakes after them."""
        return reach_m(length_m, slots, self.u_max_m[uav], self.change_of(uav))


def _last_step(fix: Fix) -> tuple[Point, Point]:
    """Return start and end of the step that the UAV flies in the slot of its fix."""
    return (fix.from_x_m, fix.from_y_m), (fix.waypoint_x_m, fix.waypoint_y_m)


def _add(counts: Counter[Key], key: Key, by: int) -> None:
    """Add to a count, and forget one that is 0."""
    counts[key] += by
    if counts[key] <= 0:
        del counts[key]


def _grown(hull: Hull, by_m: float) -> Hull:
    """Return the hull with a larger radius."""
    return replace(hull, radius_m=hull.radius_m + by_m)


def _distance_to_segment_m(x_m: float, y_m: float, path: Hull) -> float:
    dx_m, dy_m = path.bx_m - path.ax_m, path.by_m - path.ay_m
    length2 = dx_m * dx_m + dy_m * dy_m
    along = ((x_m - path.ax_m) * dx_m + (y_m - path.ay_m) * dy_m) / length2 if length2 > 0 else 0.0
    along = min(1.0, max(0.0, along))
    return math.hypot(x_m - path.ax_m - along * dx_m, y_m - path.ay_m - along * dy_m)


def _age(fix: Fix, known: Fix) -> int:
    """Return a positive number if `fix` is newer than `known`: by slot, then term, then sequence number.

    No two instances of a UAV send in one slot and term: the second begins with the promise that the first wrote.
    """
    left, right = (fix.slot, fix.term), (known.slot, known.term)
    if left == right:
        return fix.seq - known.seq if fix.instance == known.instance else 0
    return 1 if left > right else -1
