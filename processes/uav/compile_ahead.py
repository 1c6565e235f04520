"""Compilation of the planner as part of an installation: `python -m processes.uav.compile_ahead`.

Without it the first flight does so. Code is kept for the processor of this machine, or that of NUMBA_CPU_NAME.
"""

from __future__ import annotations

import sys

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.zone import Zone
from processes.runtime.compiling import CompilingNote
from processes.runtime.voice import Voice
from processes.uav.planner_loader import warm_planner

ANY_ZONE = Zone(name="fence", kind="inclusion", polygon=[(-1.0, -1.0), (101.0, -1.0), (101.0, 101.0), (-1.0, 101.0)])
"""Any zone: missions with zones need more code than others."""


def main() -> int:
    """Compile all that any mission needs, or load it if it is compiled."""
    compiling = CompilingNote(Voice())
    warm_planner(Mission(zone=[ANY_ZONE]), compiling.tell, helped=True)
    compiling.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
