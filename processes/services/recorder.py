"""The recorder: `python -m processes.services.recorder [tcp/HOST:PORT]`, with its orders, a `RecorderSettings`.

It subscribes to everything of one mission, outside the link model, and writes the bytes it
received. Zenoh's thread only queues; the main thread writes, and flushes every second, so a killed
recorder loses at most that. The file is NAME.mcap.part until it is whole. What has not arrived, as the
numbers of what has show, is asked for again of its publishers.
"""

from __future__ import annotations

import errno
import math
import os
import secrets
import signal
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO, cast

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.errors import InputError, SwarmError
from edc_swarm.mission.configuration import OPERATOR, RECORDER, ROLES
from edc_swarm.protocol import retransmission
from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES, decode, encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.gap_repair import Holes, Publisher
from edc_swarm.protocol.keys import SCENES, Keys, kind_of
from edc_swarm.protocol.messages import Event, MissionMessage
from edc_swarm.recording.ordering import FETCHED
from edc_swarm.recording.sequences import tails_in
from edc_swarm.recording.writer import RecordingWriter, Stamp, TooLarge, is_mission, stamp_of
from edc_swarm.viz.channels import TOPICS, channel_of, topic_of
from processes.bus.credentials import credentials
from processes.bus.operator_presence import OPERATOR_LOST_S, OperatorPresence
from processes.bus.session import hand_over, open_client, put, query_in_background
from processes.bus.subscriptions import Gate, Heard
from processes.runtime.clock import MissionClock
from processes.runtime.console import complain
from processes.runtime.inbox import SETTLE_S, Inbox
from processes.runtime.output import held_for_writing
from processes.runtime.parent import die_with_parent
from processes.services.orders import orders, outlast_operator
from processes.services.recorded_view import attach_layout

NAME = RECORDER
FLUSH_S = 1.0
CANNOT_WRITE = 3
"""Exit status when the file could not be written."""
QUEUE_LIMIT = 200_000
KEY_WORDS = frozenset({"mission", "uav", "fix", "truth", "head", "command", "report", "event", SCENES, *TOPICS})
"""What the keys of a mission are made of, beside the ids of its roster."""
MAX_FOREIGN_KEYS = 1000
"""Keys of nobody in the mission that are recorded all the same, one topic each."""

MAX_ANSWER_BYTES = 2 * MAX_MESSAGE_BYTES
"""An answer is a turn's worth, or a single message."""
MAX_SCENE_BYTES = 4 << 20
"""What the visualiser says may be larger than a message."""
CLOSING_S = 1.0
"""For at most so long after the operator's last word answers are waited for."""
STOPPING_S = 2.0
"""A service that is told to stop waits so long for the operator's last word: all are told at once, by compose."""


@dataclass(frozen=True, slots=True)
class Said:
    """Bytes from the bus, when they came, and the stamp beside those that carry none."""

    key: str
    payload: bytes
    time_ns: int
    stamp: bytes = b""


@dataclass(frozen=True, slots=True)
class Refused:
    """What is kept of bytes from the bus that are too many, and when they came."""

    found: TooLarge
    time_ns: int


@dataclass(frozen=True, slots=True)
class Answered:
    """A publisher's answer."""

    publisher: Publisher
    payload: bytes


@dataclass(frozen=True, slots=True)
class Stop:
    """The order to stop."""


Item = Said | Refused | Answered | Stop | zenoh.Query


class RecorderSettings(Struct, frozen=True, kw_only=True):
    """What the recorder must be told. `parent` is 0 for one that outlives whoever started it."""

    endpoint: str
    mission: str
    part: str
    out: str
    run: dict[str, str]
    certs: str = ""
    parent: int = 0
    clock_ahead_ns: int | None = None


