"""Merging: one recording of what several recorders have written of one mission, such as one on each host.

A message that one recorder lacks and another has is in the result. So the gaps that are left are those of all.

==============================  =====================================================================
Message                         Identity: it is in the result once
==============================  =====================================================================
with instance and `seq`         topic, instance, `seq`; of several with different bytes all are kept
a scene of the visualiser       topic, number, time of sending, bytes
anything else, such as garbage  topic, bytes; as often as it is in the file that has it most often
==============================  =====================================================================
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import merge as in_time_order
from pathlib import Path
from typing import BinaryIO, cast

import msgspec

from edc_swarm.errors import EarlyEndError, RecordingError
from edc_swarm.protocol.codec import decode
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.recording.mcap_file import Channel, McapFile, Raw
from edc_swarm.recording.model import DROPPED, FETCHED, MAX_DIGITS
from edc_swarm.recording.reader import first_mission
from edc_swarm.recording.writer import MAX_CHANNELS, MISSION_ATTACHMENT, RecordingWriter, stamp_of

MAX_FILES = 100
MAX_CONTRADICTIONS = 20
"""Most contradictions that are named one by one."""
LEFT_OUT, MERGED = "foreign_left_out", "merged"


@dataclass(slots=True)
class Merged:
    """What a merge has found.

    Attributes
    ----------
    messages
        Number of messages in the result.
    lacking
        By file: the number of them that it lacks, None for one that is left out.
    contradictions
        Number of messages with the topic, instance and `seq` of another one, and other bytes.
    contradictory
        The first of them, one line each.
    problems
        One line for each part of a file that could not be read.
    left_out
        One line for each file that is torn before its mission: nobody can say which mission it is of.
    """

    messages: int = 0
    lacking: list[int | None] = field(default_factory=list)
    contradictions: int = 0
    contradictory: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


def merge(paths: Sequence[Path], stream: BinaryIO) -> Merged:
    """Write the messages of the recordings at `paths` to `stream`, in the order of log time, each once.

    Facts of the run are those of the first file. A file that is torn before its mission is left out.

    Raises
    ------
    RecordingError
        A file is no recording, is of another mission than the first one, or they have too many topics together; or no
        file has a mission.
    """
    found, files, missions = Merged(), list[McapFile](), list[bytes]()
    for path in paths:
        file = McapFile(path)
        try:
            missions.append(first_mission(file))
        except EarlyEndError as error:
            found.left_out.append(str(error))
            continue
        files.append(file)
        if not _is_same(missions[-1], missions[0]):
            raise RecordingError(path, f"has {_named(missions[-1])}, but {files[0].path} has {_named(missions[0])}")
    if not files:
        raise RecordingError(paths[0], f"holds no mission, and none of {len(paths)} files does")
    topics = {channel for file in files for channel in file.channels}
    if len(topics) > MAX_CHANNELS:
        raise RecordingError(files[-1].path, f"has, with the others, {len(topics)} topics, more than {MAX_CHANNELS}")
    found.problems = [f"{file.path}: {each}" for file in files for each in file.problems]
    writer = RecordingWriter(stream, files[0].metadata["run"])
    attachments = {name: attached for file in reversed(files) for name, attached in file.attachments.items()}
    attachments.setdefault(MISSION_ATTACHMENT, ("application/json", missions[0]))
    for name, (media_type, data) in attachments.items():
        writer.attach(name, media_type, data)
    kept, own = _Kept(found), [0] * len(files)
    for place, (channel, sequence, log_ns, sent_ns, payload) in _in_order([file.path for file in files]):
        is_new, is_own = kept.take(place, channel, sequence, log_ns, sent_ns, payload)
        own[place] += is_own
        if is_new:
            writer.copy(channel, payload, log_ns, sent_ns, sequence)
            found.messages += 1
    lacking = {file.path: found.messages - count for file, count in zip(files, own, strict=True)}
    found.lacking = [lacking.get(path) for path in paths]
    told = [f"{len(files)} recordings", *found.problems, *(f"left out: {each}" for each in found.left_out)]
    ends = [file.metadata.get("run_end", {}) for file in files]
    writer.finish({**_facts([*ends, *({} for _ in found.left_out)]), MERGED: "; ".join(told)})
    return found


def _is_same(mission: bytes, other: bytes) -> bool:
    """Return True for messages of one mission; a second operator publishes it with a stamp of its own."""
    one, two = _decoded(mission), _decoded(other)
    return msgspec.structs.replace(one, instance=two.instance, seq=two.seq, sent_ns=two.sent_ns) == two


def _decoded(mission: bytes) -> MissionMessage:
    return cast("MissionMessage", decode("mission", mission))


def _named(payload: bytes) -> str:
    mission = _decoded(payload)
    return f"mission {mission.name} of seed {mission.seed}, epoch {mission.epoch_ns} ns"


def _in_order(paths: Sequence[Path]) -> Iterator[tuple[int, Raw]]:
    """Yield (number of the file, message) by log time; a time that goes back in a file counts as the latest so far."""

    def read(place: int, path: Path) -> Iterator[tuple[int, int, Raw]]:
        latest_ns = 0
        for channel, sequence, log_ns, sent_ns, payload in McapFile(path).messages():
            latest_ns = max(latest_ns, log_ns)
            yield latest_ns, place, (channel, sequence, latest_ns, sent_ns, payload)

    sources = [read(place, path) for place, path in enumerate(paths)]
    for _, place, message in in_time_order(*sources, key=lambda entry: entry[:2]):
        yield place, message


class _Kept:
    """The messages that are in the result, and the files that have them."""

    def __init__(self, found: Merged) -> None:
        self._found = found
        self._numbered: dict[tuple[str, str], dict[int, dict[bytes, int]]] = {}
        self._others: Counter[tuple[object, ...]] = Counter()

    def take(
        self, place: int, channel: Channel, sequence: int, log_ns: int, sent_ns: int, payload: bytes
    ) -> tuple[bool, bool]:
        """Return whether a message of file `place` is new to the result, and whether it is new to that file."""
        stamp, topic = stamp_of(payload), channel.topic
        digest = hashlib.blake2b(payload, digest_size=16).digest()
        if stamp.instance:
            holders = self._numbered.setdefault((topic, stamp.instance), {}).setdefault(stamp.seq, {})
            if holders and digest not in holders:
                self._contradicts(f"{topic} of {stamp.instance}: message {stamp.seq} has different contents")
            before = holders.get(digest, 0)
            holders[digest] = before | 1 << place
            return not before, not before >> place & 1
        # A payload without a time of sending has that of its receipt, which differs between recorders.
        own = (sequence, sent_ns) if sent_ns != log_ns else ()
        what = (topic, digest, *own)
        self._others[place, *what] += 1
        is_new = self._others[place, *what] > self._others[what]
        self._others[what] += is_new
        return is_new, True

    def _contradicts(self, text: str) -> None:
        self._found.contradictions += 1
        if len(self._found.contradictory) < MAX_CONTRADICTIONS:
            self._found.contradictory.append(text)


def _facts(ends: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the facts of `run_end`: sums, each only if all files have it, since a torn one has none.

    A loss that one recorder has counted stays, whatever the others say.
    """
    sums = {name: [_count(end.get(name, "")) for end in ends] for name in (DROPPED, LEFT_OUT, FETCHED)}
    return {
        name: str(sum(filter(None, counts)))
        for name, counts in sums.items()
        if None not in counts or (name == DROPPED and any(counts))
    }


def _count(text: str) -> int | None:
    return int(text) if text.isdecimal() and len(text) <= MAX_DIGITS else None
