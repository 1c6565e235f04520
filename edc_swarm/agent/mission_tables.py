"""Tables of one mission that its UAVs only read. A process makes its own; all UAVs of a simulation share one.

Tables of all UAVs for each UAV would cost K^2, and most UAVs never lead.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Generic, TypeVar

from edc_swarm.agent.knowledge import HullRules
from edc_swarm.mission.braking import braking_m, change_of
from edc_swarm.mission.clusters import of_cluster
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_budget import grown_r_m, vehicle_of
from edc_swarm.protocol.backing import Backing
from edc_swarm.protocol.messages import roster_index

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

M = TypeVar("M", bound=Mission)


class MissionTables(Generic[M]):
    """Tables of all UAVs of a mission, by id or in roster order, each made when it is first used."""

    def __init__(self, mission: M) -> None:
        self.mission = mission
        self._clusters: dict[str, M] = {}
        self._members: dict[str, dict[str, RosterEntry]] = {}

    def of_cluster(self, name: str) -> M:
        """Return the mission as a cluster flies it."""
        if name not in self._clusters:
            self._clusters[name] = of_cluster(self.mission, name)
        return self._clusters[name]

    def members(self, name: str) -> dict[str, RosterEntry]:
        """Return the UAVs of a cluster, in roster order."""
        if name not in self._members:
            self._members[name] = {entry.uav: entry for entry in self.of_cluster(name).roster}
        return self._members[name]

    @cached_property
    def entries(self) -> dict[str, RosterEntry]:
        """Roster entry of every UAV."""
        return {entry.uav: entry for entry in self.mission.roster}

    @cached_property
    def index(self) -> dict[str, int]:
        """Roster index of every UAV."""
        return roster_index(self.mission.roster)

    @cached_property
    def backing(self) -> Backing:
        """Quorums of all clusters."""
        return Backing(self.mission)

    @cached_property
    def rules(self) -> HullRules:
        """Constants that hulls depend on."""
        mission = self.mission
        steps_m = {entry.uav: mission.step_m(entry) for entry in mission.roster}
        return HullRules(steps_m, mission.lag_slots, {entry.uav: change_of(mission, entry) for entry in mission.roster})

    @cached_property
    def r_m(self) -> dict[str, float]:
        """Widest disc of every UAV."""
        return {entry.uav: grown_r_m(self.mission, entry) for entry in self.mission.roster}

    @cached_property
    def free_m(self) -> dict[str, float]:
        """Way of every UAV in a slot if it flies freely."""
        mission = self.mission
        return {entry.uav: vehicle_of(mission, entry).free_mps * mission.dt_s for entry in mission.roster}

    @cached_property
    def longest_m(self) -> tuple[float, float]:
        """Longest step and longest braking path of any UAV."""
        step_m = max(self.rules.u_max_m.values())
        return step_m, max(braking_m(step_m, change_m) for change_m in self.rules.change_m.values())

    @cached_property
    def starts_m(self) -> NDArray[np.float64]:
        """Start of every UAV, a column each."""
        return _array([[entry.start_x_m, entry.start_y_m] for entry in self.mission.roster]).T

    @cached_property
    def reaches_m(self) -> NDArray[np.float64]:
        """Longest step and longest braking path of every UAV, a column each."""
        rules = self.rules
        return _array([[step_m, braking_m(step_m, rules.change_m[uav])] for uav, step_m in rules.u_max_m.items()]).T


def _array(rows: list[list[float]]) -> NDArray[np.float64]:
    import numpy as np  # noqa: PLC0415 - a UAV that is not in office starts without it

    return np.array(rows, dtype=np.float64)
