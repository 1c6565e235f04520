"""The log of a viewer: the story, line by line, and the events that it does not tell."""

from __future__ import annotations

from foxglove_schemas_protobuf.Log_pb2 import Log

from edc_swarm.protocol.events import EVENT_FORMS, EventKind
from edc_swarm.protocol.messages import Event
from edc_swarm.story.happening import Happening
from edc_swarm.story.teller import PLAIN
from edc_swarm.viz.shapes import stamp

TOLD = frozenset(
    {
        EventKind.FAULT,
        EventKind.EXITED,
        EventKind.OFF_BUS,
        EventKind.BATTERY_EMPTY,
        EventKind.LANDED,
        EventKind.END,
        EventKind.HOST_REQUEST,
        EventKind.CLOSED,
        *PLAIN,
    }
)
"""Events that the story tells, or that say nothing to people."""
WARNINGS = frozenset(kind for kind, form in EVENT_FORMS.items() if form.warning)


def happening_line(happening: Happening, now_ns: int) -> bytes:
    """Return a happening as a line of the log."""
    levels = {"detail": Log.DEBUG, "news": Log.INFO, "warning": Log.WARNING}
    return Log(
        timestamp=stamp(now_ns),
        level=levels[happening.level],
        message=f"{happening.kind}: {happening.words}".replace(",", ", ").replace(",  ", ", "),
        name="story",
        file="",
        line=happening.slot,
    ).SerializeToString(deterministic=True)


def event_line(event: Event, now_ns: int) -> bytes:
    """Return an event as a line of the log."""
    level = Log.WARNING if event.kind in WARNINGS else Log.INFO
    # Viewers break lines at spaces only, and a fault can list the whole roster.
    words = f"{event.kind}: {event.detail.replace(',', ', ')}" if event.detail else event.kind
    return Log(
        timestamp=stamp(now_ns), level=level, message=words, name=event.source, file="", line=max(event.slot, 0)
    ).SerializeToString(deterministic=True)
