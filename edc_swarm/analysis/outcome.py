"""The outcome of a mission: the UAVs at their targets at the end, and the reason for each other UAV.

A UAV is *home* if the recording shows that the centre of its disc is at its target at the end. Every other UAV of
the roster has one cause, the first in `Cause` that applies. Missing evidence is a cause of its own; nothing is
guessed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.analysis.living import SILENT_SLOTS, living_at_end
from edc_swarm.analysis.tracks import Tracks, tracks_of
from edc_swarm.analysis.voyages import Voyages, voyages_of
from edc_swarm.mission.clusters import cluster_of
from edc_swarm.mission.faults import Freeze, Kill, read_fault
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.completion import STILL_SLOTS
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.hindrance import Place, hindrances, places_of, point
from edc_swarm.protocol.messages import Event, Report
from edc_swarm.recording.model import Recording
from edc_swarm.recording.sequences import find_gaps

Bools = NDArray[np.bool_]
_PLAN_ORDER = attrgetter("term", "slot")

STUCK_SLOTS = 20
"""A UAV is stuck if it has come no nearer to its target for this many slots."""
ENDS = {
    "completed": "the mission was ended before it had arrived",
    "max_slots": "ran out of slots",
    "interrupted": "the mission was interrupted",
    "failed": "the mission was broken off",
    "stalled": "stopped, since nothing could change any more",
    "nobody-left": "no UAV flew any more",
}
"""Reason for a UAV that was still under way, by the detail of the operator's event `end`."""

Cause = Literal[
    "killed",
    "frozen",
    "process-gone",
    "battery-empty",
    "landed",
    "strayed",
    "grounded",
    "memory-lost",
    "never-heard",
    "record-incomplete",
    "silent",
    "target-covered",
    "beside",
    "not-commanded",
    "commands-not-flown",
    "held",
    "closed-in",
    "blocked",
    "mission-ended",
]


CAUSES: dict[str, Cause] = {"held": "held", "closed in": "closed-in"}
"""Cause by what hinders a UAV from its target, which is free."""


class NotHome(Struct, frozen=True):
    """A UAV that is not at its target, or of which the record does not tell that it is, with the reason.

    Attributes
    ----------
    reason
        The cause in words, with slot and obstacle.
    slot
        First slot in which the cause applies, None if no slot applies.
    by
        The UAV that is in the way, "" if there is none.
    away_m
        Distance from the target to the last known centre of the disc, None for a UAV never heard.
    """

    uav: str
    cause: Cause
    reason: str
    slot: int | None = None
    by: str = ""
    away_m: float | None = None

    @property
    def is_unknown(self) -> bool:
        """True if the record does not tell whether it is at its target."""
        return self.cause in {"never-heard", "record-incomplete"}

    def __str__(self) -> str:
        """Return one line with the UAV, the reason and the distance to its target."""
        away = "" if self.away_m is None else f", {self.away_m:.2f} m from its target"
        return f"{self.uav}: {self.reason}{away}"


def not_home_of(recording: Recording) -> list[NotHome]:
    """Return every UAV of the roster that is not home, with the reason."""
    tracks = tracks_of(recording)
    return not_home(recording, tracks, living_at_end(recording, tracks))


def home_at_end(recording: Recording, tracks: Tracks) -> Bools:
    """Return (K,) flags: True if the recording shows the UAV at its target at the end."""
    heard = tracks.heard.any(axis=0) | tracks.executed.any(axis=0)
    voyages = voyages_of(recording, tracks)
    home: Bools = heard & (_away_m(voyages, tracks) <= ARRIVED_M) & ~voyages.pending[-1]
    return home


