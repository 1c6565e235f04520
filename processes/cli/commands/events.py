"""`edc-swarm events`: the story of a recording, one line for each happening."""

from __future__ import annotations

from pathlib import Path

from edc_swarm.analysis.story import story_of
from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.recording.reader import read_recording
from processes.runtime.console import print_json, print_line, stdout_console


def events(recording: Path, /, *, json: bool = False, verbose: bool = False) -> int:
    """Print what happened in a recorded mission: elections, arrivals, faults, deaths, holds and why, landings.

    Parameters
    ----------
    recording
        The recording, FILE.mcap.
    json
        Print JSON: all happenings, also those that only --verbose prints.
    verbose
        Print short holds and other details too.
    """
    story = story_of(read_recording(recording))
    if json:
        print_json({"happenings": story.happenings, "left_out": story.left_out})
        return 0
    console = stdout_console()
    for happening in story.happenings:
        if verbose or happening.level != "detail":
            print_line(shown(str(happening), MAX_LINE), console)
    if story.left_out:
        print(f"... and {story.left_out} more")
    return 0
