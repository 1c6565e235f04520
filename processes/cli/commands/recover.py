"""`edc-swarm recover`: a complete recording, made of the torn one that a killed recorder has left."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from edc_swarm.errors import InputError
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps, unknown_tails
from processes.runtime.console import FAILED, note, print_json
from processes.runtime.output import (
    SUFFIX,
    check_output,
    is_same_file,
    locked_for_reading,
    recovered_name,
    write_recovered,
)


def recover(
    part: Path,
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    force: bool = False,
    json: bool = False,
) -> int:
    """Make a complete recording of a torn one, which ends in the middle, and keep it. Exit status 1: messages are lost.

    Parameters
    ----------
    part
        The torn recording, such as FILE.mcap.part.
    out
        The recording to write (FILE.recovered.mcap beside it).
    force
        Overwrite an existing recording.
    json
        Print the losses as JSON alone on standard output.
    """
    path = out or recovered_name(part)
    if is_same_file(path, part):
        raise InputError("--out", str(path), f"another file than the torn one, with a name in {SUFFIX}")
    check_output(path, force=force)
    with locked_for_reading(part):
        problems = write_recovered(part, path)
    recording = read_recording(path)
    gaps = sum(gap.count for gap in find_gaps(recording) if not gap.duplicate)
    tails = unknown_tails(recording)
    if json:
        facts = {"messages": recording.message_count, "gaps": gaps, "unknown_tails": len(tails), "missing": problems}
        print_json({**facts, "recording": str(path)})
        return FAILED if problems else 0
    for problem in problems:
        note(f"missing: {problem}")
    note(
        f"{recording.message_count} messages are whole, {gaps} are missing between them; of {len(tails)} streams "
        f"nobody knows whether more was said"
    )
    print(path)
    return FAILED if problems else 0
