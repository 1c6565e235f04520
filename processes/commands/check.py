"""`edc-swarm check`: the guarantees, checked on a recording."""

from __future__ import annotations

from pathlib import Path

from edc_swarm.invariants import check as check_guarantees
from edc_swarm.recording import read_recording
from processes.console import print_json, stdout_console
from processes.summary import guarantees_status, print_guarantees


def check(recording: Path, /, *, json: bool = False) -> int:
    """Check guarantees G1-G5 and G7 on a recording; exit status 1 when one is broken, 3 when one cannot be judged.

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
    return guarantees_status(results)
