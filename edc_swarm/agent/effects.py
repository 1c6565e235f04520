"""Events that `UavNode.step` processes, and effects that it returns."""

from __future__ import annotations

from dataclasses import dataclass

from edc_swarm.agent.vehicle import Airframe, Promise
from edc_swarm.mission.faults import VehicleFault
from edc_swarm.planner.interface import Planner
from edc_swarm.protocol.messages import Message


@dataclass(frozen=True, slots=True)
class Tick:
    """Passage of time: the node reads `now_ns`."""


@dataclass(frozen=True, slots=True)
class Received:
    """A decoded message from the bus."""

    message: Message


@dataclass(frozen=True, slots=True)
class PeerGone:
    """Loss of a UAV's liveliness token while the own link to the router was up."""

    uav: str


@dataclass(frozen=True, slots=True)
class PlannerReady:
    """The planner that the node wanted, loaded and warm."""

    planner: Planner


@dataclass(frozen=True, slots=True)
class Disturbed:
    """A fault of the vehicle: of its GPS or its motors, a gust, or an order to land."""

    fault: VehicleFault


@dataclass(frozen=True, slots=True)
class Strayed:
    """News that the vehicle no longer follows its commands; `why` in words."""

    why: str


NodeEvent = Tick | Received | PeerGone | PlannerReady | Disturbed | Strayed


@dataclass(frozen=True, slots=True)
class Persist:
    """Write the promise and the emulated body before the next effect."""

    promise: Promise | None
    airframe: Airframe


@dataclass(frozen=True, slots=True)
class Publish:
    """Publish a message on the bus; the shell sets `sent_ns` from its clock."""

    message: Message


@dataclass(frozen=True, slots=True)
class Listen:
    """Subscribe to all fixes of the own cluster, or unsubscribe; and to those of the UAVs `near` of other clusters.

    A UAV that hears such fixes hears the reports of their clusters too.
    """

    all_fixes: bool
    near: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class WantPlanner:
    """Load the planner and return it with `PlannerReady`: this UAV may have to lead.

    If `rehearsed`, it makes a plan before, so that its first one in flight is fast. A UAV on duty in flight has no time
    for that: all wait for it. On a crowded machine a plan takes many slots, in which it would hear nobody.
    """

    rehearsed: bool = True


@dataclass(frozen=True, slots=True)
class Land:
    """End of this UAV: it lands at its waypoint and never flies again."""


Effect = Persist | Publish | Listen | WantPlanner | Land
