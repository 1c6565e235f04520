"""Robustness to a hostile publisher: fuzzed messages on every key of a running mission, which must succeed.

A separate process receives all messages, and publishes random bytes, real messages with changed bytes or fields, and
well-formed false messages. It uses the mission's keys, foreign keys, and wildcard keys. If a changed message still
decodes, the process gives it a foreign publisher or a time before the mission. It never forges a message of a UAV of
the roster: only `--secure` protects against that.

    python benchmarks/noise.py [--messages 100000] [--rate 2000] [--seed 0]      runs a mission of its own
    python benchmarks/noise.py --connect tcp/HOST:PORT --messages 1000           joins one
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from random import Random

import msgspec
import zenoh

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.errors import MessageError
from edc_swarm.protocol.codec import MAX_MESSAGE_BYTES, decode, encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Message, MissionMessage
from edc_swarm.recording.reader import read_recording
from processes.bus.address import free_endpoint
from processes.bus.session import hand_over, open_client
from processes.runtime.inbox import Inbox

KEPT = 400
"""Number of recent real messages from which the fuzzer draws the next one to change."""
OVERSIZED_EVERY = 5000
STRANGER = "mallory"
HOUR_NS = 3_600_000_000_000
HOSTILE = [
    b"1e400", b"-1e400", b"NaN", b"Infinity", b"1e308", b"-1", b"0.5", b"1" + b"0" * 40, b"18446744073709551616",
    b"null", b"true", b'""', b'"*"', b'"**"', b'"a/b"', b'"../../x"', b'"\\u0000"', b'"\xff"', b"[]", b"{}", b"[[]]",
    b'{"a":1}', b"[" * 2000 + b"]" * 2000, b'"' + b"x" * 5000 + b'"', b'["' + b'","'.join([b"u001"] * 3000) + b'"]',
    b'"kind":"closed"',
]  # fmt: skip
MISSION_WIDE = ["mission", "event/operator", "event/recorder", "event/viz", "viz/uavs", "viz/log", "viz/status"]
STRANGE = [
    "uav/*/fix",
    "uav/**",
    "**",
    "head/*/command/*",
    "head/*/report",
    "event/*",
    "uav/mallory/fix",
    "a/b/c/d/e/f",
]


class Fuzzer:
    """A source of hostile messages, made from received ones; equal seeds give equal changes."""

    def __init__(self, mission: str, seed: int) -> None:
        self._random = Random(seed)
        self._keys = Keys(mission)
        self._heard: list[tuple[str, bytes]] = []
        self._count = 0

    def hear(self, key: str, payload: bytes) -> None:
        """Keep a real message."""
        self._heard.append((key, payload))
        del self._heard[:-KEPT]

    def next(self) -> tuple[str, bytes]:
        """Return the key and the payload of the next hostile message."""
        random = self._random
        self._count += 1
        key, payload = random.choice(self._heard)
        if self._count % OVERSIZED_EVERY == 0:
            return key, payload + b" " * MAX_MESSAGE_BYTES
        made = random.choice([self._noise, self._damaged, self._damaged, self._replaced, self._replaced])
        return self._harmless(self._key(key), made(payload))

    def _key(self, key: str) -> str:
        """Return the key of the message with high probability, else another key of the mission, or a foreign key."""
        random = self._random
        chance = random.random()
        if chance < 0.75:
            return key
        if chance < 0.9:
            return f"{self._keys.root}/{random.choice(MISSION_WIDE)}"
        if chance < 0.95:
            return f"swarm/{random.choice(['*', 'other'])}/{key.split('/', 2)[2]}"
        return f"{self._keys.root}/{random.choice([*STRANGE, f'uav/x{random.randrange(10_000)}/fix'])}"

    def _noise(self, payload: bytes) -> bytes:
        return self._random.randbytes(
            self._random.choice([0, 1, 10, len(payload), 100_000 if self._count % 50 == 0 else 100])
        )

    def _damaged(self, payload: bytes) -> bytes:
        random, changed = self._random, bytearray(payload)
        for _ in range(random.randint(1, 8)):
            at = random.randrange(len(changed) + 1)
            match random.randrange(4):
                case 0:
                    changed[at : at + 1] = random.randbytes(1)
                case 1:
                    changed[at : at + 1] = b"0123456789-.eE"[(n := random.randrange(14)) : n + 1]
                case 2:
                    changed[at:at] = random.randbytes(random.randint(1, 4))
                case _:
                    del changed[at : at + random.choice([1, 2, 50])]
        return bytes(changed)

    def _replaced(self, payload: bytes) -> bytes:
        """Return a JSON message with one or two fields replaced."""
        random = self._random
        try:
            raw: dict[str, msgspec.Raw] = msgspec.json.decode(payload, type=dict[str, msgspec.Raw])
        except (msgspec.DecodeError, UnicodeDecodeError):
            return self._noise(payload)
        for name in random.sample([*raw, "extra"], k=min(len(raw), random.randint(1, 2))):
            raw[name] = msgspec.Raw(random.choice([*HOSTILE, *map(bytes, raw.values())]))
        return b"{" + b",".join(json.dumps(name).encode() + b":" + bytes(value) for name, value in raw.items()) + b"}"

    def _harmless(self, key: str, payload: bytes) -> tuple[str, bytes]:
        """Return the message, changed if it could pass for a message of a process of the mission."""
        try:
            message = decode(key, payload)
        except MessageError:
            return key, payload
        if isinstance(message, MissionMessage):
            return key, payload[:-1]
        changed = self._older(message) if self._random.random() < 0.5 else self._strange(message)
        return self._keys.of(changed), encode(changed)

    def _older(self, message: Message) -> Message:
        return msgspec.structs.replace(message, instance="old", sent_ns=time.time_ns() - HOUR_NS)

    def _strange(self, message: Message) -> Message:
        names = {"uav", "head", "source"} & set(message.__struct_fields__)
        return msgspec.structs.replace(message, **dict.fromkeys(names, STRANGER))


def annoy(endpoint: str, messages: int, rate: float, seed: int) -> Counter[str]:
    """Publish hostile messages, and return their number by kind of key."""
    inbox: Inbox[tuple[str, bytes]] = Inbox()
    session = open_client(endpoint, timeout_ms=10_000)

    def take(sample: zenoh.Sample) -> None:
        inbox.put((str(sample.key_expr), sample.payload.to_bytes()))

    session.declare_subscriber("swarm/**", hand_over(take), allowed_origin=zenoh.Locality.REMOTE)
    first: list[tuple[str, bytes]] = []
    while not any("/report" in key for key, _ in first):
        first += inbox.wait(1.0)
    fuzzer, said = Fuzzer(first[0][0].split("/")[1], seed), Counter[str]()
    tokens = [
        session.liveliness().declare_token(f"{fuzzer._keys.root}/alive/{name}")
        for name in (STRANGER, "u001/x", "x/y/z")
    ]
    start_s = time.monotonic()
    for number in range(messages):
        for key, payload in first or inbox.wait(0.0):
            fuzzer.hear(key, payload)
        first = []
        key, payload = fuzzer.next()
        said["/".join(key.split("/")[2::2])] += 1
        session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
        time.sleep(max(0.0, start_s + number / rate - time.monotonic()))
    del tokens
    session.close()
    return said


def measure(options: argparse.Namespace) -> int:
    """Run a mission among hostile messages and print its results."""
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "noise.mcap"
        command = [sys.executable, "-m", "processes.cli.main", "run", "--json", "--listen", endpoint, "--out", str(out)]
        run = subprocess.Popen(
            [*command, "--area", str(options.area), "--seed", str(options.seed)], stdout=subprocess.PIPE
        )
        ended = threading.Event()

        def wait_for_end() -> None:
            run.wait()
            ended.set()

        threading.Thread(target=wait_for_end, daemon=True).start()
        said = annoy(endpoint, options.messages, options.rate, options.seed)
        in_time = not ended.is_set()
        metrics = json.loads(run.communicate()[0])
        recording = read_recording(out)
    told = Counter(event.source for event in recording.events if event.kind == EventKind.MALFORMED)
    print(f"{said.total()} hostile messages, {'all' if in_time else 'NOT all'} during the mission")
    print(f"status {run.returncode}, {metrics['arrived']} of {metrics['uavs']} arrived in {metrics['slots']} slots")
    late_pct = metrics["ticks_late_pct"]
    late = f"{'unknown' if late_pct is None else format(late_pct, '.2f')} % of ticks late"
    print(f"{metrics['potential_collisions']} collisions, {late}, {metrics['gaps']} gaps")
    print(f"{len(recording.garbage)} of the recorded messages are ignored; reported by {dict(told)}")
    for result in (result for result in check(recording) if result.broken or not result.judged):
        print(f"{result.status}: {result.guarantee}", *(result.where or result.notes)[:3], sep="\n  ")
    print("crashed:", [event.detail for event in recording.events if event.kind == EventKind.EXITED] or "nobody")
    return int(run.returncode)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--rate", type=float, default=2000.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--area", type=float, default=160_000.0)
    parser.add_argument("--connect")
    options = parser.parse_args()
    if options.connect:
        print(annoy(options.connect, options.messages, options.rate, options.seed).total())
        return 0
    return measure(options)


if __name__ == "__main__":
    sys.exit(main())
