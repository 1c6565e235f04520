"""`edc-swarm faults`: the vocabulary of faults."""

from __future__ import annotations

from edc_swarm.mission.fault_help import fault_help


def faults() -> int:
    """Print every fault: what it does, its syntax, its bounds, an example, and who carries it out."""
    print(fault_help(), end="")
    return 0
