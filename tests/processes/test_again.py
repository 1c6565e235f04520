"""Retransmission of lost messages, with a recorder, a router, and publishers in real processes."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol import retransmission
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, Fix, mission_message
from edc_swarm.protocol.retransmission import OVERHEAD_BYTES, Answer, Ask, Kept
from edc_swarm.recording.mcap_file import McapFile, Raw
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from processes.bus import outbox
from processes.bus.outbox import Outbox
from processes.bus.session import hand_over, open_client
from processes.bus.session import put as put_on_bus
from processes.runtime.inbox import Inbox
from processes.services.recorder import MAX_ANSWER_BYTES
from processes.services.recorder_settings import RecorderSettings
from processes.services.recording_file import MAX_FOREIGN_KEYS
from tests import builders
from tests.processes.conftest import await_true

KEYS = Keys("m")
FIX = KEYS.fix("u001")
SCENE = f"{KEYS.root}/viz/uavs"


class Bench:
    """A recorder in a process of its own, with a session for the publishers."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        self.out = folder / "run.mcap"
        part = folder / "run.mcap.part"
        part.touch()
        settings = RecorderSettings(endpoint=endpoint, mission="m", part=str(part), out=str(self.out), run={})
        self.session = open_client(endpoint)
        there = Inbox[str]()

        def take(sample: zenoh.Sample) -> None:
            there.put(str(sample.key_expr))

        self._token = self.session.liveliness().declare_subscriber(KEYS.all_alive, hand_over(take), history=True)
        self.recorder = subprocess.Popen([sys.executable, "-m", "processes.services.recorder"], stdin=subprocess.PIPE)
        assert self.recorder.stdin is not None
        with self.recorder.stdin as orders:
            orders.write(msgspec.json.encode(settings))
        await_true(lambda: bool(there.wait(0.05)))
        mission = mission_message(complete_mission(Mission(uavs=2)), time.time_ns(), "m")
        self.mission = msgspec.structs.replace(mission, instance="o-1", sent_ns=time.time_ns())
        self.put(KEYS.mission, encode(self.mission))

    def put(self, key: str, payload: bytes) -> None:
        """Publish a message that no publisher keeps for retransmission."""
        self.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def say_last_word(self) -> None:
        """Publish the operator's `closed` event."""
        tails = msgspec.json.encode({KEYS.mission: 0}).decode()
        last = Event(source="operator", instance="o-1", sent_ns=time.time_ns(), kind="closed", detail=tails)
        self.put(KEYS.event("operator"), encode(last))

    def end(self) -> list[Raw]:
        """Wait for the end of the recorder, and return the recorded messages in the order of the file."""
        assert self.recorder.wait(30) == 0
        self.session.close()
        return list(McapFile(self.out).messages())


@pytest.fixture
def bench(endpoint: str, tmp_path: Path) -> Iterator[Bench]:
    """Yield a recorder that has begun."""
    made = Bench(endpoint, tmp_path)
    yield made
    made.recorder.kill()
    made.recorder.wait()


def fix(seq: int) -> bytes:
    """Return a fix of u001."""
    return encode(builders.fix("u001", seq, instance="p-1", seq=seq, sent_ns=time.time_ns()))


def closed(source: str, tails: dict[str, int]) -> bytes:
    """Return a publisher's `closed` event."""
    detail = msgspec.json.encode(tails).decode()
    return encode(Event(source=source, instance="p-1", sent_ns=time.time_ns(), kind="closed", detail=detail))


Lose = Callable[[str, set[int]], None]


@pytest.fixture
def lose(monkeypatch: pytest.MonkeyPatch) -> Lose:
    """Make the bus lose messages of a key, selected by their order."""
    lost, counts = dict[str, set[int]](), dict[str, int]()

    def put(session: zenoh.Session, key: str, payload: bytes, attachment: bytes) -> None:
        counts[key] = counts.get(key, -1) + 1
        if counts[key] not in lost.get(key, ()):
            put_on_bus(session, key, payload, attachment)

    monkeypatch.setattr(outbox, "put", put)
    return lost.__setitem__


