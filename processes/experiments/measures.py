"""Measurements of sweeps: functions from a mission to plain data, which worker processes call.

A `Run` names its function, so any process on any machine finds it. Each function computes its data from a simulated
recording in memory and writes no file.
"""

from __future__ import annotations

import time
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from edc_swarm.analysis.columns import columns_of
from edc_swarm.analysis.energy_bill import energy_bills, exhausted
from edc_swarm.analysis.latency_sample import sample_of
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.timings import Timing
from edc_swarm.emulation.energy import compute_energy_j
from edc_swarm.geometry import length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner.paper import horizon_program, solve_horizon
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.closed_loop import closed_loop, recording_of
from edc_swarm.simulation.simulator import Simulation
from processes.experiments.timed_planner import TimedPlanner

OF_THE_PATH = (
    "uavs",
    "completed",
    "potential_collisions",
    "min_disc_gap_m",
    "path_m",
    "straight_m",
    "extra_distance_pct",
    "makespan_s",
    "energy_propulsion_j",
    "energy_straight_j",
)
"""Metrics that are defined without agents."""
MAX_TRACE = 200
"""Most points of a battery's time series."""


def simulate(mission: Mission) -> tuple[Recording, list[Timing]]:
    """Simulate a mission, and return its recording and the measured plan times."""
    _warm_up(mission.planner)
    message = mission_message(complete_mission(mission))
    said, timings = list[Message](), list[Timing]()
    Simulation(message, lambda: TimedPlanner(message, timings), lambda _key, now, _ns: said.append(now)).run()
    return Recording.from_messages(said), sorted(timings, key=lambda timing: timing.slot)


def fly(mission: Mission) -> dict[str, Any]:
    """Return all metrics of a simulated mission."""
    recording, timings = simulate(mission)
    metrics: dict[str, Any] = msgspec.to_builtins(compute_metrics(recording, timings))
    return metrics


def fly_latency(mission: Mission) -> dict[str, Any]:
    """Return the measurements of a simulated mission of a latency experiment."""
    recording, _ = simulate(mission)
    sample: dict[str, Any] = msgspec.to_builtins(sample_of(recording))
    return sample


def fly_plan(mission: Mission) -> dict[str, Any]:
    """Return the metrics that follow from a planner's paths alone, without agents; they equal those of `fly`."""
    _warm_up(mission.planner)
    message = mission_message(complete_mission(mission))
    path_m, _ = closed_loop(message, make_planner(message.planner, message))
    metrics = msgspec.to_builtins(compute_metrics(recording_of(message, path_m)))
    return {name: metrics[name] for name in OF_THE_PATH}


def fly_long(mission: Mission) -> dict[str, Any]:
    """Return the metrics of a mission, with the energy bill and the battery's time series of every UAV."""
    recording, timings = simulate(mission)
    columns = columns_of(recording, timings)
    every = max(1, len(columns.time_s) // MAX_TRACE)
    trace: dict[str, Any] = msgspec.to_builtins(
        {
            "metrics": compute_metrics(recording, timings),
            "bills": energy_bills(recording, timings),
            "exhausted": exhausted(recording),
            "dt_s": mission.dt_s,
            "time_s": columns.time_s[::every].tolist(),
            "energy_j": columns.energy_j[::every].T.tolist(),
        }
    )
    return trace


def time_plans(mission: Mission) -> dict[str, Any]:
    """Return the wall time of planning a mission slot by slot on this machine, without agents."""
    _warm_up(mission.planner)
    whole = complete_mission(mission)
    planner = make_planner(whole.planner, whole, time.perf_counter_ns)
    path_m, plans = closed_loop(whole, planner)
    target_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in whole.roster])
    times_s = np.array([plan.guidance_ms + plan.assemble_ms + plan.solve_ms for plan in plans]) / 1e3
    return {
        "slots": len(plans),
        "completed": bool((length_m(path_m[-1] - target_m) <= ARRIVED_M).all()),
        "total_s": float(times_s.sum()),
        "median_s": float(np.median(times_s)),
        "max_s": float(times_s.max()),
        "compute_j": compute_energy_j(float(times_s.sum()), whole.head),
    }


def time_forms(mission: Mission) -> dict[str, Any]:
    """Return the wall time of one solution of the paper's model in both forms, and the distance between their paths."""
    whole = complete_mission(mission)
    start_m = np.array([(entry.start_x_m, entry.start_y_m) for entry in whole.roster])
    target_m = np.array([(entry.target_x_m, entry.target_y_m) for entry in whole.roster])
    r_m = np.array([entry.r_m for entry in whole.roster])
    spent_s, path_m, horizon = [], [], 0
    for eliminate in (False, True):
        begun_s = time.perf_counter()
        program = horizon_program(start_m, target_m, r_m, np.array(whole.steps_m), eliminate=eliminate)
        solved_m, _ = solve_horizon(program, start_m, target_m)
        spent_s.append(time.perf_counter() - begun_s)
        path_m.append(solved_m)
        horizon = program.horizon
    printed_m, eliminated_m = path_m
    apart = None
    if printed_m is not None and eliminated_m is not None:
        apart = float(length_m(printed_m - eliminated_m).max())
    return {"printed_s": spent_s[0], "eliminated_s": spent_s[1], "horizon": horizon, "apart_m": apart}


@lru_cache(maxsize=16)
def _warm_up(planner: str) -> None:
    """Import and compile the planner, so that no measured time contains it."""
    warm_up(Mission(planner=planner))
