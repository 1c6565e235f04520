"""The layout of a viewer: the swarm from above, plan time, gaps, head and term, a map, the log."""

from __future__ import annotations

import math
from typing import Any

from edc_swarm.geodesy import to_wgs84
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.viz import channels
from edc_swarm.viz.channels import ROOT
from edc_swarm.viz.scenery import extent_m

LAYOUT_ATTACHMENT = "foxglove-layout.json"
GRID_M = 20.0
MAX_DIVISIONS = 50
SCENE, PLAN, GAP, HEAD, LOG, MAP = "3D!swarm", "Plot!plan", "Plot!gap", "StateTransitions!head", "RosOut!log", "map!gps"
HEIGHTS = {PLAN: 19, GAP: 19, HEAD: 21, MAP: 19, LOG: 22}
"""Panels of the right-hand column with their shares of its height in per cent; two rows of transitions need 21."""
MAP_PX = 110
"""Height of the map panel at these shares, in pixels."""
TILE_MPP = 156_543.034
"""Metres per pixel of web map tiles at zoom 0 on the equator."""
BLUE, ORANGE, RED = "#4e98e2", "#f5a04e", "#ff4d4d"
_SHOWN = (channels.AREA, channels.TRAILS, channels.HULLS, channels.COMMANDS, channels.UAVS)


def layout(mission: MissionMessage) -> dict[str, Any]:
    """Return a layout for Foxglove and for Lichtblick whose camera shows the whole area of `mission`.

    Viewers hide every topic that no layout shows.
    """
    (left_m, low_m), (right_m, high_m) = extent_m(mission)
    middle_m, size_m = [(left_m + right_m) / 2, (low_m + high_m) / 2, 0.0], max(right_m - left_m, high_m - low_m)
    return {
        "configById": {
            SCENE: _titled("Swarm from above", _scene(middle_m, size_m)),
            PLAN: _titled("Plan time (ms)", _plot(plan_ms=("plan", BLUE), plan_limit_ms=("limit", RED))),
            GAP: _titled(
                "Least gap (m)",
                _plot(gap_m=("now", BLUE), planned_gap_m=("planned", ORANGE), gap_limit_m=("limit", RED)),
            ),
            HEAD: _titled("Head and term", {"isSynced": True, "paths": [_path("head"), _path("term")]}),
            LOG: _titled("Log", {"searchTerms": [], "minLogLevel": 2}),
            MAP: _titled("GPS", _map(mission, middle_m, size_m)),
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "splitPercentage": 62,
            "first": SCENE,
            "second": _column(list(HEIGHTS)),
        },
    }


def _titled(title: str, config: dict[str, Any]) -> dict[str, Any]:
    """Return a panel with its title under the key of each of the two viewers."""
    return {**config, "foxglovePanelTitle": title, "lichtblickPanelTitle": title}


def _scene(middle_m: list[float], size_m: float) -> dict[str, Any]:
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
        "topics": {ROOT + name: {"visible": True} for name in _SHOWN},
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


def _column(panels: list[str]) -> Any:
    """Return the panels stacked in one column."""
    if len(panels) == 1:
        return panels[0]
    share = 100 * HEIGHTS[panels[0]] / sum(HEIGHTS[panel] for panel in panels)
    return {"direction": "column", "splitPercentage": share, "first": panels[0], "second": _column(panels[1:])}
