"""Commands from the ground, carried out by the operator if the user allowed them."""

from __future__ import annotations

from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.ground_orders import GroundOrder, GroundOrders
from edc_swarm.protocol.messages import MissionMessage
from processes.operator.fault_injector import Injector, Processes

MAX_ORDERS_AT_ONCE = 250
"""Most orders that the operator carries out between two looks at the bus."""


class GroundCommands:
    """Executor of the orders that the bridge publishes; without permission it refuses each."""

    def __init__(self, mission: MissionMessage, processes: Processes, injector: Injector, *, permitted: bool) -> None:
        self._orders = GroundOrders(mission)
        self._processes = processes
        self._injector = injector
        self._permitted = permitted

    @property
    def pauses(self) -> bool:
        """True while a UAV pauses: then the mission is not over, even if every UAV is where it is to be."""
        return self._orders.pauses

    def carry_out_due(self) -> None:
        """Carry out the orders that have come."""
        bus = self._processes.bus
        for uav in sorted(bus.monitor.grounded if bus.monitor is not None else ()):
            self._orders.forget(uav)
        for _ in range(min(len(bus.ordered), MAX_ORDERS_AT_ONCE)):
            self._carry_out(bus.ordered.popleft())

    def _carry_out(self, order: GroundOrder) -> None:
        monitor = self._processes.bus.monitor
        if not self._permitted:
            self._refuse(order, "the run was not started with --mavlink-commands")
            return
        fix = monitor.fix_of(order.uav) if monitor is not None else None
        if fix is not None:
            self._orders.hear_fix(fix)
        found = self._orders.carried_out_by(order, round(max(0.0, self._injector.now_s), 3))
        if isinstance(found, str):
            self._refuse(order, found)
        else:
            self._injector.inject(found)

    def _refuse(self, order: GroundOrder, why: str) -> None:
        self._processes.bus.publish_event(EventKind.GROUND_REFUSED, f"{order.wish} {order.uav}: {why}")
