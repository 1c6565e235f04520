"""A planner whose import makes the UAV processes that are forked afterwards fail or wait, before they connect."""

from __future__ import annotations

import os
import sys
import time

from processes.uav.process import UavSettings
from tests.processes.resting import Resting

FAILING = "EDC_SWARM_TEST_FAILING"
"""Environment variable: the ids of the UAVs that raise an exception at their start, separated by commas."""
WAIT_S = 60.0


class Failing(Resting):
    """Planner that moves no UAV."""


def _run_uav(settings: UavSettings, *, obey_ctrl_c: bool) -> int:
    del obey_ctrl_c
    if settings.uav in os.environ.get(FAILING, "").split(","):
        raise RuntimeError(f"planted in {settings.uav}")
    time.sleep(WAIT_S)
    return 0


if hasattr(sys.modules["__main__"], "ForkSource"):
    vars(sys.modules["__main__"])["run_uav"] = _run_uav
