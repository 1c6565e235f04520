"""Recordings: MCAP files that hold every message of a run, verbatim.

`RecordingWriter` writes one, `read_recording` reads one back as a `Recording`, `recover` makes a
whole file of a torn one. Every metric and every guarantee is computed from a `Recording` alone;
the simulator makes one without a file, by `Recording.from_messages`. Importing this imports no numpy:
`recording.tracks`, which does, is for metrics and guarantees.
"""

from edc_swarm.recording.holes import Holes
from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.recording.model import Garbage, Recording
from edc_swarm.recording.ordering import fetched_count
from edc_swarm.recording.reader import read_recording, recover
from edc_swarm.recording.sequences import CLOSED, Gap, find_gaps, tails_in, unknown_tails
from edc_swarm.recording.writer import RecordingWriter, Stamp, TooLarge, is_mission, stamp_of

__all__ = [
    "CLOSED",
    "Gap",
    "Garbage",
    "Holes",
    "McapFile",
    "Recording",
    "RecordingWriter",
    "Stamp",
    "TooLarge",
    "fetched_count",
    "find_gaps",
    "is_mission",
    "read_recording",
    "recover",
    "stamp_of",
    "tails_in",
    "unknown_tails",
]
