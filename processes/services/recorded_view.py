"""The view in a recording: the scenes for viewers, and the layout that displays them."""

from __future__ import annotations

import msgspec

from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.recording.writer import RecordingWriter
from edc_swarm.viz.channels import channel_of
from edc_swarm.viz.layout import LAYOUT_ATTACHMENT, layout
from edc_swarm.viz.scenery import Shown


def layout_bytes(mission: MissionMessage) -> bytes:
    """Return the viewer's layout for a mission, as the content of a file for import."""
    return msgspec.json.format(msgspec.json.encode(layout(mission)), indent=2) + b"\n"


def attach_layout(writer: RecordingWriter, mission: MissionMessage) -> None:
    """Attach the layout to the recording."""
    writer.attach(LAYOUT_ATTACHMENT, "application/json", layout_bytes(mission), mission.sent_ns)


def write_shown(writer: RecordingWriter, shown: list[Shown]) -> None:
    """Record the scenes for viewers."""
    for each in shown:
        channel = channel_of(each.topic)
        assert channel is not None
        writer.write_as(channel, each.payload, each.time_ns, each.time_ns)
