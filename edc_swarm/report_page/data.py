"""The data of the report page's script: arrays as base64, the rest as JSON."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.analysis.columns import Columns, columns_of
from edc_swarm.analysis.head_terms import HeadTerm
from edc_swarm.analysis.separation import least_gaps_m
from edc_swarm.analysis.story import Story, story_of
from edc_swarm.analysis.timings import Timing
from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.mission.clusters import CLUSTER_COLOURS, cluster_names, cluster_of
from edc_swarm.mission.field_types import ZoneKind
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import MissionMessage, Report, roster_index
from edc_swarm.recording.model import Recording
from edc_swarm.report_page.flight_rows import FlightRow, flight_rows
from edc_swarm.report_page.itineraries import Itinerary, itineraries
from edc_swarm.story.happening import STATES, Level

MAX_ANIMATED = 1_000_000
"""Most UAV-slots that are animated; the animation of a longer mission skips slots evenly."""
MAX_FAULT_MARKS = 200
MAX_SHOWN_HAPPENINGS = 3000
"""Most happenings that the page lists."""
ACTIVE_SHARE = 0.8
"""Plots begin with the span in which UAVs move if that is a smaller share of the mission."""
NEVER = 255


class Series(Struct, frozen=True):
    """One line of a plot: points (s, y)."""

    name: str
    x: list[float]
    y: list[float]


class Plot(Struct, frozen=True):
    """A plot over mission time. `limit` is drawn as a line if it is within the range of the plot."""

    title: str
    unit: str
    series: list[Series]
    limit: float | None = None
    limit_name: str = ""


class FaultMark(Struct, frozen=True):
    """A fault on the time axis."""

    time_s: float
    text: str


class Told(Struct, frozen=True):
    """A happening of the story: `end_s` is None for a moment, and for what lasts on; `uavs` are roster indices."""

    time_s: float
    end_s: float | None
    kind: str
    words: str
    level: Level
    uavs: list[int]


class Area(Struct, frozen=True):
    """A zone on the map: a polygon of corners, or a circle."""

    name: str
    kind: ZoneKind
    corners_m: list[tuple[float, float]]
    centre_m: list[float]
    radius_m: float
    label_m: tuple[float, float, float]
    """Centre (x, y) of the box around the zone, and its width."""
    said: str
    """Its shape, and the part of a UAV that keeps to it, in words."""

    @classmethod
    def of(cls, zone: Zone) -> Area:
        """Return what the map shows of a zone."""
        left_m, low_m, right_m, high_m = zone.bounds_m
        label_m = (left_m + right_m) / 2, (low_m + high_m) / 2, right_m - left_m
        shape = f"{len(zone.polygon)} corners" if zone.polygon else f"circle of radius {zone.radius_m:g} m"
        side = "inside" if zone.kind == "inclusion" else "outside"
        said = f"{shape}; the {'whole disc' if zone.keeps_disc else 'centre'} stays {side}"
        return cls(shown(zone.name), zone.kind, zone.polygon, zone.centre, zone.radius_m, label_m, said)


class Page(Struct, frozen=True, kw_only=True):
    """The data of one mission.

    `centres` is float32 (F + 1, K, 2), `leader` an index or -1 (F, C), `heard` uint8 (F, K): 1 for heard, 0 for silent,
    2 for a UAV that has landed. `states` is uint8 (F, K), indices of `state_names`; `ages` uint8 (F, K): slots since a
    head had a fix of the UAV, 255 for never; `battery` uint8 (F, K): per cent of the first charge, 255 for unknown;
    `offsets` int8 (F, K, 2): true place less the disc's centre, in 1/127 of `r_m`, -128 for unknown. `active_s` is the
    time after which no UAV moves. `clusters` (C,) are the names of the clusters and `cluster` (K,) each UAV's place
    among them; empty where there is one, and C is then 1.
    """

    name: str
    uavs: list[str]
    r_m: list[float]
    extent_m: tuple[float, float, float, float]
    zones: list[Area]
    frames: int
    frame_s: float
    end_s: float
    centres: str
    heard: str
    leader: list[int]
    terms: list[HeadTerm]
    slot_s: float
    faults: list[FaultMark]
    plots: list[Plot]
    states: str = ""
    state_names: tuple[str, ...] = STATES
    ages: str = ""
    battery: str = ""
    offsets: str = ""
    active_s: float = 0.0
    story: list[Told] = []
    left_out: int = 0
    itineraries: list[Itinerary]
    rows: list[FlightRow] = []
    clusters: list[str] = []
    cluster: list[int] = []
    cluster_colours: tuple[str, ...] = CLUSTER_COLOURS

    @classmethod
    def of(cls, recording: Recording, heads: list[HeadTerm], timings: Sequence[Timing] = (), *, name: str = "") -> Page:
        """Return the data that the page shows of a recording, which it calls `name`, else by the mission's name.

        The mission of a run has a name of its own on the bus, which no reader knows.
        """
        mission, columns = recording.mission, columns_of(recording, timings)
        slots, count = columns.step_m.shape
        every = max(1, -(-slots * count // MAX_ANIMATED))
        heard = np.where(columns.grounded, 2, ~np.isnan(columns.energy_j))[::every]
        plans = _plans(recording, columns)
        names = cluster_names(mission.roster)
        whole_leader = _leader(plans, columns, mission)
        leader = whole_leader[::every]
        story, flown = story_of(recording), itineraries(recording)
        told = _told(story, mission)
        states = np.array([list(row) for row in story.states], np.uint8).reshape(-1, count)[:slots]
        return cls(
            name=shown(name or mission.name),
            uavs=columns.uavs,
            r_m=[entry.r_m for entry in mission.roster],
            extent_m=_extent_m(mission, columns, flown),
            zones=[Area.of(zone) for zone in mission.zone],
            frames=len(heard),
            frame_s=mission.dt_s * every,
            end_s=mission.dt_s * slots,
            centres=_packed(np.concatenate([columns.centre_m[:-1:every], columns.centre_m[-1:]]), np.float32),
            heard=_packed(heard, np.uint8),
            leader=leader.ravel().tolist(),
            terms=heads,
            slot_s=mission.dt_s,
            faults=_faults(recording),
            plots=_plots(mission, columns),
            states=_packed(states[::every], np.uint8),
            ages=_packed(_ages(plans, columns)[::every], np.uint8),
            battery=_packed(_battery(mission, columns)[::every], np.uint8),
            offsets=_packed(_offsets(mission, columns)[::every], np.int8),
            active_s=_active_s(mission, columns),
            story=told,
            left_out=story.left_out + len(story.happenings) - len(told),
            itineraries=flown,
            rows=flight_rows(recording, columns, story, plans, whole_leader.ravel().tolist()),
            clusters=names if len(names) > 1 else [],
            cluster=[names.index(entry.cluster) for entry in mission.roster] if len(names) > 1 else [],
        )


def _extent_m(
    mission: MissionMessage, columns: Columns, flown: Sequence[Itinerary]
) -> tuple[float, float, float, float]:
    """Return (left, low, right, high), the bounding box of all discs, points of goals and fences."""
    r_m = max((entry.r_m for entry in mission.roster), default=0.0)
    goals_m = [point for each in flown for route in each.routes for point in route]
    points_m = np.concatenate([columns.centre_m.reshape(-1, 2), np.array(goals_m).reshape(-1, 2)])
    if not len(points_m):
        return 0.0, 0.0, 1.0, 1.0
    boxes_m = [(*(points_m.min(axis=0) - r_m).tolist(), *(points_m.max(axis=0) + r_m).tolist())]
    boxes_m += [zone.bounds_m for zone in mission.zone if zone.kind == "inclusion"]
    left_m, low_m, right_m, high_m = zip(*boxes_m, strict=True)
    return min(left_m), min(low_m), max(right_m), max(high_m)


def _plans(recording: Recording, columns: Columns) -> dict[str, dict[int, Report]]:
    """Return, by cluster, the plan of the highest term of each slot that has one with a quorum."""
    backing, cluster = Backing(recording.mission), cluster_of(recording.mission)
    plans: dict[str, dict[int, Report]] = {name: {} for name in cluster_names(recording.mission.roster)}
    for report in sorted(recording.reports, key=lambda report: report.term):
        if backing.is_plan(report) and 0 <= report.slot < len(columns.time_s):
            plans[cluster[report.head]][report.slot] = report
    return plans


def _leader(plans: Mapping[str, Mapping[int, Report]], columns: Columns, mission: MissionMessage) -> NDArray[np.int64]:
    """Return (S, C) roster indices of the heads that planned with the fixes of each slot, -1 for none."""
    index = roster_index(mission.roster)
    leader = np.full((len(columns.time_s), len(plans)), -1, np.int64)
    for place, of_slot in enumerate(plans.values()):
        for slot, plan in of_slot.items():
            leader[slot, place] = index.get(plan.head, -1)
    return leader


def _ages(plans: Mapping[str, Mapping[int, Report]], columns: Columns) -> NDArray[np.int64]:
    """Return (S, K) slots since a head had a fix of each UAV; 255 for never."""
    index = {uav: k for k, uav in enumerate(columns.uavs)}
    ages, last = np.full(columns.step_m.shape, NEVER, np.int64), np.full(len(index), -NEVER, np.int64)
    for slot in range(len(ages)):
        for of_slot in plans.values():
            if (plan := of_slot.get(slot)) is not None:
                last[[index[uav] for uav in (plan.head, *plan.heard) if uav in index]] = slot
        ages[slot] = np.minimum(slot - last, NEVER)
    return ages


def _battery(mission: MissionMessage, columns: Columns) -> NDArray[np.float64]:
    """Return (S, K) per cent of the first charge, 255 for unknown."""
    first_j = np.array([entry.energy_j or np.nan for entry in mission.roster])
    return np.where(np.isnan(columns.energy_j / first_j), NEVER, np.clip(100 * columns.energy_j / first_j, 0, 100))


def _offsets(mission: MissionMessage, columns: Columns) -> NDArray[np.float64]:
    """Return (S, K, 2) true places less the disc's centre as slots begin, in 1/127 of the radius; -128 for unknown."""
    r_m = np.array([entry.r_m for entry in mission.roster])[:, None]
    share = 127 * (columns.true_from_m - columns.centre_m[:-1]) / r_m
    return np.where(np.isnan(share), -128, np.clip(np.round(share), -127, 127))