def not_home(recording: Recording, tracks: Tracks, living: Bools) -> list[NotHome]:
    """Return every UAV of the roster that is not home, with the reason; `living` as `living_at_end` gives it.

    In a lifelong mission a UAV that lives is never home, and none is named.
    """
    home = home_at_end(recording, tracks)
    if home.all():
        return []
    judge = _Judge.of(recording, tracks, living, home)
    missing = ~home if recording.mission.goals == "once" else ~home & ~living
    return [judge.reason(k) for k in np.flatnonzero(missing).tolist()]


def _away_m(voyages: Voyages, tracks: Tracks) -> NDArray[np.float64]:
    away_m: NDArray[np.float64] = np.hypot(*(tracks.centre_m[-1] - voyages.target_m).T)
    return away_m


@dataclass(frozen=True, slots=True)
class _Judge:
    """A recording with the state of all UAVs at its end.

    Attributes
    ----------
    newest
        (K,) last slot with a fix of each UAV, -1 for none.
    incomplete
        UAVs with fixes that are missing from the recording.
    plans
        The newest plan of each cluster.
    """

    recording: Recording
    tracks: Tracks
    living: Bools
    home: Bools
    newest: NDArray[np.int64]
    incomplete: frozenset[str]
    plans: Mapping[str, Report]
    end: Event | None
    voyages: Voyages

    @classmethod
    def of(cls, recording: Recording, tracks: Tracks, living: Bools, home: Bools) -> _Judge:
        """Collect the state of all UAVs at the end."""
        slots = np.arange(tracks.slots)[:, None]
        backing = Backing(recording.mission)
        clusters = cluster_of(recording.mission)
        plans = sorted((report for report in recording.reports if backing.is_plan(report)), key=_PLAN_ORDER)
        return cls(
            recording,
            tracks,
            living,
            home,
            newest=np.max(np.where(tracks.heard, slots, -1), axis=0, initial=-1),
            incomplete=frozenset(
                gap.key.split("/")[1]
                for gap in find_gaps(recording)
                if gap.key.startswith("uav/") and gap.key.endswith("/fix") and not gap.duplicate
            ),
            plans={clusters.get(plan.head, ""): plan for plan in plans},
            end=next((e for e in recording.events if e.kind == EventKind.END and e.source == OPERATOR), None),
            voyages=voyages_of(recording, tracks),
        )

    def reason(self, k: int) -> NotHome:
        """Return the reason why UAV `k` is not home."""
        return self._gone(k) or self._unknown(k) or self._silent(k) or self._flying(k)

    def _not_home(self, k: int, cause: Cause, reason: str, slot: int | None = None, by: str = "") -> NotHome:
        uav = self.tracks.uavs[k]
        away_m = float(_away_m(self.voyages, self.tracks)[k])
        heard = bool(self.newest[k] >= 0 or self.tracks.executed[:, k].any())
        return NotHome(uav, cause, reason, slot, by, away_m if heard else None)

    # --- UAVs that do not live ---------------------------------------------------------------

    def _gone(self, k: int) -> NotHome | None:
        """Return the recorded event that ended the flight of UAV `k`, which does not live; None if there is none."""
        if self.living[k]:
            return None
        uav, newest = self.tracks.uavs[k], int(self.newest[k])
        last = max(newest, self._heard_until(uav))
        for event in reversed(self.recording.events):
            is_stray = event.kind == EventKind.STRAYED and event.source == uav
            if (event.slot >= newest or is_stray) and (ending := self._ended_by(event, uav, last)) is not None:
                return self._not_home(k, *ending)
        forgot = min((f.slot for f in self.recording.fixes if f.uav == uav and not f.voter), default=None)
        if forgot is not None:
            text = f"may not be commanded since slot {forgot} (its memory was lost)"
            return self._not_home(k, "memory-lost", text, forgot)
        return None

    def _heard_until(self, uav: str) -> int:
        """Return the last slot in which a head heard `uav`, -1 if none says so."""
        return max((r.slot for r in self.recording.reports if r.has_quorum and uav in r.heard), default=-1)

    def _ended_by(self, event: Event, uav: str, last: int) -> tuple[Cause, str, int] | None:
        """Return cause, reason and first slot if `event` ended the flight of `uav`, else None.

        The end of a process on another host is told seconds later: it is dead since the slot after the `last` fix that
        the record, or a head, has of it.
        """
        slot = min(event.slot, last + 1) if event.kind == EventKind.EXITED else event.slot
        since = f"since slot {slot}"
        if event.source == uav:
            own: dict[str, tuple[Cause, str, int]] = {
                EventKind.BATTERY_EMPTY: ("battery-empty", f"battery empty {since}", slot),
                EventKind.LANDED: ("landed", f"landed in slot {slot} ({event.detail})", slot),
                EventKind.STRAYED: ("strayed", f"not under control {since} ({event.detail})", slot),
                EventKind.GROUNDED: ("grounded", f"never took off ({event.detail})", slot),
            }
            return own.get(event.kind)
        if event.source != OPERATOR:
            return None
        if event.kind == EventKind.EXITED and event.detail.startswith(f"{uav} "):
            return "process-gone", f"dead {since} (its process {event.detail.removeprefix(f'{uav} ')})", slot
        fault = read_fault(event.detail, self.recording.mission.dt_s) if event.kind == EventKind.FAULT else None
        if isinstance(fault, Kill) and fault.target == uav:
            return "killed", f"dead {since} (killed by a fault)", slot
        if isinstance(fault, Freeze) and fault.target == uav:
            return "frozen", f"dead {since} (frozen by a fault)", slot
        return None

    def _unknown(self, k: int) -> NotHome | None:
        """Return that UAV `k` is not heard or that fixes of it are missing, else None."""
        uav, newest = self.tracks.uavs[k], int(self.newest[k])
        if newest < 0:
            return self._not_home(k, "never-heard", "unknown: the record holds no fix of it")
        heard = self._heard_until(uav)
        over = self.end.slot if self.end is not None else -1
        lacking = newest < self.tracks.slots - 1 and uav in self.incomplete
        if lacking or heard > newest or over > self.tracks.slots + SILENT_SLOTS:
            text = f"unknown: the record lacks its fixes after slot {newest}"
            return self._not_home(k, "record-incomplete", text, newest)
        return None

    def _silent(self, k: int) -> NotHome | None:
        if self.living[k]:
            return None
        since = int(self.newest[k]) + 1
        return self._not_home(k, "silent", f"silent since slot {since} (frozen, cut off, or its process gone)", since)

    # --- UAVs that live ----------------------------------------------------------------------

    def _flying(self, k: int) -> NotHome:
        entry = self.voyages.each[k].present
        target_m = (entry.target_x_m, entry.target_y_m)
        obstacles = list(self._obstacles(k))
        if covering := [obstacle for obstacle in obstacles if obstacle.gap_m(target_m, entry.r_m) < 0]:
            return self._covered(k, covering)
        return self._left_alone(k) or self._hindered(k) or self._blocked(k, obstacles) or self._on_its_way(k)

    def _obstacles(self, k: int) -> Iterator[Place]:
        """Yield the disc of every other UAV that is in the air and not home, and its hull if it does not live."""
        for other in np.flatnonzero(~self.home & ~self.tracks.grounded[-1]).tolist():
            if other != k:
                entry = self.recording.mission.roster[k]
                yield from (place.seen_by(entry) for place in self._places(other))

    def _places(self, k: int) -> Iterator[Place]:
        """Yield the disc of UAV `k`, and if it does not live its hull."""
        mission, centre_m = self.recording.mission, point(self.tracks.centre_m[-1, k])
        entry = mission.roster[k]
        if self.living[k]:
            yield from places_of(entry, centre_m, None)
        else:
            yield from places_of(entry, centre_m, self.plans.get(entry.cluster), step_m=mission.step_m(entry))

    def _hindered(self, k: int) -> NotHome | None:
        """UAVs that do not live leave it no step, or no way to its target."""
        roster, centre_m = self.recording.mission.roster, self.tracks.centre_m[-1]
        gone = np.flatnonzero(~self.living & ~self.tracks.grounded[-1]).tolist()
        away = np.flatnonzero(self.living & ~self.home).tolist()
        places = [place for i in gone for place in self._places(i)]
        flying = [(self.voyages.each[i].present, point(centre_m[i])) for i in away]
        found = hindrances(flying, places, self.recording.mission.zone).get(roster[k].uav)
        if found is None:
            return None
        if found.kind == "covered":
            return self._covered(k, found.by)
        return self._not_home(k, CAUSES[found.kind], str(found), by=found.uavs[0])

    def _covered(self, k: int, by: list[Place]) -> NotHome:
        """Return that the target of UAV `k` is covered, and that `k` is beside it if it waits near what covers it."""
        centre_m, r_m = self.tracks.centre_m[:, k], self.recording.mission.roster[k].r_m
        here_m, text = point(centre_m[-1]), f"target covered by {by[0]}"
        still = len(centre_m) > STILL_SLOTS and math.dist(here_m, point(centre_m[-STILL_SLOTS])) <= ARRIVED_M
        gaps_m = [place.gap_m(here_m, r_m) for place in by]
        if still and 0 <= min(gaps_m) <= 2 * r_m:
            return self._not_home(k, "beside", f"waits beside its target: {text}", by=by[0].uav)
        return self._not_home(k, "target-covered", text, by=by[0].uav)

    def _left_alone(self, k: int) -> NotHome | None:
        """Return that UAV `k` got no command, or flew none, for many slots up to the end, else None."""
        uav, last = self.tracks.uavs[k], self.tracks.slots - 1
        commanded = max((c.slot for c in self.recording.commands if c.uav == uav), default=-1)
        if commanded < last - SILENT_SLOTS:
            anybody = max((c.slot for c in self.recording.commands), default=-1) >= last - SILENT_SLOTS
            since = f"since slot {commanded + 1}" if commanded >= 0 else "at any time"
            text = f"not commanded {since}" + ("" if anybody else ": no UAV was")
            return self._not_home(k, "not-commanded", text, commanded + 1)
        flown = int(np.max(np.flatnonzero(self.tracks.executed[:, k]), initial=-1))
        if flown < last - SILENT_SLOTS:
            text = f"has flown no command since slot {flown + 1}: none came in time"
            return self._not_home(k, "commands-not-flown", text, flown + 1)
        return None

    def _blocked(self, k: int, obstacles: list[Place]) -> NotHome | None:
        """Return the obstacle of a stuck UAV `k` that is within one step of touching another UAV, else None."""
        if self.tracks.slots <= STUCK_SLOTS or not obstacles:
            return None
        entry, centre_m = self.voyages.each[k].present, self.tracks.centre_m[:, k]
        away_m = np.hypot(centre_m[:, 0] - entry.target_x_m, centre_m[:, 1] - entry.target_y_m)
        if away_m[-1] < away_m[-1 - STUCK_SLOTS] - ARRIVED_M:
            return None
        here_m = point(centre_m[-1])
        nearest = min(obstacles, key=lambda obstacle: obstacle.gap_m(here_m, entry.r_m))
        if nearest.gap_m(here_m, entry.r_m) > self.recording.mission.step_m(entry):
            return None
        since = int(np.flatnonzero(away_m > away_m[-1] + ARRIVED_M).max(initial=-1)) + 1
        text = f"blocked by {nearest} since slot {since}"
        return self._not_home(k, "blocked", text, since, nearest.uav)

    def _on_its_way(self, k: int) -> NotHome:
        last = self.tracks.slots - 1
        if self.end is None:
            text = f"the record ends in slot {last}"
        else:
            text = ENDS.get(self.end.detail, f"the mission was stopped: {self.end.detail}")
        return self._not_home(k, "mission-ended", text, last)
