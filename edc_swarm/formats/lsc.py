"""Missions of lsc_planner (J. Park et al., ICRA 2022; JSON), if all agents stay at one altitude."""

from __future__ import annotations

from typing import Any

from edc_swarm.errors import FormatError
from edc_swarm.formats.content import Area, Content, Options, Route, Stop, number
from edc_swarm.formats.json_values import as_list, as_table, as_word, json_value
from edc_swarm.mission.field_types import MAX_UAVS

READ = frozenset({"type", "start", "goal", "cid"})
TYPE_READ = frozenset({"max_vel", "radius"})


def read_lsc(data: bytes, options: Options) -> Content:
    """Return a route per agent, and the world as inclusion zone.

    Raises
    ------
    FormatError
        Besides what is malformed: two positions differ in altitude.
    """
    del options
    mission = as_table("the file", json_value(data))
    content = Content(frame="local")
    kinds = as_table("quadrotors", mission.get("quadrotors", {}))
    agents = as_list("agents", mission.get("agents"))
    if not 0 < len(agents) <= MAX_UAVS:
        raise FormatError("agents", f"{len(agents)} agents: must be from 1 to {MAX_UAVS}")
    height_m: float | None = None
    for index, value in enumerate(agents, 1):
        item = f"agent {index}"
        agent = as_table(item, value)
        points = [_point(f"{item} {key}", agent.get(key), 3) for key in ("start", "goal")]
        height_m = points[0][2] if height_m is None else height_m
        for x_m, y_m, z_m in points:
            if z_m != height_m:
                raise FormatError(item, f"({x_m:g}, {y_m:g}, {z_m:g}): must be at z = {height_m:g}, as agent 1 is")
        content.routes.append(_route(item, agent, points, kinds, content))
        for key in sorted(agent.keys() - READ):
            content.note(f"field {key[:40]} of an agent", item)
    if height_m:
        content.note(
            "altitude: the mission is flown in a plane", *(f"agent {index}" for index in range(1, len(agents) + 1))
        )
    content.areas = _world(mission, content)
    for key in sorted(mission.keys() - {"quadrotors", "agents", "world"}):
        if mission[key]:
            content.note(f"field {key[:40]}", key[:40])
    return content


def _route(
    item: str, agent: dict[str, Any], points: list[list[float]], kinds: dict[str, Any], content: Content
) -> Route:
    name = as_word(agent.get("type", "default"))
    if name not in kinds:
        raise FormatError(item, f"type = {name!r}: must be one of the quadrotors of the file")
    kind = as_table(f"quadrotor {name}", kinds[name])
    for key in sorted(kind.keys() - TYPE_READ):
        content.note(f"field {key[:40]} of a quadrotor", f"quadrotor {name}")
    speeds = _point(f"quadrotor {name} max_vel", kind.get("max_vel"), 3)
    if speeds[0] != speeds[1]:
        content.note("largest speeds that differ by axis: the least is taken", f"quadrotor {name}")
    radius_m = number(f"quadrotor {name}", "radius", kind.get("radius"))
    stops = [Stop(f"{item} {key}", (x_m, y_m)) for key, (x_m, y_m, _) in zip(("start", "goal"), points, strict=True)]
    return Route(item, stops, v_max_mps=min(speeds[:2]), r_m=radius_m)


def _world(mission: dict[str, Any], content: Content) -> list[Area]:
    areas = []
    for index, value in enumerate(as_list("world", mission.get("world", [])), 1):
        item = f"world {index}"
        box = _point(f"{item} dimension", as_table(item, value).get("dimension"), 6)
        west, south, _, east, north, _ = box
        corners = [(west, south), (east, south), (east, north), (west, north)]
        areas.append(Area(item, "world" if index == 1 else item, "inclusion", corners))
        content.note("lower and upper end of the world", item)
    return areas


def _point(item: str, value: Any, length: int) -> list[float]:
    values = as_list(item, value)
    if len(values) != length:
        raise FormatError(item, f"{len(values)} numbers: must be {length}")
    return [number(item, "coordinate", each) for each in values]
