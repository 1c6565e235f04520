"""The recorder: `python -m processes.services.recorder [tcp/HOST:PORT]`, with its orders, a `RecorderSettings`.

It subscribes to all messages of one mission, outside the link model, and writes the received bytes. Zenoh's thread
only queues; the main thread writes and flushes every second, so a killed recorder loses at most one second. The file
is NAME.mcap.part until it is complete. The recorder finds lost messages by sequence gaps, and requests their
retransmission from the publishers.
"""

from __future__ import annotations

import errno
import math
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

import msgspec
import zenoh

from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.roles import OPERATOR, RECORDER
from edc_swarm.protocol import retransmission
from edc_swarm.protocol.codec import MAX_MISSION_BYTES, encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.gap_repair import Gaps, Publisher
from edc_swarm.protocol.keys import Keys, kind_of
from edc_swarm.protocol.messages import Event
from edc_swarm.recording.sequences import tails_in
from edc_swarm.recording.writer import Stamp, TooLarge
from processes.bus.credentials import credentials
from processes.bus.event_source import EventSource
from processes.bus.operator_presence import OperatorPresence
from processes.bus.session import hand_over, open_client, put, query_in_background
from processes.bus.subscriptions import Gate, Heard
from processes.runtime.clock import MissionClock
from processes.runtime.console import run_main
from processes.runtime.inbox import SETTLE_S, Inbox
from processes.runtime.output import held_for_writing
from processes.runtime.parent import end_with_parent
from processes.runtime.priority import give_way
from processes.services.backlog import Backlog
from processes.services.orders import orders, outlast_operator
from processes.services.recorder_settings import RecorderSettings
from processes.services.recording_file import Received, RecordingFile

NAME = RECORDER
FLUSH_S = 1.0
CANNOT_WRITE = 3
"""Exit status if the file could not be written."""
QUEUE_LIMIT = 200_000
MAX_ANSWER_BYTES = 2 * MAX_MISSION_BYTES
"""Largest answer to a retransmission request: the messages of one turn, or a single message."""
CLOSING_S = 1.0
"""Longest wait for retransmissions after the `closed` event of the operator, in seconds."""
STOPPING_S = 2.0
"""Longest wait for the operator's `closed` event after SIGTERM, since compose signals all services at once."""


@dataclass(frozen=True, slots=True)
class Oversized:
    """The description of a payload above the size limit, with its time of receipt."""

    found: TooLarge
    time_ns: int


@dataclass(frozen=True, slots=True)
class RetransmissionAnswer:
    """A publisher's answer to a retransmission request."""

    publisher: Publisher
    payload: bytes


class _Losses(NamedTuple):
    """Numbers of messages that were not recorded: the queue or the file was full, or the key was foreign."""

    dropped: int
    left_out: int


@dataclass(frozen=True, slots=True)
class StopRecording:
    """The order to stop."""


Item = Received | Oversized | RetransmissionAnswer | StopRecording | zenoh.Query


