"""`edc-swarm visualise`: the view for Foxglove and Lichtblick, added to a recording."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, BinaryIO

from cyclopts import Parameter

from edc_swarm.analysis.timings import load_timings, measured
from edc_swarm.errors import MessageError
from edc_swarm.protocol.codec import decode
from edc_swarm.protocol.keys import kind_of
from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.writer import MISSION_ATTACHMENT, RecordingWriter
from edc_swarm.viz.channels import ROOT
from edc_swarm.viz.layout import LAYOUT_ATTACHMENT
from edc_swarm.viz.scenery import Scenery
from processes.runtime.console import note
from processes.runtime.output import SUFFIX, check_output, new_file
from processes.services.recorded_view import attach_layout, write_shown


def visualise(
    recording: Path,
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    force: bool = False,
) -> int:
    """Add the view for Foxglove and Lichtblick to a recording, in a new file.

    The view of a simulated mission gets the plan times of FILE.timings.json, which the simulation's own view lacks.

    Parameters
    ----------
    recording
        The recording, FILE.mcap; a view that it already has is replaced.
    out
        The recording to write (FILE.viz.mcap beside it).
    force
        Overwrite an existing recording.
    """
    path = out or recording.with_name(recording.name.removesuffix(SUFFIX) + ".viz" + SUFFIX)
    check_output(path, force=force)
    whole = read_recording(recording)
    plan_ms = {timing.slot: timing.plan_ms for timing in measured(whole, load_timings(recording, note))}
    with new_file(path) as stream:
        _visualise(McapFile(recording), whole, plan_ms, stream)
    print(path)
    return 0


def _visualise(file: McapFile, whole: Recording, plan_ms: Mapping[int, float], stream: BinaryIO) -> None:
    writer, scenery = RecordingWriter(stream, whole.run), Scenery(plan_ms)
    attach_layout(writer, whole.mission)
    for channel, _, log_ns, sent_ns, payload in file.messages():
        if channel.topic.startswith(ROOT):
            continue
        write_shown(writer, scenery.advance(log_ns))
        if kind_of(channel.topic) is None:
            writer.write_as(channel, payload, log_ns, sent_ns)
            continue
        writer.write(channel.topic, payload, log_ns)
        with suppress(MessageError):
            scenery.hear(decode(channel.topic, payload), log_ns)
    for name, (media_type, attached) in file.attachments.items():
        if name not in {LAYOUT_ATTACHMENT, MISSION_ATTACHMENT}:
            writer.attach(name, media_type, attached)
    writer.finish(whole.run_end or {})