def test_lost_messages_are_recorded_once_as_they_were(bench: Bench, lose: Lose) -> None:
    """Messages lost within a stream and at its end, and scenes, are recorded unchanged, at their time of arrival."""
    inbox = Inbox[object]()
    uav = Outbox(bench.session, KEYS.again("u001", "p-1"), inbox)
    viz_inbox = Inbox[object]()
    viz = Outbox(bench.session, KEYS.again("viz", "p-1"), viz_inbox)
    lose(FIX, {0, 4, 5, 9})
    lose(SCENE, {1, 2})
    said = [fix(seq) for seq in range(10)]
    scenes = [b"\xffscene" + bytes([seq]) for seq in range(3)]
    for seq, payload in enumerate(said):
        uav.put(FIX, payload, seq)
    for seq, payload in enumerate(scenes):
        viz.put(SCENE, payload, seq, msgspec.json.encode({"instance": "p-1", "seq": seq, "sent_ns": 1000 + seq}))
    uav.put(KEYS.event("u001"), closed("u001", {FIX: 9}), 0)
    viz.put(KEYS.event("viz"), closed("viz", {"viz/uavs": 2}), 0)
    for publisher, its_inbox in ((uav, inbox), (viz, viz_inbox)):
        publisher.flush()
        assert publisher.stay(its_inbox)
    bench.say_last_word()
    recorded = bench.end()
    fixes = sorted((seq, payload) for channel, seq, _, _, payload in recorded if channel.topic == FIX)
    assert fixes == list(enumerate(said))
    shown = sorted(
        (seq, sent_ns, payload) for channel, seq, _, sent_ns, payload in recorded if channel.topic == "/viz/uavs"
    )
    assert shown == [(seq, 1000 + seq, payload) for seq, payload in enumerate(scenes)]
    logged = [log_ns for _, _, log_ns, _, _ in recorded]
    assert logged == sorted(logged)
    for channel, _, log_ns, sent_ns, payload in recorded:
        if channel.topic == FIX:
            assert sent_ns == msgspec.json.decode(payload, type=Fix).sent_ns <= log_ns
    recording = read_recording(bench.out)
    assert [f.seq for f in recording.fixes] == list(range(10))
    assert find_gaps(recording) == []
    assert compute_metrics(recording).fetched == 6


def test_what_the_publisher_no_longer_keeps_stays_a_gap(bench: Bench, lose: Lose) -> None:
    """The rest of the gap is recorded, and the check names the missing messages."""
    inbox = Inbox[object]()
    room = sum(len(fix(seq)) + OVERHEAD_BYTES for seq in range(4)) + 100
    uav = Outbox(bench.session, KEYS.again("u001", "p-1"), inbox, room)
    lose(FIX, {1, 2, 3, 4, 5})
    for seq in range(7):
        uav.put(FIX, fix(seq), seq)
    uav.put(KEYS.event("u001"), closed("u001", {FIX: 6}), 0)
    uav.flush()
    uav.stay(inbox)
    bench.say_last_word()
    bench.end()
    recording = read_recording(bench.out)
    (gap,) = find_gaps(recording)
    assert (gap.key, gap.first) == ("uav/u001/fix", 1)
    assert 1 < gap.last < 5
    (complete,) = (result for result in check(recording) if result.guarantee == "G5")
    assert [violation.kind for violation in complete.violations] == ["gap"]


def test_the_recorder_waits_for_answers_after_the_last_word(bench: Bench, lose: Lose) -> None:
    """The operator's `closed` event may come before the last answers of the UAVs."""
    inbox = Inbox[object]()
    uav = Outbox(bench.session, KEYS.again("u001", "p-1"), inbox)
    lose(FIX, {1, 2})
    for seq in range(3):
        uav.put(FIX, fix(seq), seq)
    uav.put(KEYS.event("u001"), closed("u001", {FIX: 2}), 0)
    uav.flush()
    bench.say_last_word()
    uav.stay(inbox)
    assert sorted(seq for channel, seq, *_ in bench.end() if channel.topic == FIX) == [0, 1, 2]