class Recorder:
    """The recorder of one mission, which writes to a stream."""

    def __init__(self, settings: RecorderSettings, stream: BinaryIO) -> None:
        self._keys = Keys(settings.mission)
        self._clock = MissionClock(settings.clock_ahead_ns)
        self.file = RecordingFile(stream, self._keys, settings.run)
        self._inbox: Inbox[Item] = Inbox(QUEUE_LIMIT)
        self._events = EventSource(NAME, self._clock)
        self._reported = _Losses(0, 0)
        self._backlog = Backlog()
        self._gate = Gate(partial(self.tell, EventKind.MALFORMED))
        self._gaps = Gaps(settings.mission, self.file.known)
        self._end_s = self._stop_s = math.inf
        give_way()  # Before Zenoh's threads begin, which inherit it.
        self._session = open_client(settings.endpoint, credentials(settings.certs, settings.certified), observer=True)
        self._is_partial = bool(settings.uavs)
        for key in self._keys.said_by(settings.uavs) if self._is_partial else [self._keys.everything]:
            self._session.declare_subscriber(key, hand_over(self._take))
        self._answers = {self._keys.orders(NAME): msgspec.json.encode(settings)}
        self._mission = settings.mission
        self._operators = None if settings.parent else OperatorPresence(self._session)
        if self._operators is not None:
            for key in (self._keys.mission, *self._answers):
                self._session.declare_queryable(key, hand_over(self._inbox.put))
        if not self._is_partial:
            self._token = self._session.liveliness().declare_token(self._keys.alive(NAME, self._events.instance))

    def stop(self) -> None:
        """Request the end after all queued messages; may be called from a signal handler."""
        self._inbox.put_always(StopRecording())

    def record(self) -> None:
        """Write until the operator has closed and retransmissions have arrived or timed out, or until `stop`."""
        next_flush_s = time.monotonic() + FLUSH_S
        while not self._is_done():
            items = self._inbox.wait(self._patience_s(next_flush_s), SETTLE_S)
            self._note_backlog(items)
            for item in items:
                self._process(item)
            self._ask()
            if self._is_stopped():
                self._end_s = min(self._end_s, time.monotonic())
            if time.monotonic() >= next_flush_s:
                self._flush()
                if self._operators is not None and self._operators.is_lost(self._mission):
                    self._end_s = min(self._end_s, time.monotonic())
                next_flush_s = time.monotonic() + FLUSH_S

    def _is_done(self) -> bool:
        """Return True if the mission has ended, and no message is outstanding or its deadline has passed."""
        return self._end_s < math.inf and (not self._gaps.outstanding or time.monotonic() >= self._end_s)

    def _patience_s(self, next_flush_s: float) -> float:
        next_ask_s = None if self._backlog.is_behind else self._gaps.next_s
        due_s = min(next_flush_s, self._end_s, self._stop_s, next_ask_s if next_ask_s is not None else math.inf)
        return due_s - time.monotonic()

    def _process(self, item: Item) -> None:
        match item:
            case Received():
                self._receive(item)
            case Oversized(found, time_ns):
                if self.file.has_place(found.key):
                    self.file.write_too_large(found, time_ns)
            case RetransmissionAnswer(publisher, payload):
                self._take_answer(publisher, payload)
            case zenoh.Query():
                self._answer(item)
            case StopRecording():
                self._stop_s = min(self._stop_s, time.monotonic() + (STOPPING_S if self._operators else 0.0))

    def finish(self) -> None:
        """Complete the file with the facts of the run's end."""
        self._session.close()
        self.file.finish(self._losses.dropped)

    @property
    def _losses(self) -> _Losses:
        """Numbers of messages that were not recorded until now."""
        return _Losses(self._inbox.dropped + self.file.without_room, self.file.left_out)

    def tell(self, kind: EventKind, detail: str) -> None:
        """Publish an event of the recorder."""
        put(self._session, self._keys.event(NAME), encode(self._events.event(kind, detail)))

    def _is_stopped(self) -> bool:
        """Return True after `stop`, once the operator has left or its time is over."""
        gone = self._operators is None or self._operators.away_s(self._mission) > 0
        return self._stop_s < math.inf and (gone or time.monotonic() >= self._stop_s)

    def _answer(self, query: zenoh.Query) -> None:
        """Answer the next operator, if this one dies, with the mission and with the orders of this recorder."""
        key = str(query.key_expr)
        if key in self._answers:
            query.reply(key, self._answers[key])
        query.drop()

    def _take(self, sample: zenoh.Sample) -> None:
        key, payload, stamp = str(sample.key_expr), sample.payload.to_bytes(), sample.attachment
        if len(payload) > self.file.limit_bytes(key):
            found = TooLarge.of(key, payload)
            self._inbox.put(Oversized(found, self._clock.now_ns()), len(found.first))
            return
        message = Received(key, payload, self._clock.now_ns(), stamp.to_bytes() if stamp is not None else b"")
        self._inbox.put(message, len(payload))

    # --- retransmission of lost messages -----------------------------------------------------

    def _note_backlog(self, items: Sequence[Item]) -> None:
        """Note how old the oldest message is that waited, and tell if the recorder is further behind than before."""
        came_ns = next((item.time_ns for item in items if isinstance(item, Received)), None)
        age_s = (self._clock.now_ns() - came_ns) / NS_PER_S if came_ns is not None else 0.0
        if (detail := self._backlog.note(age_s, len(self._inbox))) is not None:
            self.tell(EventKind.RECORDER_BEHIND, detail)

    def _ask(self) -> None:
        """Request lost messages; a recorder that is behind waits with that until it has caught up.

        Only the recorder of everything lets publishers go that it lacks nothing of.
        """
        if self._backlog.is_behind:
            return
        for publisher, ask in self._gaps.due(time.monotonic()):
            if self._is_partial and not ask.wanted:
                continue
            take = partial(self._take_reply, publisher)
            query_in_background(self._session, self._keys.again(*publisher), retransmission.encode(ask), take)

    def _take_reply(self, publisher: Publisher, reply: zenoh.Reply) -> None:
        if reply.ok is not None and len(reply.ok.payload) > MAX_ANSWER_BYTES:
            self._inbox.dropped += 1
        elif reply.ok is not None:
            payload = reply.ok.payload.to_bytes()
            self._inbox.put(RetransmissionAnswer(publisher, payload), len(payload))

    def _take_answer(self, publisher: Publisher, payload: bytes) -> None:
        """Record the missing messages of an answer, except those whose content contradicts the request."""
        try:
            answer = retransmission.decode_answer(payload)
        except msgspec.DecodeError:
            return
        consistent = [
            kept
            for kept in answer.found
            if len(kept.payload) <= self.file.limit_bytes(kept.key)
            and _is_of(publisher, kept.seq, self.file.stamp(kept))
        ]
        taken = self._gaps.answered(publisher, msgspec.structs.replace(answer, found=consistent), time.monotonic())
        for kept in filter(lambda kept: self.file.has_place(kept.key), taken):
            self._write(Received(kept.key, kept.payload, self._clock.now_ns(), kept.stamp), fetched=True)

    # --- writing -----------------------------------------------------------------------------

    def _receive(self, message: Received) -> None:
        """Write a message if it has a place in the file and is not there yet."""
        if not self.file.has_place(message.key):
            return
        stamp = self.file.stamp(message)
        if self._gaps.heard(message.key, stamp.instance, stamp.seq, message.payload, time.monotonic()):
            self._write(message)

    def _write(self, message: Received, *, fetched: bool = False) -> None:
        mission = self.file.write(message, fetched=fetched)
        if mission is not None:
            self._answers[message.key] = message.payload
            self._gate.know(mission)
        self._process_closed(message.key, message.payload)

    def _process_closed(self, key: str, payload: bytes) -> None:
        """Process a `closed` event; the operator's one starts the end of the recording."""
        if EventKind.CLOSED.encode() not in payload or kind_of(key) is not Event:
            return
        message = self._gate.admit(Heard(key, payload))
        if isinstance(message, Event) and message.kind == EventKind.CLOSED:
            self._gaps.closed(message.source, message.instance, tails_in(message), time.monotonic())
            if message.source == OPERATOR:
                self._end_s = min(self._end_s, time.monotonic() + CLOSING_S)

    def _flush(self) -> None:
        self.file.flush()
        if self.file.has_mission and (jump := self._clock.jump()) is not None:
            self.tell(EventKind.CLOCK_JUMP, jump)
        losses, reported = self._losses, self._reported
        self._reported = losses
        if losses.dropped > reported.dropped:
            text = f"{losses.dropped} messages in all, the queue or the file was full"
            self.tell(EventKind.RECORDER_DROPPED, text)
        if losses.left_out > reported.left_out:
            self.tell(EventKind.MALFORMED, f"{losses.left_out} on more keys of nobody than are recorded")


