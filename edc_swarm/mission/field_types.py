"""Types of the fields of a mission, with their limits, and the option that sets a field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

MAX_UAVS = 10_000
MAX_FAULTS = 1000
MAX_CLUSTERS = 200
MAX_LINKS = 1000
MAX_ZONES = 1000
MAX_CORNERS = 1000
MAX_ALL_CORNERS = 5000
"""Most corners of all zones together, so that the largest mission still fits into one message."""
MAX_ROUTE = 1000
MAX_GOAL_POINTS = 32
"""Most points of a route that a UAV receives in flight: it is part of its promise and of its fixes."""
MOST_SLOTS = 1_000_000

PlannerName = Annotated[str, Meta(min_length=1, max_length=200)]
Control = Literal["head", "local"]
Minimise = Literal["distance", "energy", "time"]
PartName = Annotated[str, Meta(min_length=1, max_length=200)]
"""Name of a part that is built in, or `package.module:Class` (`plug_ins`)."""
GpsModel = Literal["none", "bias", "white", "gauss-markov"]
Distribution = Literal["constant", "uniform", "normal", "lognormal"]
ZoneKind = Literal["inclusion", "exclusion"]
ZoneRule = Literal["", "disc", "centre"]
Fence = Literal["area", "none"]
FailsafeAction = Literal["hold", "land"]

UavId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$(?!\n)")]
MissionId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$(?!\n)")]
MOST_M = 1e7
MOST = 1e12
"""Largest quantity of any kind: products of a few of them are still finite."""
Metres = Annotated[float, Meta(ge=-MOST_M, le=MOST_M)]
"""A coordinate in the local frame."""
Point = tuple[Metres, Metres]
"""A point (x, y) in the local frame."""
Speed = Annotated[float, Meta(gt=0, le=1e4)]
Positive = Annotated[float, Meta(gt=0, le=MOST)]
NonNegative = Annotated[float, Meta(ge=0, le=MOST)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
ClusterName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,32}$(?!\n)")]
LinkEnd = Annotated[str, Meta(max_length=32)]
FaultText = Annotated[str, Meta(max_length=65536)]

Goals = Literal["once", "lifelong"]
GoalSource = Literal["operator", "any"]


@dataclass(frozen=True, slots=True)
class Option:
    """The option of `edc-swarm run` and `sim` that sets the annotated field, by its name without dashes."""

    name: str
