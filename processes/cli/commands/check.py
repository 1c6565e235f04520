"""`edc-swarm check`: the guarantees, checked on a recording."""

from __future__ import annotations

from pathlib import Path

from edc_swarm.analysis.outcome import not_home_of
from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.recording.reader import read_recording
from processes.cli.summary import guarantees_status, print_guarantees
from processes.experiments.judging import judged
from processes.runtime.console import print_json, print_line, stdout_console


def check(recording: Path, /, *, load_planner: bool = False, json: bool = False) -> int:
    """Check every guarantee on a recording.

    Exit status 0: every guarantee that applies was judged and held; 1: one is broken; 3: none is broken, but one
    could not be judged. A simulated mission is simulated again (G6), with the planner that the recording names: with
    one that is not this project's only with --load-planner, since that runs its code. UAVs that are not at their
    targets are named; that alone is no broken guarantee.

    Parameters
    ----------
    recording
        The recording, FILE.mcap.
    load_planner
        Import and run the planner that the recording names, a user's too: only for recordings that you trust.
    json
        Print JSON.
    """
    whole = read_recording(recording)
    results = judged(whole, show_progress=not json, load_planner=load_planner)
    if json:
        print_json(results)
    else:
        console = stdout_console()
        print_guarantees(results, console)
        for who in not_home_of(whole):
            print_line(shown(f"{who}" if who.is_unknown else f"not home: {who}", MAX_LINE), console)
    return guarantees_status(results)