def _is_of(publisher: Publisher, seq: int, stamp: Stamp) -> bool:
    """Return True if a message's own stamp has the publisher's instance and the sequence number of the answer."""
    return (stamp.instance, stamp.seq) == (publisher[1], seq)


def reason_of(error: OSError) -> str:
    """Return the reason, for the user, why a file could not be written."""
    if error.errno == errno.ENOSPC:
        return "the disk is full (ENOSPC)"
    return f"{(error.strerror or str(error)).lower()} ({errno.errorcode.get(error.errno or 0, '?')})"


def main() -> int:
    """Record one mission."""
    settings = orders(RecorderSettings, NAME)
    if settings.parent:
        end_with_parent(settings.parent)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    recorder = None
    try:
        with held_for_writing(Path(settings.part), keep=True) as stream:
            if stream.read(1):
                allowed = "empty (a recording of a dead recorder cannot be continued)"
                raise InputError("recording", settings.part, allowed)
            recorder = Recorder(settings, stream)
            signal.signal(signal.SIGTERM, lambda *_: recorder.stop())
            print("ready", flush=True)
            recorder.record()
            recorder.finish()
            if recorder.file.has_mission:
                Path(settings.part).replace(settings.out)
            else:
                Path(settings.part).unlink()
    except OSError as error:
        if recorder is not None:
            recorder.tell(EventKind.RECORDING_FAILED, reason_of(error))
        print(reason_of(error), file=sys.stderr, flush=True)
        os._exit(CANNOT_WRITE)
    if not settings.parent:
        outlast_operator(settings.endpoint, settings.mission, credentials(settings.certs, NAME))
    return 0


if __name__ == "__main__":
    run_main(main)
