"""The layers of a scene that a viewer switches on and off: goals, trails, links, vehicles, labels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity

from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.viz.seen import Seen, heading_rad
from edc_swarm.viz.shapes import (
    AMBER,
    GREEN,
    RED,
    WHITE,
    Point,
    arms,
    colour_of,
    disc,
    entity,
    line,
    ring,
    segments,
    text,
)

MANY_UAVS = 30
"""Number of UAVs above which names, goals and links would hide the swarm, and vehicles are plain discs."""
TRAIL_S = 15.0
GOAL_RING_M = 0.6
LATE_SLOTS = 5
"""Age, in slots, from which the head's fix of a UAV is drawn as old."""
LEAST_BODY_M = 0.15
ROTOR = 0.42
"""Radius of a rotor, as a share of the body's radius."""


def goals(uavs: Iterable[tuple[Seen, Point]], now_ns: int) -> list[SceneEntity]:
    """Return the rest of each UAV's route, and a mark at its last point."""
    shown = []
    for uav, centre in uavs:
        colour = colour_of(uav.index)
        shown.append(entity(uav.entry.uav, now_ns))
        shown[-1].lines.append(line([centre, *uav.left], colour, 1.0, alpha=0.5))
        shown[-1].lines.append(ring(uav.left[-1], GOAL_RING_M, colour, 2.0, z_m=0.02))
    return shown


def trails(uavs: Iterable[Seen], now_ns: int) -> list[SceneEntity]:
    """Return the recent way of each UAV, which fades."""
    shown = []
    for uav in uavs:
        recent = [(then_ns, point) for then_ns, point in uav.trail if now_ns - then_ns <= TRAIL_S * NS_PER_S]
        alphas = [0.8 * (1 - (now_ns - then_ns) / NS_PER_S / TRAIL_S) for then_ns, _ in recent]
        shown.append(entity(uav.entry.uav, now_ns))
        shown[-1].lines.append(line([p for _, p in recent], colour_of(uav.index), 2.0, alphas=alphas))
    return shown


def links(pairs: Iterable[tuple[Point, Point, int]], now_ns: int) -> list[SceneEntity]:
    """Return a line from each head to each other UAV, in the colour of the age of its fix, in slots."""
    ends = [(head, at, GREEN if age == 0 else AMBER if age < LATE_SLOTS else RED) for head, at, age in pairs]
    made = entity("links", now_ns)
    if ends:
        made.lines.append(segments(ends, 1.5, 0.6))
    return [made]


def vehicle(uav: Seen, where: Point, now_ns: int, *, plain: bool) -> SceneEntity:
    """Return a UAV's body at its true place, with arms and rotors, which show when near, unless it is to be `plain`."""
    assert uav.truth is not None
    made, body_m, turned_rad = (
        entity(uav.entry.uav, now_ns),
        max(uav.entry.body_m, LEAST_BODY_M),
        heading_rad(uav.truth),
    )
    made.cylinders.append(disc(where, body_m, WHITE, 0.5, z_m=0.05))
    if plain:
        return made
    arm_m = (1 - ROTOR) * body_m
    for n in range(4):
        angle = turned_rad + (n + 0.5) * math.pi / 2
        rotor = where[0] + arm_m * math.cos(angle), where[1] + arm_m * math.sin(angle)
        made.cylinders.append(disc(rotor, ROTOR * body_m, colour_of(uav.index), 0.9, z_m=0.1))
    made.lines.append(arms(where, turned_rad, arm_m, WHITE))
    return made


def label(uav: Seen, at: Point, why: str, now_ns: int) -> SceneEntity:
    """Return a UAV's name, with the reason if it is kept from flying."""
    made = entity(uav.entry.uav, now_ns)
    made.texts.append(text(at, uav.entry.uav + (f": {why}" if why else ""), AMBER if why else WHITE))
    return made


def ages(report_slot: int, heard_in: Mapping[str, int], names: Iterable[str]) -> dict[str, int]:
    """Return the age of the head's fix of each UAV that a head has heard, in slots."""
    return {name: report_slot - heard_in[name] for name in names if name in heard_in}
