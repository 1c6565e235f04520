"""An example of a user's criterion: the head is the UAV nearest to the middle of all starts.

cd examples
edc-swarm sim --elect own_criterion:Central
"""

from __future__ import annotations

import math

from edc_swarm.mission.configuration import Mission
from edc_swarm.protocol.messages import Fix


class Central:
    """The distance from the middle: the least value is elected."""

    def __init__(self, mission: Mission) -> None:
        count = len(mission.roster)
        self._x_m = sum(entry.start_x_m for entry in mission.roster) / count
        self._y_m = sum(entry.start_y_m for entry in mission.roster) / count

    def value(self, fix: Fix) -> float:
        return math.dist((fix.waypoint_x_m, fix.waypoint_y_m), (self._x_m, self._y_m))
