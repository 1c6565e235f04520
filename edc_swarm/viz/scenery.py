"""The scenes of a mission, computed from its messages at fixed rates.

The caller gives the time, so the same messages at the same times give the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import msgspec
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from msgspec import UNSET

from edc_swarm.mission.clusters import cluster_names
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.routes import rectangle_m
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.story.happening import Happening, grouped
from edc_swarm.story.teller import Storyteller
from edc_swarm.viz import channels, layers
from edc_swarm.viz.channels import ROOT, Status, Told
from edc_swarm.viz.gaps import Gaps, gaps
from edc_swarm.viz.log_lines import TOLD, event_line, happening_line
from edc_swarm.viz.marks import location, on_the_ground, out_of_action
from edc_swarm.viz.seen import Seen
from edc_swarm.viz.shapes import (
    AMBER,
    BLUE,
    CYAN,
    GREEN,
    GREY,
    PURPLE,
    RED,
    WHITE,
    Point,
    Rgb,
    cluster_colour,
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
FORGET_NS = 60 * NS_PER_S
"""Longest time without messages that is shown; a longer one is skipped."""
LABELS_HIGH = 45
"""Height of a view of the whole area, in labels."""


GONE = frozenset({"dead", "frozen", "silent", "landed"})
"""States of a UAV that does not fly. The others keep clear of the disc of one that landed until its head frees it."""
OUTLINES: dict[str, Rgb] = {
    "flying": BLUE, "holding": AMBER, "arrived": GREEN, "beside": CYAN, "cut-off": PURPLE, "unknown": GREY,
}  # fmt: skip
"""Colours of the outlines of discs by state. The disc has its UAV's own colour, as its trail and its goal have."""
CLUSTER_RING = 0.55
"""Radius of the ring in the colour of a UAV's cluster, as a share of its disc."""
NEAR_LIMIT = 0.2
"""Share of the limit of the plan time from which a plan counts as near it."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One message of the visualisation: its topic, its time and its bytes."""

    topic: str
    time_ns: int
    payload: bytes


