"""The scenes of a mission, computed from its messages at fixed rates.

The caller gives the time, so the same messages at the same times give the same bytes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import msgspec
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from msgspec import UNSET

from edc_swarm.geometry import DISC_TOLERANCE_M
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.routes import rectangle_m
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.story.happening import Happening, grouped
from edc_swarm.story.teller import Storyteller
from edc_swarm.viz import channels
from edc_swarm.viz.channels import ROOT, Status
from edc_swarm.viz.log_lines import TOLD, event_line, happening_line
from edc_swarm.viz.marks import location, on_the_ground, out_of_action
from edc_swarm.viz.shapes import (
    AMBER,
    GREY,
    RED,
    WHITE,
    Point,
    colour_of,
    disc,
    entity,
    line,
    ring,
    scene,
    stadium,
    text,
)
from edc_swarm.viz.zones import zone_entities

TICK_NS = NS_PER_S // 2
"""Period of the scenes of UAVs, commands and hulls."""
SLOW_TICKS = 2
"""Ticks between scenes of trails, and between positions on the map."""
STATIC_TICKS = 120
"""Ticks between scenes of static objects (one minute), for viewers that connect late."""
TRAIL_S = 15.0
MAX_TRAIL = 16
FORGET_NS = 60 * NS_PER_S
"""Longest time without messages that is shown; a longer one is skipped."""
LABELS_HIGH = 45
"""Height of a view of the whole area, in labels."""


GONE = frozenset({"dead", "frozen", "silent"})


@dataclass(frozen=True, slots=True)
class Shown:
    """One message of the visualisation: its topic, its time and its bytes."""

    topic: str
    time_ns: int
    payload: bytes


@dataclass(slots=True)
class _Uav:
    """The newest state of one UAV, with its trail."""

    entry: RosterEntry
    index: int
    fix: Fix | None = None
    truth: Truth | None = None
    command: Command | None = None
    trail: deque[tuple[int, Point]] = field(default_factory=lambda: deque(maxlen=MAX_TRAIL))

    @property
    def left(self) -> list[Point]:
        """Points that it has still to fly to, the present one first."""
        fix = self.fix
        return fix.course.left(self.entry) if fix is not None and fix.course.fits(self.entry) else self.entry.points

    def leave_trail(self, now_ns: int, centre: Point) -> None:
        """Add a point to the trail; a hold adds only one."""
        if self.trail and self.trail[-1][1] == centre:
            self.trail.pop()
        self.trail.append((now_ns, centre))


class Scenery:
    """The scenes of one mission. Call `advance` and `hear` with times that do not go back."""

    def __init__(self) -> None:
        self._mission: MissionMessage | None = None
        self._uavs: dict[str, _Uav] = {}
        self._teller: Storyteller | None = None
        self._zones: list[SceneEntity] = []
        self._label_m = 0.0
        self._report: Report | None = None
        self._said: list[Shown] = []
        self._next_ns = 0
        self._ticks = 0

    @property
    def next_ns(self) -> int | None:
        """Time of the next scenes; None before the mission is known."""
        return self._next_ns if self._mission is not None else None

    def advance(self, now_ns: int) -> list[Shown]:
        """Return all scenes up to `now_ns`, from the messages so far."""
        shown, self._said = self._said, []
        if self._mission is None:
            return shown
        if now_ns - self._next_ns > FORGET_NS:
            self._next_ns = now_ns
        while self._next_ns <= now_ns:
            shown += self._tell(self._next_ns)
            shown += self._tick(self._next_ns)
            self._next_ns += TICK_NS
            self._ticks += 1
        return shown

    def hear(self, message: Message, now_ns: int) -> None:
        """Process a message that was sent at `now_ns`."""
        if self._teller is not None:
            self._teller.hear(message)
        match message:
            case MissionMessage():
                self._begin(message, now_ns)
            case Fix() if (uav := self._uavs.get(message.uav)) is not None:
                if message.voter and (uav.fix is None or message.slot >= uav.fix.slot):
                    uav.fix = message
            case Truth() if (uav := self._uavs.get(message.uav)) is not None:
                if uav.truth is None or message.slot >= uav.truth.slot:
                    uav.truth = message
            case Command() if (uav := self._uavs.get(message.uav)) is not None:
                if uav.command is None or (message.slot, message.term) >= (uav.command.slot, uav.command.term):
                    uav.command = message
            case Report() if self._mission is not None:
                self._hear_report(message, now_ns)
            case Event():
                if self._teller is None or message.kind not in TOLD:
                    self._said.append(Shown(ROOT + channels.LOG, now_ns, event_line(message, now_ns)))

    def _tell(self, now_ns: int) -> list[Shown]:
        """Return the lines of the log that tell the story up to the slot before the last, all of which has come."""
        assert self._mission is not None
        assert self._teller is not None
        teller, told = self._teller, list[Happening]()
        while teller.next_slot < self._slot(now_ns) - 1:
            told += teller.close(teller.next_slot)
        order = [entry.uav for entry in self._mission.roster]
        return [Shown(ROOT + channels.LOG, now_ns, happening_line(each, now_ns)) for each in grouped(told, order)]

    def _begin(self, mission: MissionMessage, now_ns: int) -> None:
        if self._mission is None:
            self._mission = mission
            self._teller = Storyteller(mission, max(0, self._slot(now_ns)))
            self._zones = list(zone_entities(mission.zone, now_ns))
            (left_m, low_m), (right_m, high_m) = extent_m(mission)
            self._label_m = max(right_m - left_m, high_m - low_m) / LABELS_HIGH
            self._uavs = {entry.uav: _Uav(entry, index) for index, entry in enumerate(mission.roster)}
            self._next_ns = now_ns

    def _hear_report(self, report: Report, now_ns: int) -> None:
        assert self._mission is not None
        known = self._report
        if not report.is_backed(self._uavs.keys(), self._mission.quorum):
            return
        if not report.has_quorum or (known is not None and (report.term, report.slot) < (known.term, known.slot)):
            return
        self._report = report
        payload = msgspec.json.encode(self._status(report, now_ns))
        self._said.append(Shown(ROOT + channels.STATUS, now_ns, payload))

    # --- scenes and their times ------------------------------------------------------------------

    def _tick(self, now_ns: int) -> list[Shown]:
        centres = {name: self._centre(uav, now_ns) for name, uav in self._uavs.items()}
        scenes = {
            channels.UAVS: self._discs(centres, now_ns),
            channels.COMMANDS: self._commands(now_ns),
            channels.HULLS: self._hulls(now_ns),
        }
        if self._ticks % SLOW_TICKS == 0:
            for name, uav in self._uavs.items():
                uav.leave_trail(now_ns, centres[name])
            scenes[channels.TRAILS] = _trails(self._uavs.values(), now_ns)
        if self._ticks % STATIC_TICKS == 0:
            scenes[channels.AREA] = self._area(now_ns)
        shown = [Shown(ROOT + name, now_ns, scene(entities, now_ns)) for name, entities in scenes.items()]
        return [*shown, *_locations(self._uavs.values(), now_ns)] if self._ticks % SLOW_TICKS == 0 else shown

    def _discs(self, centres: dict[str, Point], now_ns: int) -> list[SceneEntity]:
        overlapping, landed = self._gaps(centres).overlapping, self._landed
        teller = self._teller
        states, whys = (teller.states, teller.whys) if teller is not None else ({}, {})
        return [
            on_the_ground(uav.entry, centres[name], now_ns)
            if name in landed
            else out_of_action(uav.entry, centres[name], f"{name} {states[name]}", self._label_m, now_ns)
            if states.get(name) in GONE
            else self._disc(uav, centres[name], name in overlapping, whys.get(name, ""), now_ns)
            for name, uav in self._uavs.items()
        ]

    @property
    def _landed(self) -> list[str]:
        """UAVs that the head knows to be out of the airspace."""
        return [] if self._report is None else self._report.landed

    def _disc(self, uav: _Uav, centre: Point, overlaps: bool, why: str, now_ns: int) -> SceneEntity:
        entry, colour = uav.entry, RED if overlaps else colour_of(uav.index)
        made = entity(entry.uav, now_ns)
        made.cylinders.append(disc(centre, entry.r_m, colour, 0.45 if overlaps else 0.22))
        made.lines.append(ring(centre, entry.r_m, colour, 2.0))
        made.lines.append(line([centre, *uav.left], colour, 1.0, alpha=0.5))
        if uav.truth is not None:
            where = self._between(uav.truth, now_ns)
            made.cylinders.append(disc(where, max(entry.body_m, 0.15), WHITE, 0.9, z_m=0.05))
        if self._report is not None and entry.uav == self._report.head:
            made.lines.append(ring(centre, entry.r_m * 1.06, WHITE, 4.0))
        name_y_m = centre[1] + 1.06 * entry.r_m + self._label_m / 2
        made.texts.append(text((centre[0], name_y_m), entry.uav + (f": {why}" if why else ""), AMBER if why else WHITE))
        if role := self._role(entry.uav):
            role_y_m = min(centre[1] - 0.3 * entry.r_m, name_y_m - self._label_m)
            made.texts.append(text((centre[0], role_y_m), role, WHITE))
        return made

    def _role(self, uav: str) -> str:
        """Return the label of a UAV's role (head, or rank of the standby), which stands inside the disc."""
        if self._report is None:
            return ""
        if uav == self._report.head:
            return "H"
        return f"s{self._report.standby.index(uav) + 1}" if uav in self._report.standby else ""

    def _commands(self, now_ns: int) -> list[SceneEntity]:
        """Return the steps that UAVs fly in this slot or the next one."""
        slot, shown = self._slot(now_ns), []
        for name, uav in self._uavs.items():
            command = uav.command
            if command is not None and command.slot >= slot and command.speed_mps > 0:
                ends = [(command.start_x_m, command.start_y_m), (command.target_x_m, command.target_y_m)]
                shown.append(entity(name, now_ns))
                shown[-1].lines.append(line(ends, WHITE, 3.0))
        return shown

    def _hulls(self, now_ns: int) -> list[SceneEntity]:
        """Return the hulls of the UAVs that the head does not hear, widened by their GPS error."""
        report, shown = self._report, []
        if report is None:
            return []
        for name, ax_m, ay_m, bx_m, by_m, radius_m in zip(report.hull_uav, *report.hull_columns, strict=False):
            if name in self._uavs and name != report.head:
                outline = stadium((ax_m, ay_m), (bx_m, by_m), radius_m + self._uavs[name].entry.r_m)
                shown.append(entity(name, now_ns))
                shown[-1].lines.append(line(outline, AMBER, 3.0, closed=True))
        return shown

    def _area(self, now_ns: int) -> list[SceneEntity]:
        """Return the zones, a frame around all starts and targets if there is no fence, and a mark at every target."""
        assert self._mission is not None
        shown = [*self._zones]
        if not any(zone.kind == "inclusion" for zone in self._mission.zone):
            (left_m, low_m), (right_m, high_m) = extent_m(self._mission)
            frame = entity("frame", now_ns)
            corners = [(left_m, low_m), (right_m, low_m), (right_m, high_m), (left_m, high_m)]
            frame.lines.append(line(corners, GREY, 2.0, closed=True))
            shown.append(frame)
        targets = entity("targets", now_ns)
        for uav in self._uavs.values():
            targets.lines.append(ring(uav.left[-1], 0.6, colour_of(uav.index), 2.0, z_m=0.02))
        return [*shown, targets]

    # --- positions --------------------------------------------------------------------

    def _slot(self, now_ns: int) -> int:
        assert self._mission is not None
        return (now_ns - self._mission.epoch_ns) // self._mission.slot_ns

    def _share(self, slot: int, now_ns: int) -> float:
        """Return the elapsed share of a slot, in [0, 1]."""
        assert self._mission is not None
        begun_ns = self._mission.epoch_ns + slot * self._mission.slot_ns
        return min(1.0, max(0.0, (now_ns - begun_ns) / self._mission.slot_ns))

    def _centre(self, uav: _Uav, now_ns: int) -> Point:
        """Return the centre of the tracked disc."""
        fix = uav.fix
        if fix is None:
            return uav.entry.start_x_m, uav.entry.start_y_m
        if not fix.executing:
            return fix.waypoint_x_m, fix.waypoint_y_m
        share = self._share(fix.slot, now_ns)
        x_m = fix.from_x_m + share * (fix.waypoint_x_m - fix.from_x_m)
        return x_m, fix.from_y_m + share * (fix.waypoint_y_m - fix.from_y_m)

    def _between(self, truth: Truth, now_ns: int) -> Point:
        share = self._share(truth.slot, now_ns)
        x_m = truth.from_x_m + share * (truth.to_x_m - truth.from_x_m)
        return x_m, truth.from_y_m + share * (truth.to_y_m - truth.from_y_m)

    def _gaps(self, centres: dict[str, Point]) -> Gaps:
        landed = self._landed
        flying = ((name, uav) for name, uav in self._uavs.items() if name not in landed)
        return gaps([(centres[name], uav.entry.r_m, name) for name, uav in flying])

    def _status(self, report: Report, now_ns: int) -> Status:
        assert self._mission is not None
        mission, fixes = self._mission, [uav.fix for uav in self._uavs.values() if uav.fix is not None]
        centres = {name: self._centre(uav, now_ns) for name, uav in self._uavs.items()}
        least_m = self._gaps(centres).least_m
        return Status(
            slot=report.slot,
            term=report.term,
            head=report.head,
            status=report.status,
            plan_ms=report.plan_ms or UNSET,
            plan_limit_ms=1e3 * (mission.dt_s - mission.tau_s) / mission.time_scale,
            gap_m=UNSET if least_m is None else least_m,
            planned_gap_m=report.min_gap_m,
            gap_limit_m=0.0,
            heard=len(report.heard),
            unheard=len(report.unheard),
            arrived=sum(fix.arrived for fix in fixes),
            least_energy_j=min((fix.energy_j for fix in fixes), default=UNSET),
        )


