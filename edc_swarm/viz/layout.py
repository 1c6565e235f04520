"""The layout of a viewer: the swarm from above, plan time, gaps, head and term, a map, the log."""

from __future__ import annotations

import math
from typing import Any

from edc_swarm.geodesy import to_wgs84
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.viz import channels
from edc_swarm.viz.channels import ROOT
from edc_swarm.viz.layers import MANY_UAVS
from edc_swarm.viz.scenery import extent_m

LAYOUT_ATTACHMENT = "foxglove-layout.json"
GRID_M = 20.0
MAX_DIVISIONS = 50
SCENE, PLAN, GAP, HEAD, LOG, MAP = "3D!swarm", "Plot!plan", "Plot!gap", "StateTransitions!head", "RosOut!log", "map!gps"
BATTERY, LINKS, PLOTS, BELOW = "Plot!battery", "Plot!links", "Tab!plots", "Tab!below"
HEIGHTS = {PLOTS: 36, HEAD: 30, BELOW: 34}
"""Panels of the right-hand column with their shares of its height in per cent."""
TABS: dict[str, dict[str, tuple[str, ...]]] = {
    PLOTS: {"Flight": (PLAN, GAP), "Battery, links": (BATTERY, LINKS)},
    BELOW: {"Log": (LOG,), "Map": (MAP,)},
}
"""Panels that share a place, by the name of their tab."""
BUSY = frozenset({channels.LABELS, channels.GOALS, channels.LINKS})
"""Layers that begin switched off above `MANY_UAVS`."""
MAP_PX = 180
"""Height of the map panel at these shares, in pixels."""
TILE_MPP = 156_543.034
"""Metres per pixel of web map tiles at zoom 0 on the equator."""
BLUE, ORANGE, RED = "#4e98e2", "#f5a04e", "#ff4d4d"


def layout(mission: MissionMessage) -> dict[str, Any]:
    """Return a layout for Foxglove and for Lichtblick whose camera shows the whole area of `mission`.

    Viewers hide every topic that no layout shows. The least gap has the scale of a disc's radius, since the gaps that
    matter are near 0; the limit of the plan time is in the title, since a line at it would flatten the plan times: it
    has one where a plan comes near it.
    """
    limit_ms = 1e3 * (mission.dt_s - mission.tau_s) / mission.time_scale
    top_m = max((entry.r_m for entry in mission.roster), default=0.0) or 1.0
    (left_m, low_m), (right_m, high_m) = extent_m(mission)
    middle_m, size_m = [(left_m + right_m) / 2, (low_m + high_m) / 2, 0.0], max(right_m - left_m, high_m - low_m)
    return {
        "configById": {
            SCENE: _titled("Swarm from above", _scene(middle_m, size_m, len(mission.roster))),
            PLAN: _titled(
                f"Plan time (ms); the limit is {limit_ms:g} ms",
                _plot(plan_ms=("plan", BLUE), plan_limit_near_ms=("limit", RED)),
            ),
            GAP: _titled(
                f"Least gap (m), up to {top_m:g} m",
                {
                    **_plot(gap_m=("now", BLUE), planned_gap_m=("planned", ORANGE), gap_limit_m=("limit", RED)),
                    "minYValue": -top_m / 5,
                    "maxYValue": top_m,
                },
            ),
            BATTERY: _titled(
                "Battery (%)",
                {**_plot(least_battery_pct=("least", BLUE), mean_battery_pct=("mean", ORANGE)), "minYValue": 0},
            ),
            LINKS: _titled(
                "UAVs that the head does not hear, oldest fix (slots)",
                _plot(unheard=("not heard", BLUE), oldest_fix_slots=("oldest fix", ORANGE)),
            ),
            HEAD: _titled("Head, term, faults and warnings", {"isSynced": True, "paths": _rows()}),
            LOG: _titled("Log", {"searchTerms": [], "minLogLevel": 2}),
            MAP: _titled("GPS", _map(mission, middle_m, size_m)),
            **{panel: {"activeTabIdx": 0, "tabs": _tabs(tabs)} for panel, tabs in TABS.items()},
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "splitPercentage": 62,
            "first": SCENE,
            "second": _column(HEIGHTS),
        },
    }