def test_what_waits_for_a_router_is_said_in_the_end(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The messages arrive even if the router returns after the `closed` event."""
    inbox, routers = Inbox[object](), list[str]()
    monkeypatch.setattr(outbox, "is_connected", lambda _: bool(routers))
    uav = Outbox(bench.session, KEYS.again("u001", "p-1"), inbox)
    for seq in range(3):
        uav.put(FIX, fix(seq), seq)
    uav.put(KEYS.event("u001"), closed("u001", {FIX: 2}), 0)
    uav.flush()
    assert uav.holds_back
    routers.append("again there")
    uav.stay(inbox)
    assert not uav.holds_back
    bench.say_last_word()
    assert [seq for channel, seq, *_ in bench.end() if channel.topic == FIX] == [0, 1, 2]


def test_what_is_no_ask_is_left_alone(endpoint: str) -> None:
    """An invalid request gets no answer from other publishers; a query on another key does."""
    again_key, heard = KEYS.again("u001", "p-1"), dict[str, bool]()
    with open_client(endpoint) as asker, open_client(endpoint) as session:
        inbox = Inbox[zenoh.Query]()
        uav = Outbox(session, again_key, inbox)
        session.declare_queryable(KEYS.claims, hand_over(inbox.put))

        def both_heard() -> bool:
            for key in (again_key, KEYS.claims):
                asker.get(key, payload=b"\xff noise")
            for query in inbox.wait(0.05):
                heard[str(query.key_expr)] = uav.hear(query)
                query.drop()
            return len(heard) == 2

        await_true(both_heard)
        assert heard == {again_key: True, KEYS.claims: False}
        assert not uav.is_asked


def test_what_is_fetched_takes_no_more_room_than_what_comes_by_itself(bench: Bench, lose: Lose) -> None:
    """The limit on foreign keys holds for keys in a `closed` event too."""
    inbox = Inbox[object]()
    uav = Outbox(bench.session, KEYS.again("u001", "p-1"), inbox)
    keys = [f"{KEYS.event('u001')}/{number}" for number in range(MAX_FOREIGN_KEYS + 200)]
    for key in keys:
        lose(key, {0})
        uav.put(key, b'{"instance":"p-1"}', 0)
    uav.put(KEYS.event("u001"), closed("u001", dict.fromkeys(keys, 0)), 0)
    uav.flush()
    uav.stay(inbox)
    bench.say_last_word()
    fetched = {channel.topic for channel, *_ in bench.end()} & set(keys)
    assert len(fetched) == MAX_FOREIGN_KEYS
    run_end = read_recording(bench.out).run_end
    assert run_end is not None
    assert (run_end["foreign_left_out"], run_end["fetched"]) == ("200", str(MAX_FOREIGN_KEYS))


def test_an_answer_is_taken_for_what_was_asked_and_nothing_else(bench: Bench) -> None:
    """The recorder ignores noise, foreign answers, messages that are not missing; it counts an answer too large.

    The large answer comes three times, since the recorder does not wait for one that takes too long.
    """
    inbox = Inbox[zenoh.Query]()
    bench.session.declare_queryable(KEYS.again("u001", "p-1"), hand_over(inbox.put))
    right = fix(1)
    wrong = msgspec.structs.replace(msgspec.json.decode(right, type=Fix), instance="p-2")
    lies = [Kept(FIX, 1, encode(wrong)), Kept(FIX, 1, fix(7)), Kept(FIX, 0, fix(0)), Kept(FIX, 9, fix(9))]
    lies += [Kept(KEYS.fix("u002"), 1, right), Kept(FIX, 1, b"noise")]
    answers = [
        *[b" " * (MAX_ANSWER_BYTES + 1)] * 3,
        b"noise",
        retransmission.encode(Answer(lies, [])),
        retransmission.encode(Answer([Kept(FIX, 1, right)], [])),
    ]
    for seq in (0, 2):
        bench.put(FIX, fix(seq))
    asked: list[Ask] = []

    def all_answered() -> bool:
        for query in inbox.wait(0.05):
            asked.append(retransmission.decode_ask(query.payload.to_bytes()))  # type: ignore[union-attr]
            query.reply(str(query.key_expr), answers[min(len(asked), len(answers)) - 1])
            query.drop()
        return len(asked) == len(answers)

    await_true(all_answered)
    bench.say_last_word()
    recorded = bench.end()
    assert [(seq, payload) for channel, seq, _, _, payload in recorded if "/fix" in channel.topic][2:] == [(1, right)]
    run_end = read_recording(bench.out).run_end
    assert run_end is not None
    assert 1 <= int(run_end["dropped"]) <= 3
    assert all(ask == asked[0] for ask in asked)
