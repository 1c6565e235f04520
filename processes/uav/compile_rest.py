"""The second process of a first start: `python -m processes.uav.compile_rest PARENT`, the mission on standard input.

It compiles the share of the guidance that the first process leaves to it (`edc_swarm.planner.first_start`), and ends.
"""

from __future__ import annotations

import signal
import sys

import msgspec

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner.first_start import compile_rest
from processes.runtime.parent import die_with_parent


def main() -> int:
    """Compile; whatever fails here is compiled, and told, by the first process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(int(sys.argv[1]))
    compile_rest(msgspec.json.decode(sys.stdin.buffer.read(), type=Mission))
    return 0


if __name__ == "__main__":
    sys.exit(main())