def _titled(title: str, config: dict[str, Any]) -> dict[str, Any]:
    """Return a panel with its title under the key of each of the two viewers."""
    return {**config, "foxglovePanelTitle": title, "lichtblickPanelTitle": title}


def _scene(middle_m: list[float], size_m: float, uavs: int) -> dict[str, Any]:
    step_m = GRID_M
    while 2 * size_m > MAX_DIVISIONS * step_m:
        step_m *= 5
    divisions = math.ceil(2 * size_m / step_m)
    grid = {
        "layerId": "foxglove.Grid",
        "instanceId": "grid",
        "label": "Grid",
        "visible": True,
        "frameLocked": True,
        "size": divisions * step_m,
        "divisions": divisions,
        "lineWidth": 1,
        "color": "#ffffff18",
        "position": middle_m,
        "rotation": [0, 0, 0],
        "order": 1,
    }
    camera = {
        "perspective": False,
        "distance": 1.15 * size_m,
        "phi": 0,
        "thetaOffset": 0,
        "target": [0, 0, 0],
        "targetOffset": middle_m,
        "targetOrientation": [0, 0, 0, 1],
        "fovy": 45,
        "near": 0.5,
        "far": 5000,
    }
    return {
        "cameraState": camera,
        "followMode": "follow-none",
        "followTf": "map",
        "scene": {"backgroundColor": "#101418", "labelScaleFactor": 1},
        "transforms": {},
        "topics": {
            ROOT + name: {"visible": uavs <= MANY_UAVS or name not in BUSY} for name in channels.SCENES_OF_A_MISSION
        },
        "layers": {"grid": grid},
    }


def _map(mission: MissionMessage, middle_m: list[float], size_m: float) -> dict[str, Any]:
    """Return a map zoomed to the whole area; the viewers' default is zoom 10, at which a swarm is one dot."""
    lat_deg, lon_deg = to_wgs84(middle_m[0], middle_m[1], mission.origin_lat_deg, mission.origin_lon_deg)
    zoom = math.log2(TILE_MPP * math.cos(math.radians(lat_deg)) * MAP_PX / size_m)
    return {
        "layer": "map",
        "followTopic": "",
        "disabledTopics": [],
        "center": {"lat": lat_deg, "lon": lon_deg},
        "zoomLevel": math.floor(zoom),
    }


def _plot(**series: tuple[str, str]) -> dict[str, Any]:
    """Return a plot of status values, each with label and colour, and a legend beside the plot that covers no line."""
    return {
        "paths": [{**_path(name), "label": label, "color": colour} for name, (label, colour) in series.items()],
        "xAxisVal": "timestamp",
        "showLegend": True,
        "legendDisplay": "left",
        "sidebarDimension": 100,
        "showPlotValuesInLegend": False,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "isSynced": True,
    }


def _path(name: str) -> dict[str, Any]:
    return {"value": f"{ROOT}{channels.STATUS}.{name}", "enabled": True, "timestampMethod": "receiveTime"}


def _rows() -> list[dict[str, Any]]:
    """Return the rows of the timeline: head and term, and the story's warnings, of which faults are some."""
    told = f'{ROOT}{channels.STORY}{{level=="warning"}}.words'
    warnings = {"value": told, "enabled": True, "timestampMethod": "receiveTime"}
    rows = {"head": _path("head"), "term": _path("term"), "fault or warning": warnings}
    return [{**path, "label": name} for name, path in rows.items()]


def _tabs(tabs: dict[str, tuple[str, ...]]) -> list[dict[str, Any]]:
    return [{"title": title, "layout": _column(dict.fromkeys(panels, 1))} for title, panels in tabs.items()]


def _column(heights: dict[str, int]) -> Any:
    """Return the panels stacked in one column, with their shares of its height."""
    first, *rest = heights
    if not rest:
        return first
    share = 100 * heights[first] / sum(heights.values())
    below = _column({panel: heights[panel] for panel in rest})
    return {"direction": "column", "splitPercentage": share, "first": first, "second": below}
