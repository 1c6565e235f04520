"""Planners behind one small interface (`edc_swarm.planner.interface`).

>>> from edc_swarm.planner import make_planner
"""

from edc_swarm.planner.interface import Hull, Plan, Planner, PlanRequest, Stopwatch
from edc_swarm.planner.registry import check_planner, make_planner, warm_up

__all__ = ["Hull", "Plan", "PlanRequest", "Planner", "Stopwatch", "check_planner", "make_planner", "warm_up"]
