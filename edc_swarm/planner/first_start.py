"""Compilation of the guidance in two shares, which two processes compile side by side at a first start.

Both write their code into the same folder. The share of the search is the larger one: compiled code reaches most
functions through it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import guidance_kernel
from edc_swarm.planner.guidance import Guidance, Tuning
from edc_swarm.planner.just_in_time import is_kept
from edc_swarm.planner.registry import warm_up


def can_share() -> bool:
    """Return True if compiled code is kept on disk, where the other process finds it."""
    return is_kept(guidance_kernel.sweep)


def compile_search() -> None:
    """Compile or load the search for plans, and nothing else."""
    Guidance(np.ones(2), np.full((2, 2), 0.5), 0, Tuning()).rehearse()


def compile_rest(mission: Mission) -> None:
    """Compile all that a mission needs but the search, in a process that never plans."""
    kernel: Any = guidance_kernel
    kernel.sweep = _nothing
    warm_up(mission)


def _nothing(*_: object) -> None:
    """Leave all plans as they are."""
