"""One UAV of a mission: table `[[roster]]`."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import force_setattr

from edc_swarm.mission.field_types import (
    MAX_ROUTE,
    MOST_M,
    ClusterName,
    Metres,
    NonNegative,
    Point,
    Positive,
    UavId,
)
from edc_swarm.mission.vehicle_model import OwnVehicle

ARRIVED_M = 0.1
"""A UAV closer than this to its target has arrived."""


LACKS_TARGET = "a table with target_x_m and target_y_m, or with a route"
"""What an entry of the roster must be, in words."""


class RosterEntry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One UAV: its start, its target or route, and what differs from the other UAVs.

    A field that is 0 or left out is inherited from the mission; `roster.complete_mission` fills it in.

    Source: the user; a random mission draws it.
    """

    uav: UavId
    """Id of the UAV, which no other UAV has.

    Ids of processes are reserved: operator, recorder, viz, ground, router, join, ca.
    """
    start_x_m: Metres
    """Start, first coordinate in the local frame (east).

    The discs of all UAVs at their starts are disjoint.
    """
    start_y_m: Metres
    """Start, second coordinate in the local frame (north)."""
    target_x_m: Metres = math.nan
    """Target, first coordinate in the local frame (east).

    The discs of all UAVs at their targets are disjoint.

    Default: the last point of `route`.
    """
    target_y_m: Metres = math.nan
    """Target, second coordinate in the local frame (north).

    Default: the last point of `route`.
    """
    route: Annotated[list[Point], Meta(max_length=MAX_ROUTE)] = []
    """Points (x, y) that the UAV flies to one after another; the last one is its target.

    Default: empty, which stands for the target alone.
    """
    accept_m: Annotated[float, Meta(ge=ARRIVED_M, le=MOST_M)] = 1.0
    """Acceptance radius: a step that comes as near as this to a point of the route, but the last, has reached it."""
    hover_s: Annotated[list[NonNegative], Meta(max_length=MAX_ROUTE)] = []
    """Times for which the UAV hovers within `accept_m` of each point of its route, as many as points.

    At the last point the UAV stays in any case.
    """
    finish_by_s: NonNegative = 0.0
    """Mission time by which the UAV is to be at its target, the paper's t_F; 0: no such time.

    Metrics and summary say whether it was met. No plan depends on it.

    Source: the paper, section II.
    """
    r_m: NonNegative = 0.0
    """GPS error radius of this UAV.

    Default: 0, which stands for `r_m` of the mission.
    """
    body_m: NonNegative = 0.0
    """Radius of the vehicle itself.

    At most `r_m` of this UAV.

    Default: 0, which stands for `body_m` of the mission.
    """
    gps_m: NonNegative = 0.0
    """GPS error bound of this UAV.

    Default: 0, which stands for `gps_m` of the mission.
    """
    vehicle: OwnVehicle = ""
    """Vehicle of this UAV, with all figures of the named parameter set.

    Default: "", which stands for table `[vehicle]` of the mission.
    """
    v_max_mps: Annotated[float, Meta(ge=0, le=1e4)] = 0.0
    """Largest speed of this UAV, the paper's V_k,Max.

    Default: 0, which stands for `v_max_mps` of the mission.
    Source: the paper, eq. 36.
    """
    energy_j: NonNegative = 0.0
    """Charge of the battery at the start.

    A UAV whose battery is empty lands where it is; with `failsafe = "hold"` it stays an obstacle. The charge covers at
    least one step at full speed, unless the UAV starts at its target.

    Default: 0, which stands for a charge that `seed` draws, as in a random mission.
    """
    cluster: ClusterName = ""
    """Name of the cluster of this UAV.

    Every cluster elects a head of its own. Either all entries name their cluster, or none does.

    Default: "", which stands for the cluster that `clusters` of the mission gives it.
    Source: the paper's word for the UAVs of one head.
    """
    compute_factor: Positive = 1.0
    """Factor on the response time that the UAV reports, for the election criterion `response-time`.

    Source: this project.
    """

    def __post_init__(self) -> None:
        """Take the target from the route if no target is given."""
        if self.route and math.isnan(self.target_x_m) and math.isnan(self.target_y_m):
            force_setattr(self, "target_x_m", self.route[-1][0])
            force_setattr(self, "target_y_m", self.route[-1][1])
        if math.isnan(self.target_x_m) or math.isnan(self.target_y_m):
            raise ValueError(LACKS_TARGET)

    @property
    def points(self) -> list[Point]:
        """Points that the UAV flies to one after another: its route, or its target alone."""
        return self.route or [(self.target_x_m, self.target_y_m)]

    @property
    def straight_m(self) -> float:
        """Length of the straight lines from the start through all points of the route to the target, in metres."""
        return sum(
            math.hypot(x - u, y - v) for (u, v), (x, y) in pairwise(((self.start_x_m, self.start_y_m), *self.points))
        )