@dataclass(frozen=True, slots=True)
class Gaps:
    """The least gap between two discs (None for fewer than two), and the UAVs with overlapping discs."""

    least_m: float | None
    overlapping: set[str]


def gaps(discs: list[tuple[Point, float, str]]) -> Gaps:
    """Return the gaps between discs (centre, radius, name), by a sweep from left to right that skips distant pairs."""
    ordered = sorted(discs)
    widest_m = max((r_m for _, r_m, _ in ordered), default=0.0)
    least_m, overlapping = math.inf, set[str]()
    for i, ((x_m, y_m), r_m, name) in enumerate(ordered):
        for (other_x_m, other_y_m), other_r_m, other in ordered[i + 1 :]:
            if other_x_m - x_m - r_m - widest_m > max(least_m, 0.0):
                break
            gap_m = math.hypot(other_x_m - x_m, other_y_m - y_m) - r_m - other_r_m
            least_m = min(least_m, gap_m)
            if gap_m < -DISC_TOLERANCE_M:
                overlapping |= {name, other}
    return Gaps(least_m if math.isfinite(least_m) else None, overlapping)


def extent_m(mission: MissionMessage) -> tuple[Point, Point]:
    """Return the lower left and upper right corner of all starts, targets and fences; without fences, of the area."""
    fences = [zone.bounds_m for zone in mission.zone if zone.kind == "inclusion"]
    boxes_m = fences or [(0.0, 0.0, *mission.area_size_m)]
    points_m = [*rectangle_m(mission.roster)]
    points_m += [point for left, low, right, high in boxes_m for point in ((left, low), (right, high))]
    xs_m, ys_m = zip(*points_m, strict=True)
    return (min(xs_m), min(ys_m)), (max(xs_m), max(ys_m))


def _trails(uavs: Iterable[_Uav], now_ns: int) -> list[SceneEntity]:
    shown = []
    for uav in uavs:
        recent = [(then_ns, point) for then_ns, point in uav.trail if now_ns - then_ns <= TRAIL_S * NS_PER_S]
        alphas = [0.8 * (1 - (now_ns - then_ns) / NS_PER_S / TRAIL_S) for then_ns, _ in recent]
        shown.append(entity(uav.entry.uav, now_ns))
        shown[-1].lines.append(line([p for _, p in recent], colour_of(uav.index), 2.0, alphas=alphas))
    return shown


def _locations(uavs: Iterable[_Uav], now_ns: int) -> list[Shown]:
    fixes = [uav.fix for uav in uavs if uav.fix is not None]
    return [Shown(f"{ROOT}{channels.LOCATION}/{fix.uav}", now_ns, location(fix, now_ns)) for fix in fixes]
