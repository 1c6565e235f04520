"""`edc-swarm check`: the guarantees, checked on a recording."""

from __future__ import annotations

from pathlib import Path

from edc_swarm.invariants import check as check_guarantees
from edc_swarm.recording import read_recording
from processes.console import FAILED, print_json, stdout_console
from processes.summary import print_guarantees


def check(recording: Path, /, *, json: bool = False) -> int:
    """Check guarantees G1-G5 and G7 on a recording; exit status 1 when one is broken.

    Parameters
    ----------
    recording
        The recording, FILE.mcap.
    json
        Print JSON.
    """
    results = check_guarantees(read_recording(recording))
    if json:
        print_json(results)
    else:
        print_guarantees(results, stdout_console())
    return 0 if all(result.held for result in results) else FAILED
