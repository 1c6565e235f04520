"""Builders of rosters, missions, messages, UAVs and a planner: valid ones, of which a test states what it is about."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from edc_swarm.agent.node import UavNode
from edc_swarm.agent.vehicle import Airframe, Promise
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.planner.interface import Plan, PlanRequest
from edc_swarm.protocol.messages import Command, Fix, MissionMessage, Report, Truth

Point = tuple[float, float]
HERE: Point = (0.0, 0.0)
SLOT_NS = 500_000_000
EPOCH_NS = 1_000 * SLOT_NS


def at(slot: float) -> int:
    """Return the wall time in nanoseconds of a moment in slots since the epoch."""
    return EPOCH_NS + round(slot * SLOT_NS)


def entry(uav: str = "a", start_m: Point = HERE, target_m: Point = (0.0, 9.0), **fields: Any) -> RosterEntry:
    """Return a UAV of the roster, by default with GPS error radius 5 m, body radius 1 m and a joule."""
    (start_x_m, start_y_m), (target_x_m, target_y_m) = start_m, target_m
    places = {"start_x_m": start_x_m, "start_y_m": start_y_m, "target_x_m": target_x_m, "target_y_m": target_y_m}
    return RosterEntry(**{"uav": uav, **places, "r_m": 5.0, "body_m": 1.0, "energy_j": 1.0, **fields})


def row(uavs: Iterable[str], gap_m: float, north_m: float, **fields: Any) -> list[RosterEntry]:
    """Return UAVs in a row, `gap_m` apart from the origin eastwards, each with its target `north_m` north of it."""
    return [entry(uav, (gap_m * k, 0.0), (gap_m * k, north_m), **fields) for k, uav in enumerate(uavs)]


def mission(roster: Sequence[RosterEntry], **fields: Any) -> Mission:
    """Return the mission of this roster."""
    return Mission(**{"roster": list(roster), "uavs": len(roster), **fields})


def mission_message(roster: Sequence[RosterEntry], **fields: Any) -> MissionMessage:
    """Return the mission of this roster as it is published: named m, of 100 slots, from `EPOCH_NS` on."""
    basis = {"name": "m", "epoch_ns": EPOCH_NS, "tau_s": 0.2, "max_slots": 100}
    return MissionMessage(**{"roster": list(roster), "uavs": len(roster), **basis, **fields})


def fix(uav: str, slot: int, waypoint_m: Point = HERE, **fields: Any) -> Fix:
    """Return a fix of a UAV that is where its tracked disc is; by default it grants nobody."""
    x_m, y_m = waypoint_m
    places = {"x_m": x_m, "y_m": y_m, "waypoint_x_m": x_m, "waypoint_y_m": y_m}
    return Fix(**{"uav": uav, "slot": slot, "r_m": 5.0, **places, **fields})


def truth(uav: str, slot: int, from_m: Point = HERE, to_m: Point = HERE, **fields: Any) -> Truth:
    """Return the true motion of a UAV, by default none."""
    ends = {"from_x_m": from_m[0], "from_y_m": from_m[1], "to_x_m": to_m[0], "to_y_m": to_m[1]}
    return Truth(**{"uav": uav, "slot": slot, **ends, **fields})


def command(uav: str, slot: int, start_m: Point = HERE, target_m: Point = HERE, **fields: Any) -> Command:
    """Return a command of head a in term 1."""
    ends = {"start_x_m": start_m[0], "start_y_m": start_m[1], "target_x_m": target_m[0], "target_y_m": target_m[1]}
    return Command(**{"head": "a", "term": 1, "uav": uav, "slot": slot, **ends, **fields})


def report(slot: int, term: int = 1, head: str = "a", **fields: Any) -> Report:
    """Return the report of a head that has planned; by default without grants, of a swarm whose quorum is two."""
    return Report(**{"head": head, "slot": slot, "term": term, "status": "planned", "quorum": 2, **fields})


def hulls(places: Mapping[str, tuple[Point, Point, float]]) -> dict[str, list[Any]]:
    """Return the fields of a report that say where UAVs may be: id -> (one end, other end, radius_m)."""
    found = list(places.values())
    return {
        "hull_uav": list(places),
        "hull_ax_m": [a_m[0] for a_m, _, _ in found],
        "hull_ay_m": [a_m[1] for a_m, _, _ in found],
        "hull_bx_m": [b_m[0] for _, b_m, _ in found],
        "hull_by_m": [b_m[1] for _, b_m, _ in found],
        "hull_r_m": [radius_m for *_, radius_m in found],
    }


def node(flown: MissionMessage, uav: str, promise: Promise | None, energy_j: float = 9e3, **fields: Any) -> UavNode:
    """Return a UAV at its start in the roster, with this promise on its disk."""
    start = next(one for one in flown.roster if one.uav == uav)
    body = Airframe(x_m=start.start_x_m, y_m=start.start_y_m, energy_j=energy_j)
    return UavNode(flown, uav, f"{uav}-1", promise, body, **fields)


class North:
    """A planner that sends everybody a metre north, and keeps its requests."""

    def __init__(self) -> None:
        self.requests: list[PlanRequest] = []

    def plan(self, request: PlanRequest) -> Plan:
        """Return a step of one metre north for everybody."""
        self.requests.append(request)
        return Plan([(float(x), float(y) + 1.0) for x, y in request.position_m], "no-qp-needed")
