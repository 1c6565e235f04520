"""The doings of the emulated links, as their receivers told at the end of a run (event `link-delays`)."""

from __future__ import annotations

import msgspec

from edc_swarm.emulation.delay_log import LinkDelays
from edc_swarm.protocol.events import EventKind
from edc_swarm.recording.model import Recording

Directed = tuple[str, str]
"""Sender and receiver of a link."""


def link_delays_of(recording: Recording) -> dict[Directed, LinkDelays]:
    """Return the delays of each directed link, by sender and receiver.

    A UAV that was killed has told nothing, and of one that was restarted only its last process counts.
    """
    found = dict[Directed, LinkDelays]()
    for event in recording.events:
        if event.kind == EventKind.LINK_DELAYS:
            try:
                told = msgspec.json.decode(event.detail, type=dict[str, LinkDelays])
            except msgspec.DecodeError:
                continue
            found.update({(sender, event.source): delays for sender, delays in told.items()})
    return found