class Recorder:
    """Writes one mission to a stream."""

    def __init__(self, settings: RecorderSettings, stream: BinaryIO) -> None:
        self._keys = Keys(settings.mission)
        self._clock = MissionClock(settings.clock_ahead_ns)
        self._stream = stream
        self._writer = RecordingWriter(stream, settings.run)
        self._inbox: Inbox[Item] = Inbox(QUEUE_LIMIT)
        self._instance = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._seq = -1
        self._told_dropped = 0
        self._messages = 0
        self._known = {*KEY_WORDS, *ROLES}
        self._gate = Gate(partial(self.tell, EventKind.MALFORMED))
        self._foreign: set[str] = set()
        self._left_out = self._told_left_out = 0
        self._holes = Holes(settings.mission, self._known)
        self._scenes = f"{self._keys.root}/viz/"
        self._fetched = 0
        self._end_s = self._stop_s = math.inf
        self.has_mission = False
        self._mission = settings.mission
        self._session = open_client(settings.endpoint, credentials(settings.certs, NAME), observer=True)
        self._session.declare_subscriber(self._keys.everything, hand_over(self._take))
        self._answers = {self._keys.orders(NAME): msgspec.json.encode(settings)}
        self._operators = None
        if not settings.parent:
            self._operators = OperatorPresence(self._session)
            self._offer_answers()
        self._token = self._session.liveliness().declare_token(self._keys.alive(NAME, self._instance))

    def stop(self) -> None:
        """Ask to end after what is queued; may be called from a signal handler."""
        self._inbox.put_always(Stop())

    def record(self) -> None:
        """Write until the operator's last word and what is hoped for after it, or until told to stop."""
        next_flush_s = time.monotonic() + FLUSH_S
        while not self._is_done():
            for item in self._inbox.wait(self._patience_s(next_flush_s), SETTLE_S):
                self._take_in(item)
            self._ask()
            if self._is_stopped():
                self._end_by(time.monotonic())
            if time.monotonic() >= next_flush_s:
                self._flush()
                if self._is_deserted():
                    self._end_by(time.monotonic())
                next_flush_s = time.monotonic() + FLUSH_S

    def _is_done(self) -> bool:
        """Whether the end has come and nothing more is hoped for, or no longer."""
        return self._end_s < math.inf and (not self._holes.outstanding or time.monotonic() >= self._end_s)

    def _end_by(self, end_s: float) -> None:
        self._end_s = min(self._end_s, end_s)

    def _patience_s(self, next_flush_s: float) -> float:
        next_ask_s = self._holes.next_s
        due_s = min(next_flush_s, self._end_s, self._stop_s, next_ask_s if next_ask_s is not None else math.inf)
        return due_s - time.monotonic()

    def _take_in(self, item: Item) -> None:
        match item:
            case Said():
                self._hear(item)
            case Refused(found, time_ns):
                if self._has_place(found.key):
                    self._writer.write_too_large(found, time_ns)
            case Answered(publisher, payload):
                self._take_answer(publisher, payload)
            case zenoh.Query():
                self._answer(item)
            case Stop():
                self._stop_s = min(self._stop_s, time.monotonic() + (STOPPING_S if self._operators else 0.0))

    def finish(self) -> None:
        """Make the file whole."""
        self._session.close()
        facts = {
            "messages": str(self._messages),
            "dropped": str(self._inbox.dropped),
            "foreign_left_out": str(self._left_out),
            FETCHED: str(self._fetched),
        }
        self._writer.finish(facts)
        self._stream.flush()

    def tell(self, kind: EventKind, detail: str) -> None:
        """Publish an event of the recorder."""
        self._seq += 1
        event = Event(
            source=NAME, instance=self._instance, seq=self._seq, sent_ns=self._clock.now_ns(), kind=kind, detail=detail
        )
        put(self._session, self._keys.event(NAME), encode(event))

    def _is_deserted(self) -> bool:
        """Whether the operator has gone for good without a last word."""
        return self._operators is not None and self._operators.away_s(self._mission) > OPERATOR_LOST_S

    def _is_stopped(self) -> bool:
        """Whether it was told to stop, and the operator has gone or has had its time."""
        gone = self._operators is None or self._operators.away_s(self._mission) > 0
        return self._stop_s < math.inf and (gone or time.monotonic() >= self._stop_s)

    def _offer_answers(self) -> None:
        for key in (self._keys.mission, *self._answers):
            self._session.declare_queryable(key, hand_over(self._inbox.put))

    def _answer(self, query: zenoh.Query) -> None:
        """Tell the next operator what this one has said, should it die: the mission, and the orders given here."""
        key = str(query.key_expr)
        if key in self._answers:
            query.reply(key, self._answers[key])
        query.drop()

    def _take(self, sample: zenoh.Sample) -> None:
        key, payload, stamp = str(sample.key_expr), sample.payload.to_bytes(), sample.attachment
        if len(payload) > self._limit_bytes(key):
            found = TooLarge.of(key, payload)
            self._inbox.put(Refused(found, self._clock.now_ns()), len(found.first))
            return
        said = Said(key, payload, self._clock.now_ns(), stamp.to_bytes() if stamp is not None else b"")
        self._inbox.put(said, len(payload))

    def _limit_bytes(self, key: str) -> int:
        """Return the size up to which a payload on `key` is recorded whole."""
        return MAX_SCENE_BYTES if key.startswith(self._scenes) else MAX_MESSAGE_BYTES

    # --- what has not arrived ----------------------------------------------------------------

    def _ask(self) -> None:
        for publisher, ask in self._holes.due(time.monotonic()):
            take = partial(self._take_reply, publisher)
            query_in_background(self._session, self._keys.again(*publisher), retransmission.encode(ask), take)

    def _take_reply(self, publisher: Publisher, reply: zenoh.Reply) -> None:
        if reply.ok is not None and len(reply.ok.payload) <= MAX_ANSWER_BYTES:
            payload = reply.ok.payload.to_bytes()
            self._inbox.put(Answered(publisher, payload), len(payload))

    def _take_answer(self, publisher: Publisher, payload: bytes) -> None:
        """Record what was missing, and nothing that says that it is something else."""
        try:
            answer = retransmission.decode_answer(payload)
        except msgspec.DecodeError:
            return
        honest = [
            kept
            for kept in answer.found
            if len(kept.payload) <= self._limit_bytes(kept.key) and self._number(kept) == (publisher[1], kept.seq)
        ]
        taken = self._holes.answered(publisher, msgspec.structs.replace(answer, found=honest), time.monotonic())
        for kept in filter(lambda kept: self._has_place(kept.key), taken):
            self._write(Said(kept.key, kept.payload, self._clock.now_ns(), kept.stamp))
            self._fetched += 1

    def _number(self, kept: retransmission.Kept) -> tuple[str, int]:
        """Instance and number of a message as it says itself."""
        stamp = self._stamp(kept)
        return stamp.instance, stamp.seq

    def _stamp(self, said: Said | retransmission.Kept) -> Stamp:
        """The stamp in a message, or beside a scene."""
        return stamp_of(said.stamp if said.key.startswith(self._scenes) else said.payload)

    # --- writing -----------------------------------------------------------------------------

    def _hear(self, said: Said) -> None:
        """Write what has a place in the file and is not there yet."""
        if not self._has_place(said.key):
            return
        stamp = self._stamp(said)
        if self._holes.heard(said.key, stamp.instance, stamp.seq, said.payload, time.monotonic()):
            self._write(said)

    def _write(self, said: Said) -> None:
        self._record(said)
        self._messages += 1
        self._look_for_last_words(said.key, said.payload)

    def _has_place(self, key: str) -> bool:
        """Whether a message on `key` is wanted and has room; counted if not."""
        wanted, room = self._is_wanted(key), self._writer.has_room_for(key)
        self._left_out += not wanted
        self._inbox.dropped += wanted and not room
        return wanted and room

    def _is_wanted(self, key: str) -> bool:
        """Whether `key` is one of the mission's, or one of the first of all others.

        A file holds so many topics and no more: whoever floods the bus with keys of nobody must not
        take the room of those who fly.
        """
        if (kind_of(key) or topic_of(key)) and self._known.issuperset(key.split("/")[2:]):
            return True
        if len(self._foreign) < MAX_FOREIGN_KEYS:
            self._foreign.add(key)
        return key in self._foreign

    def _look_for_last_words(self, key: str, payload: bytes) -> None:
        """Take in who has closed; with the operator's last word the end begins."""
        if EventKind.CLOSED.encode() not in payload or kind_of(key) is not Event:
            return
        message = self._gate.admit(Heard(key, payload))
        if isinstance(message, Event) and message.kind == EventKind.CLOSED:
            self._holes.closed(message.source, message.instance, tails_in(message), time.monotonic())
            if message.source == OPERATOR:
                self._end_by(time.monotonic() + CLOSING_S)

    def _record(self, said: Said) -> None:
        """Record a message of the swarm, or of the visualiser under the topic that viewers' layouts know."""
        topic = topic_of(said.key)
        channel = channel_of(topic) if topic is not None else None
        if channel is not None:
            stamp = self._stamp(said)
            self._writer.write_as(channel, said.payload, said.time_ns, stamp.sent_ns, stamp.seq)
            return
        self._writer.write(said.key, said.payload, said.time_ns)
        if not self.has_mission and is_mission(said.key, said.payload):
            self.has_mission = True
            self._answers[said.key] = said.payload
            self._begin(cast("MissionMessage", decode(said.key, said.payload)))

    def _begin(self, mission: MissionMessage) -> None:
        self._gate.know(mission)
        self._known.update(entry.uav for entry in mission.roster)
        attach_layout(self._writer, mission)

    def _flush(self) -> None:
        self._writer.flush()
        self._stream.flush()
        if self.has_mission and (jump := self._clock.jump()) is not None:
            self.tell(EventKind.CLOCK_JUMP, jump)
        if self._inbox.dropped > self._told_dropped:
            self._told_dropped = self._inbox.dropped
            self.tell(
                EventKind.RECORDER_DROPPED, f"{self._told_dropped} messages in all, the queue or the file was full"
            )
        if self._left_out > self._told_left_out:
            self._told_left_out = self._left_out
            self.tell(EventKind.MALFORMED, f"{self._left_out} on more keys of nobody than are recorded")