class Scenery:
    """The scenes of one mission. Call `advance` and `hear` with times that do not go back."""

    def __init__(self, plan_ms: Mapping[int, float] | None = None) -> None:
        """Take the plan times, by slot, that the reports lack: those of a simulation."""
        self._plan_ms = plan_ms or {}
        self._heard_in: dict[str, int] = {}
        self._mission: MissionMessage | None = None
        self._uavs: dict[str, Seen] = {}
        self._teller: Storyteller | None = None
        self._backing: Backing | None = None
        self._zones: list[SceneEntity] = []
        self._label_m = 0.0
        self._clusters: dict[str, int] = {}
        self._reports: dict[str, Report] = {}
        self._said: list[Shown] = []
        self._newest_status: Shown | None = None
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
            case Fix() | Truth() | Command() if (uav := self._uavs.get(message.uav)) is not None:
                uav.hear(message)
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
        shown = []
        for each in grouped(told, order):
            said = Told(slot=each.slot, kind=each.kind, level=each.level, words=each.words)
            shown.append(Shown(ROOT + channels.LOG, now_ns, happening_line(each, now_ns)))
            shown.append(Shown(ROOT + channels.STORY, now_ns, msgspec.json.encode(said)))
        return shown

    def _begin(self, mission: MissionMessage, now_ns: int) -> None:
        if self._mission is None:
            self._mission = mission
            self._backing = Backing(mission)
            self._teller = Storyteller(mission, max(0, self._slot(now_ns)))
            self._zones = list(zone_entities(mission.zone, now_ns))
            (left_m, low_m), (right_m, high_m) = extent_m(mission)
            self._label_m = max(right_m - left_m, high_m - low_m) / LABELS_HIGH
            self._clusters = {name: number for number, name in enumerate(cluster_names(mission.roster))}
            self._uavs = {entry.uav: Seen(entry, index) for index, entry in enumerate(mission.roster)}
            self._next_ns = now_ns

    def _hear_report(self, report: Report, now_ns: int) -> None:
        assert self._mission is not None
        if self._backing is None or report.head not in self._uavs or not self._backing.is_plan(report):
            return
        cluster = self._uavs[report.head].entry.cluster
        known = self._reports.get(cluster)
        if known is not None and (report.term, report.slot) < (known.term, known.slot):
            return
        self._reports[cluster] = report
        self._heard_in.update(dict.fromkeys((report.head, *report.heard), report.slot))
        status = Shown(ROOT + channels.STATUS, now_ns, msgspec.json.encode(self._status(report, now_ns)))
        if status != self._newest_status:  # reports of two clusters at one instant can make the same
            self._newest_status = status
            self._said.append(status)

    # --- scenes and their times ------------------------------------------------------------------

    def _tick(self, now_ns: int) -> list[Shown]:
        centres = {name: self._centre(uav, now_ns) for name, uav in self._uavs.items()}
        scenes = {
            channels.UAVS: self._discs(centres, now_ns),
            channels.LABELS: self._labels(centres, now_ns),
            channels.VEHICLES: self._vehicles(now_ns),
            channels.LINKS: self._links(centres, now_ns),
            channels.COMMANDS: self._commands(now_ns),
            channels.HULLS: self._hulls(now_ns),
        }
        if self._ticks % SLOW_TICKS == 0:
            for name, uav in self._uavs.items():
                uav.leave_trail(now_ns, centres[name])
            scenes[channels.TRAILS] = layers.trails(self._uavs.values(), now_ns)
            flying = [(self._uavs[name], centres[name]) for name in centres if self._flies(name)]
            scenes[channels.GOALS] = layers.goals(flying, now_ns)
        if self._ticks % STATIC_TICKS == 0:
            scenes[channels.AREA] = self._area(now_ns)
        shown = [Shown(ROOT + name, now_ns, scene(entities, now_ns)) for name, entities in scenes.items()]
        return [*shown, *_locations(self._uavs.values(), now_ns)] if self._ticks % SLOW_TICKS == 0 else shown

    @property
    def _states(self) -> Mapping[str, str]:
        return self._teller.states if self._teller is not None else {}

    def _flies(self, name: str) -> bool:
        return name not in self._landed and self._states.get(name) not in GONE

    def _discs(self, centres: dict[str, Point], now_ns: int) -> list[SceneEntity]:
        overlapping, landed, states = self._gaps(centres).overlapping, self._landed, self._states
        return [
            on_the_ground(uav.entry, centres[name], now_ns)
            if name in landed
            else out_of_action(uav.entry, centres[name], f"{name} {states[name]}", self._label_m, now_ns)
            if states.get(name) in GONE
            else self._disc(uav, centres[name], name in overlapping, states.get(name, ""), now_ns)
            for name, uav in self._uavs.items()
        ]

    def _labels(self, centres: dict[str, Point], now_ns: int) -> list[SceneEntity]:
        """Return the names of all UAVs that fly; the other marks have their own words."""
        whys = self._teller.whys if self._teller is not None else {}
        return [
            layers.label(uav, self._label_at(uav, centres[name]), whys.get(name, ""), now_ns)
            for name, uav in self._uavs.items()
            if self._flies(name)
        ]

    def _label_at(self, uav: Seen, centre: Point) -> Point:
        return centre[0], centre[1] + 1.06 * uav.entry.r_m + self._label_m / 2

    def _vehicles(self, now_ns: int) -> list[SceneEntity]:
        plain = len(self._uavs) > layers.MANY_UAVS
        return [
            layers.vehicle(uav, self._between(uav.truth, now_ns), now_ns, plain=plain)
            for name, uav in self._uavs.items()
            if uav.truth is not None and self._flies(name)
        ]

    def _links(self, centres: dict[str, Point], now_ns: int) -> list[SceneEntity]:
        """Return the links of each head to the UAVs of its cluster; none where no head is known."""
        links = []
        for report, aged in self._ages():
            links += [(centres[report.head], centres[name], age) for name, age in aged.items() if name != report.head]
        return layers.links(links, now_ns)

    def _ages(self) -> Iterator[tuple[Report, dict[str, int]]]:
        """Yield the newest report of each cluster, and the ages of its head's fixes of the UAVs that fly."""
        for cluster, report in self._reports.items():
            mates = (name for name, uav in self._uavs.items() if uav.entry.cluster == cluster and self._flies(name))
            yield report, layers.ages(report.slot, self._heard_in, mates)

    @property
    def _landed(self) -> list[str]:
        """UAVs that the head of their cluster knows to be out of the airspace."""
        return [uav for report in self._reports.values() for uav in report.landed]

    def _disc(self, uav: Seen, centre: Point, overlaps: bool, state: str, now_ns: int) -> SceneEntity:
        entry, own = uav.entry, RED if overlaps else colour_of(uav.index)
        made = entity(entry.uav, now_ns)
        made.cylinders.append(disc(centre, entry.r_m, own, 0.45 if overlaps else 0.22))
        made.lines.append(ring(centre, entry.r_m, own if overlaps else OUTLINES.get(state, own), 2.0))
        if len(self._clusters) > 1:
            made.lines.append(
                ring(centre, entry.r_m * CLUSTER_RING, cluster_colour(self._clusters[entry.cluster]), 4.0)
            )
        report = self._reports.get(entry.cluster)
        if report is not None and entry.uav == report.head:
            made.lines.append(ring(centre, entry.r_m * 1.06, WHITE, 4.0))
        if role := _role(entry.uav, report):
            role_y_m = min(centre[1] - 0.3 * entry.r_m, self._label_at(uav, centre)[1] - self._label_m)
            made.texts.append(text((centre[0], role_y_m), role, WHITE))
        return made

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
        """Return the hulls of the UAVs that the head of their cluster does not hear, widened by their GPS error."""
        shown = []
        hulls = (
            hull
            for report in self._reports.values()
            for hull in zip(report.hull_uav, *report.hull_columns, strict=False)
            if hull[0] != report.head
        )
        for name, ax_m, ay_m, bx_m, by_m, radius_m in hulls:
            if name in self._uavs:
                outline = stadium((ax_m, ay_m), (bx_m, by_m), radius_m + self._uavs[name].entry.r_m)
                shown.append(entity(name, now_ns))
                shown[-1].lines.append(line(outline, AMBER, 3.0, closed=True))
        return shown

    def _area(self, now_ns: int) -> list[SceneEntity]:
        """Return the zones, and a frame around all starts and targets if there is no fence."""
        assert self._mission is not None
        shown = [*self._zones]
        if not any(zone.kind == "inclusion" for zone in self._mission.zone):
            (left_m, low_m), (right_m, high_m) = extent_m(self._mission)
            frame = entity("frame", now_ns)
            corners = [(left_m, low_m), (right_m, low_m), (right_m, high_m), (left_m, high_m)]
            frame.lines.append(line(corners, GREY, 2.0, closed=True))
            shown.append(frame)
        return shown

    # --- positions --------------------------------------------------------------------

    def _slot(self, now_ns: int) -> int:
        assert self._mission is not None
        return (now_ns - self._mission.epoch_ns) // self._mission.slot_ns

    def _share(self, slot: int, now_ns: int) -> float:
        """Return the elapsed share of a slot, in [0, 1]."""
        assert self._mission is not None
        begun_ns = self._mission.epoch_ns + slot * self._mission.slot_ns
        return min(1.0, max(0.0, (now_ns - begun_ns) / self._mission.slot_ns))

    def _centre(self, uav: Seen, now_ns: int) -> Point:
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
        newest = [self._reports[cluster] for cluster in self._clusters if cluster in self._reports]
        plan_ms = max(each.plan_ms for each in newest) or self._plan_ms.get(report.slot, 0.0)
        limit_ms = 1e3 * (mission.dt_s - mission.tau_s) / mission.time_scale
        charges = [pct for uav in self._uavs.values() if (pct := uav.battery_pct) is not None]
        return Status(
            slot=report.slot,
            term=", ".join(str(each.term) for each in newest),
            head=", ".join(each.head for each in newest),
            status=report.status,
            plan_ms=plan_ms or UNSET,
            plan_limit_ms=limit_ms,
            plan_limit_near_ms=limit_ms if plan_ms > NEAR_LIMIT * limit_ms else UNSET,
            gap_m=UNSET if least_m is None else least_m,
            planned_gap_m=min((each.min_gap_m for each in newest if each.min_gap_m), default=UNSET),
            gap_limit_m=0.0,
            heard=sum(len(each.heard) for each in newest),
            unheard=sum(len(each.unheard) for each in newest),
            arrived=sum(fix.arrived for fix in fixes),
            least_energy_j=min((fix.energy_j for fix in fixes), default=UNSET),
            least_battery_pct=min(charges, default=UNSET),
            mean_battery_pct=sum(charges) / len(charges) if charges else UNSET,
            oldest_fix_slots=max((age for _, aged in self._ages() for age in aged.values()), default=UNSET),
        )


def _role(uav: str, report: Report | None) -> str:
    """Return the label of a UAV's role (head, or rank of the standby), which stands inside the disc."""
    if report is None:
        return ""
    if uav == report.head:
        return "H"
    return f"s{report.standby.index(uav) + 1}" if uav in report.standby else ""


def extent_m(mission: MissionMessage) -> tuple[Point, Point]:
    """Return the lower left and upper right corner of all starts, targets and fences; without fences, of the area."""
    fences = [zone.bounds_m for zone in mission.zone if zone.kind == "inclusion"]
    boxes_m = fences or [(0.0, 0.0, *mission.area_size_m)]
    points_m = [*rectangle_m(mission.roster)]
    points_m += [point for left, low, right, high in boxes_m for point in ((left, low), (right, high))]
    xs_m, ys_m = zip(*points_m, strict=True)
    return (min(xs_m), min(ys_m)), (max(xs_m), max(ys_m))


def _locations(uavs: Iterable[Seen], now_ns: int) -> list[Shown]:
    fixes = [uav.fix for uav in uavs if uav.fix is not None]
    return [Shown(f"{ROOT}{channels.LOCATION}/{fix.uav}", now_ns, location(fix, now_ns)) for fix in fixes]
