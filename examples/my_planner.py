from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import Plan, PlanRequest, Stopwatch


class MyPlanner:
    # The mission as run; a clock in ns, which may be ignored.
    def __init__(self, mission: Mission, stopwatch: Stopwatch) -> None:
        self.steps_m = mission.steps_m  # the longest step of each UAV, in roster order

    def plan(self, request: PlanRequest) -> Plan:  # once a slot, by the head
        return Plan(waypoint_m=request.target_m, status="planned")