def reason_of(error: OSError) -> str:
    """What to tell a user about a file that could not be written."""
    if error.errno == errno.ENOSPC:
        return "the disk is full (ENOSPC)"
    return f"{(error.strerror or str(error)).lower()} ({errno.errorcode.get(error.errno or 0, '?')})"


def main() -> int:
    """Record one mission."""
    settings = orders(RecorderSettings, NAME)
    if settings.parent:
        die_with_parent(settings.parent)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with held_for_writing(Path(settings.part)) as stream:
        if stream.read(1):
            raise InputError("recording", settings.part, "empty (a recorder that died is not gone on with)")
        recorder = Recorder(settings, stream)
        signal.signal(signal.SIGTERM, lambda *_: recorder.stop())
        try:
            recorder.record()
            recorder.finish()
            if recorder.has_mission:
                Path(settings.part).replace(settings.out)
            else:
                Path(settings.part).unlink()
        except OSError as error:
            recorder.tell(EventKind.RECORDING_FAILED, reason_of(error))
            print(reason_of(error), file=sys.stderr, flush=True)
            os._exit(CANNOT_WRITE)
    if not settings.parent:
        outlast_operator(settings.endpoint, settings.mission, credentials(settings.certs, NAME))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SwarmError as error:
        sys.exit(complain(error))
