"""The file of a recording while the mission runs: topics, size limits, counts, and the mission's layout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import BinaryIO, cast

from edc_swarm.mission.roles import ROLES
from edc_swarm.protocol.codec import decode, limit_bytes
from edc_swarm.protocol.keys import SCENES, Keys, kind_of
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.protocol.retransmission import Kept
from edc_swarm.recording.model import FETCHED
from edc_swarm.recording.writer import RecordingWriter, Stamp, TooLarge, is_mission, stamp_of
from edc_swarm.viz.channels import TOPICS, channel_of, topic_of
from processes.services.recorded_view import attach_layout

KEY_WORDS = frozenset({"mission", "uav", "fix", "truth", "head", "command", "report", "event", SCENES, *TOPICS})
"""Parts of a mission's keys, besides the ids of its roster."""
MAX_FOREIGN_KEYS = 1000
"""Most foreign keys (of no process of the mission) that are recorded, with one topic each."""
MAX_SCENE_BYTES = 4 << 20
"""Largest scene of the visualiser, which may exceed a message."""


@dataclass(frozen=True, slots=True)
class Received:
    """A payload from the bus with its time of receipt, and the stamp that accompanies a scene."""

    key: str
    payload: bytes
    time_ns: int
    stamp: bytes = b""


class RecordingFile:
    """The file of one mission's recording.

    Attributes
    ----------
    known
        Parts of the mission's keys, with the ids of its roster once the mission is recorded.
    left_out, without_room
        Number of messages that were not recorded, since their keys are foreign or the file has no more topics.
    """

    def __init__(self, stream: BinaryIO, keys: Keys, run: dict[str, str]) -> None:
        self._stream = stream
        self._writer = RecordingWriter(stream, run)
        self._scenes = f"{keys.root}/viz/"
        self._foreign: set[str] = set()
        self._messages = self._fetched = 0
        self.known = {*KEY_WORDS, *ROLES}
        self.left_out = self.without_room = 0
        self.has_mission = False

    def limit_bytes(self, key: str) -> int:
        """Return the size up to which a payload on `key` is recorded whole."""
        return MAX_SCENE_BYTES if key.startswith(self._scenes) else limit_bytes(key)

    def stamp(self, message: Received | Kept) -> Stamp:
        """Return the stamp in a message, or the one that accompanies a scene."""
        return stamp_of(message.stamp if message.key.startswith(self._scenes) else message.payload)

    def has_place(self, key: str) -> bool:
        """Return True if a message on `key` is wanted and the file has room for it; else count it."""
        wanted, room = self._is_wanted(key), self._writer.has_room_for(key)
        self.left_out += not wanted
        self.without_room += wanted and not room
        return wanted and room

    def _is_wanted(self, key: str) -> bool:
        """Return True if `key` is one of the mission, or one of the first `MAX_FOREIGN_KEYS` others.

        A file holds a limited number of topics. A flood of foreign keys must not take the place of the mission's.
        """
        if (kind_of(key) or topic_of(key)) and self.known.issuperset(key.split("/")[2:]):
            return True
        if len(self._foreign) < MAX_FOREIGN_KEYS:
            self._foreign.add(key)
        return key in self._foreign

    def write(self, message: Received, *, fetched: bool = False) -> MissionMessage | None:
        """Record a message of the swarm, or a scene under the topic that viewers' layouts use.

        Return the mission if this message is the first one with it.
        """
        self._messages += 1
        self._fetched += fetched
        topic = topic_of(message.key)
        channel = channel_of(topic) if topic is not None else None
        if channel is not None:
            stamp = self.stamp(message)
            self._writer.write_as(channel, message.payload, message.time_ns, stamp.sent_ns, stamp.seq)
            return None
        self._writer.write(message.key, message.payload, message.time_ns)
        if self.has_mission or not is_mission(message.key, message.payload):
            return None
        self.has_mission = True
        mission = cast("MissionMessage", decode(message.key, message.payload))
        self.known.update(entry.uav for entry in mission.roster)
        attach_layout(self._writer, mission)
        return mission

    def write_too_large(self, found: TooLarge, time_ns: int) -> None:
        """Record the description of a payload above the size limit."""
        self._writer.write_too_large(found, time_ns)

    def flush(self) -> None:
        """Write everything so far to the operating system, so that it survives the death of the process."""
        self._writer.flush()
        self._stream.flush()

    def finish(self, dropped: int) -> None:
        """Complete the file with the facts of the run's end; `dropped` counts the lost messages."""
        facts = {
            "messages": str(self._messages),
            "dropped": str(dropped),
            "foreign_left_out": str(self.left_out),
            FETCHED: str(self._fetched),
        }
        self._writer.finish(facts)
        self._stream.flush()