def _active_s(mission: MissionMessage, columns: Columns) -> float:
    """Return the time after which no UAV moves, with a little after it; the whole mission if that is not much more."""
    moved = np.flatnonzero((columns.step_m > 0).any(axis=1))
    slots = len(columns.time_s)
    last = min(slots, int(moved[-1]) + 1 + max(4, slots // 50)) if len(moved) else slots
    return mission.dt_s * (last if last < ACTIVE_SHARE * slots else slots)


def _told(story: Story, mission: MissionMessage) -> list[Told]:
    """Return the happenings that the page lists: all of them, or the ones of weight if there are too many."""
    index = {entry.uav: k for k, entry in enumerate(mission.roster)}
    chosen = story.happenings
    if len(chosen) > MAX_SHOWN_HAPPENINGS:
        chosen = [happening for happening in chosen if happening.level != "detail"][:MAX_SHOWN_HAPPENINGS]
    return [
        Told(
            round(each.time_s, 3),
            None if each.last_slot is None else (each.last_slot + 1) * mission.dt_s,
            each.kind,
            shown(each.words, MAX_LINE),
            each.level,
            [index[uav] for uav in each.uavs if uav in index],
        )
        for each in chosen
    ]


def _faults(recording: Recording) -> list[FaultMark]:
    mission, said = recording.mission, [event for event in recording.events if event.kind == EventKind.FAULT]
    per_s = mission.time_scale / 1e9
    return [
        FaultMark((e.sent_ns - mission.epoch_ns) * per_s, shown(e.detail, MAX_LINE)) for e in said[:MAX_FAULT_MARKS]
    ]


def _plots(mission: MissionMessage, columns: Columns) -> list[Plot]:
    slots_s = columns.time_s
    r_m = np.array([entry.r_m for entry in mission.roster])
    there = ~columns.grounded[..., None]
    from_m, to_m = (np.where(there, points_m, np.nan) for points_m in (columns.centre_m[:-1], columns.centre_m[1:]))
    gap_m = least_gaps_m(from_m, to_m, r_m)
    gap_m[columns.lost.any(axis=1)] = np.nan
    limit_ms = 1e3 * (mission.dt_s - mission.tau_s) / mission.time_scale
    slots, (most_ms,) = _of_slots(columns.plan_slot, columns.plan_ms, np.max)
    of_heads = ", the longest of all heads" if mission.clusters > 1 else ""
    plan = _series("plan time", mission.dt_s * slots, most_ms)
    return [
        Plot("Least gap between two discs", "m", [_series("least gap", slots_s, gap_m)], 0.0, "overlap"),
        Plot(f"Plan time{of_heads}", "ms", [plan], limit_ms, "limit"),
        Plot("From fix to command", "ms", _latencies(mission, columns)),
        Plot("Energy used by all, at targets too", "kJ", [_series("energy", slots_s, _used_j(columns) / 1e3)]),
    ]


def _latencies(mission: MissionMessage, columns: Columns) -> list[Series]:
    """Return the greatest and the median latency of each slot's commands."""
    slots, (most_ms, middle_ms) = _of_slots(columns.command_slot, columns.fix_to_command_ms, np.max, np.median)
    times_s = mission.dt_s * (slots - 1)
    return [_series("greatest", times_s, most_ms), _series("median", times_s, middle_ms)]


def _of_slots(
    slots: NDArray[np.int64], values: NDArray[np.float64], *reductions: Callable[[NDArray[np.float64]], Any]
) -> tuple[NDArray[np.int64], list[list[float]]]:
    """Return the slots, each once, and for each reduction what it makes of each slot's values."""
    order = np.argsort(slots, kind="stable")
    each, first = np.unique(slots[order], return_index=True)
    groups = np.split(values[order], first[1:]) if len(each) else []
    return each, [[float(reduce(group)) for group in groups] for reduce in reductions]


def _used_j(columns: Columns) -> NDArray[np.float64]:
    """(S,) energy taken from all batteries since each was first heard of; silence holds the last value.

    NaN in slots in which nobody was heard of yet, and in those of which the record lacks something.
    """
    energy_j = columns.energy_j.copy()
    for now, before in zip(energy_j[1:], energy_j[:-1], strict=True):
        unknown = np.isnan(now)
        now[unknown] = before[unknown]
    heard = ~np.isnan(energy_j)
    first_j = (
        energy_j[np.argmax(heard, axis=0), np.arange(energy_j.shape[1])] if len(energy_j) else energy_j.sum(axis=0)
    )
    used_j: NDArray[np.float64] = np.nansum(first_j - energy_j, axis=1)
    used_j[~heard.any(axis=1) | columns.lost.any(axis=1)] = np.nan
    return used_j


def _series(name: str, x: Iterable[float], y: Iterable[float]) -> Series:
    pairs = [(round(float(a), 4), round(float(b), 4)) for a, b in zip(x, y, strict=True) if np.isfinite(b)]
    return Series(name, [a for a, _ in pairs], [b for _, b in pairs])


def _packed(values: NDArray[Any], kind: type[np.generic]) -> str:
    """Return values as little-endian bytes in base64."""
    little = np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<"))
    return base64.b64encode(little.tobytes()).decode()
