"""`edc-swarm merge`: one recording, made from those of several recorders of one mission."""

from __future__ import annotations

from contextlib import ExitStack
from itertools import combinations
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from edc_swarm.errors import InputError
from edc_swarm.recording.merging import MAX_FILES
from edc_swarm.recording.merging import merge as write_merged
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps, unknown_tails
from processes.runtime.console import FAILED, note, print_json
from processes.runtime.output import check_output, is_same_file, locked_for_reading, new_file


def merge(
    recordings: list[Path],
    /,
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    force: bool = False,
    json: bool = False,
) -> int:
    """Make one recording of what several recorders wrote of one mission, such as one on each host.

    A message that one of them lacks is taken from another. Exit status 1: messages are missing between those of the
    result, or the recordings contradict each other. A torn recording gives what is readable of it; one that is
    torn before its mission is left out.

    Parameters
    ----------
    recordings
        Recordings of one mission, complete or torn (they end in the middle).
    out
        The recording to write.
    force
        Overwrite an existing recording.
    json
        Print what was found as JSON alone on standard output.
    """
    if not 2 <= len(recordings) <= MAX_FILES:
        raise InputError("recordings", len(recordings), f"from 2 to {MAX_FILES} files")
    if any(is_same_file(out, each) for each in recordings):
        raise InputError("--out", str(out), "another file than those that are merged")
    check_output(out, force=force)
    for one, other in combinations(recordings, 2):
        if is_same_file(one, other):
            raise InputError("recordings", str(other), f"another file than {one}")
    with ExitStack() as held, new_file(out) as stream:
        for path in recordings:
            held.enter_context(locked_for_reading(path))
        found = write_merged(recordings, stream)
    merged = read_recording(out)
    gaps = sum(gap.count for gap in find_gaps(merged) if not gap.duplicate)
    tails = len(unknown_tails(merged))
    failed = bool(gaps or found.contradictions)
    if json:
        facts = {"messages": merged.message_count, "lacking": found.lacking, "gaps": gaps, "unknown_tails": tails}
        told = {"contradictions": found.contradictions, "contradictory": found.contradictory, "torn": found.problems}
        print_json({**facts, **told, "left_out": found.left_out, "recording": str(out)})
        return FAILED if failed else 0
    for problem in found.problems:
        note(f"torn: {problem}")
    for left_out in found.left_out:
        note(f"left out: {left_out}")
    for contradiction in found.contradictory:
        note(f"contradiction: {contradiction}")
    if found.contradictions > len(found.contradictory):
        note(f"{found.contradictions} contradictions in all")
    for path, lacking in zip(recordings, found.lacking, strict=True):
        if lacking is not None:
            note(f"{path} lacks {lacking} of {found.messages} messages")
    note(
        f"{merged.message_count} messages of the swarm, {gaps} are missing between them; of {tails} streams nobody "
        f"knows whether more was said"
    )
    print(out)
    return FAILED if failed else 0
