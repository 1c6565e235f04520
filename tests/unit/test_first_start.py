"""The planner is compiled in two shares, each of which has what the other lacks."""

from __future__ import annotations

import os
import subprocess
import sys

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.first_start import can_share, compile_search
from edc_swarm.planner.registry import warm_up
from processes.uav.compiling_helper import Helper

OF_USE = can_share() and len(os.sched_getaffinity(0)) > 1
REST = """
import msgspec
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner.first_start import compile_rest
search = kernel.sweep
compile_rest(Mission())
print(len(search.signatures), len(kernel.populate.signatures), len(kernel.way_round.signatures))
"""


def test_the_search_is_compiled_once_for_rehearsal_and_flight() -> None:
    """Data of another type or memory layout in the rehearsal would cost the whole compilation a second time."""
    compile_search()
    warm_up(Mission())
    assert len(kernel.sweep.signatures) == 1  # type: ignore[attr-defined]


def test_the_other_share_is_all_but_the_search() -> None:
    """The second process neither compiles nor loads the search."""
    made = subprocess.run([sys.executable, "-c", REST], capture_output=True, text=True, check=True)
    assert made.stdout.split() == ["0", "1", "1"]


def test_the_helper_compiles_its_share_and_ends() -> None:
    """It starts once, at the first compilation, and only if it is wanted and of use."""
    for wanted in (False, True):
        with Helper(Mission(), wanted=wanted) as helper:
            helper.begin()
            first = helper.process
            helper.begin()
            helper.wait()
            assert helper.process is first
            assert (first is not None) == (wanted and OF_USE)
            assert first is None or first.returncode == 0


def test_a_helper_that_is_left_ends_at_once() -> None:
    """An interrupted start leaves no process."""
    with Helper(Mission(), wanted=True) as helper:
        helper.begin()
    assert (helper.process is not None) == OF_USE
    assert helper.process is None or helper.process.returncode is not None
