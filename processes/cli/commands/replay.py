"""`edc-swarm replay`: a recording published on a bus, or planned again and compared."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import zenoh
from cyclopts import Parameter

from edc_swarm.analysis.replanning import replan
from edc_swarm.errors import InputError, RecordingError
from edc_swarm.experiments.resimulation import foreign_parts
from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.ground_station.frames import Request
from edc_swarm.ground_station.view import GroundView, check_systems
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.planner.registry import make_planner, warm_up
from edc_swarm.protocol.keys import PREFIX, Keys
from edc_swarm.protocol.messages import Message, MissionMessage
from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.recording.reader import read_recording
from processes.bus.address import free_endpoint, listening_endpoint, parse_endpoint, unreachable_router
from processes.bus.session import open_client, open_router
from processes.runtime.console import FAILED, NOT_JUDGED, note, print_json
from processes.runtime.inbox import Inbox
from processes.runtime.run_facts import made_otherwise
from processes.services.mavlink_link import MavlinkLink, ground_address

CONNECT_TIMEOUT_MS = 5000
MAX_DIFFERENCES_SHOWN = 10
ANSWER_EVERY_S = 0.05
"""Longest time in which a replay looks for no request of a ground station."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Options of `replay`.

    Parameters
    ----------
    speed
        Speed relative to the recorded one (1).
    listen
        Run a router at this address, tcp/HOST:PORT (a free local port).
    connect
        Publish to the router at this address instead of running one.
    wait
        Seconds from opening the bus to the first message, in which others can connect (0).
    verify
        Publish nothing; plan every slot again from the recorded fixes and compare command by command.
    load_planner
        With --verify: run the planner that the recording names, a user's too; only for recordings that you trust.
    mavlink
        Publish nothing; show every UAV to the ground station at this address, udp:HOST:PORT.
    mavlink_commands
        Let that ground station pause the replay and let it go on; what has happened stays as it was.
    json
        Print the result as JSON alone on standard output.
    """

    speed: float = 1.0
    listen: str | None = None
    connect: str | None = None
    wait: float = 0.0
    verify: bool = False
    load_planner: bool = False
    mavlink: str | None = None
    mavlink_commands: bool = False
    json: bool = False


def replay(
    recording: Annotated[Path, Parameter(help="The recording, FILE.mcap.")], /, *, options: ReplayOptions | None = None
) -> int:
    """Publish a recording on a Zenoh bus, message by message as it was; or --verify its plans."""
    options = options or ReplayOptions()
    if options.verify:
        return _verify(recording, as_json=options.json, load_planner=options.load_planner)
    _check(options)
    if options.mavlink_commands and options.mavlink is None:
        raise InputError("--mavlink-commands", options.mavlink_commands, "given together with --mavlink")
    if options.mavlink is not None:
        return _show(recording, ground_address(options.mavlink), options)
    messages = _messages(recording)
    with closing(_session(options)) as session:
        if threading.Event().wait(options.wait):
            return 0
        count = _publish(session, messages, options.speed)
    if options.json:
        print_json({"messages": count})
    else:
        print(f"{count} messages")
    return 0


def _check(options: ReplayOptions) -> None:
    if options.connect is not None:
        parse_endpoint("--connect", options.connect)
    if not (math.isfinite(options.speed) and options.speed > 0):
        raise InputError("--speed", options.speed, "a finite number above 0")
    if not (math.isfinite(options.wait) and 0 <= options.wait <= 3600):
        raise InputError("--wait", options.wait, "between 0 and 3600 seconds")
    if options.listen is not None and options.connect is not None:
        raise InputError("--connect", options.connect, "absent where --listen is given")


def _messages(path: Path) -> list[tuple[str, int, bytes]]:
    """Return key, time and bytes of every message that was on the bus; warn of unreadable ones and leave them out."""
    recording = read_recording(path, salvage=True)
    for problem in recording.problems:
        note(f"warning: {problem}")
    root = Keys(recording.mission.name).root
    found = [(channel.topic, log_ns, payload) for channel, _, log_ns, _, payload in McapFile(path).messages()]
    keys = {topic: _key(root, topic) for topic in {topic for topic, _, _ in found}}
    for topic in sorted(topic for topic, key in keys.items() if key is None):
        note(f"warning: {shown(topic)!r} is no key of a bus: its messages are left out")
    return [(key, ns, payload) for topic, ns, payload in found if (key := keys[topic]) is not None]


def _key(root: str, topic: str) -> str | None:
    """Return the key that was recorded as `topic`, or None if it is no valid key of a bus."""
    key = topic if topic.startswith(f"{PREFIX}/") else f"{root}/{topic.removeprefix('/')}"
    try:
        return None if "*" in key else str(zenoh.KeyExpr(key))
    except zenoh.ZError:
        return None


def _session(options: ReplayOptions) -> zenoh.Session:
    if options.connect is not None:
        try:
            return open_client(options.connect, timeout_ms=CONNECT_TIMEOUT_MS)
        except zenoh.ZError:
            raise InputError("--connect", options.connect, unreachable_router(options.connect)) from None
    endpoint = listening_endpoint(options.listen) if options.listen is not None else free_endpoint()
    try:
        session = open_router(endpoint)
    except zenoh.ZError as error:
        raise InputError("--listen", endpoint, f"an address to listen on ({error})") from None
    note(f"on the bus at {endpoint}")
    return session


def _publish(session: zenoh.Session, messages: list[tuple[str, int, bytes]], speed: float) -> int:
    """Publish at the recorded times; a slow subscriber delays the replay and loses nothing."""
    for key, due_s, payload in _timed(messages, speed):
        time.sleep(max(0.0, due_s - time.monotonic()))
        session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, express=False)
    return len(messages)


def _timed(messages: list[tuple[str, int, bytes]], speed: float) -> Iterator[tuple[str, float, bytes]]:
    if not messages:
        return
    start_s, first_ns = time.monotonic(), messages[0][1]
    for key, log_ns, payload in messages:
        yield key, start_s + (log_ns - first_ns) / NS_PER_S / speed, payload


def _show(path: Path, address: tuple[str, int], options: ReplayOptions) -> int:
    """Show a recording to a ground station, at the recorded times."""
    recording = read_recording(path)
    check_systems(len(recording.mission.roster))
    said: list[Message] = sorted([*recording.fixes, *recording.events], key=lambda message: message.sent_ns)
    with closing(MavlinkLink(*address)) as link:
        screen = _Screen(link, recording.mission, permitted=options.mavlink_commands)
        first_ns = said[0].sent_ns if said else 0
        for message in said:
            screen.wait_for((message.sent_ns - first_ns) / NS_PER_S / options.speed)
            screen.show(message)
    if options.json:
        print_json({"messages": len(said), "denied": dict(screen.view.denied)})
    else:
        print(f"{len(said)} messages")
    return 0


class _Screen:
    """A ground station that watches a replay, and may stop and start it."""

    def __init__(self, link: MavlinkLink, mission: MissionMessage, *, permitted: bool) -> None:
        self._link = link
        self._inbox: Inbox[Request] = Inbox()
        self._start_s = time.monotonic()
        self._paused_s: float | None = None
        self.view = GroundView(permitted=permitted)
        self.view.hear(mission, mission.epoch_ns)
        link.listen(self._inbox.put)

    def show(self, message: Message) -> None:
        """Show a message of the recording."""
        self._link.send(self.view.hear(message, time.monotonic_ns()))

    def wait_for(self, at_s: float) -> None:
        """Answer the ground station until `at_s` of the replay, in which pauses do not count."""
        while (left_s := self._start_s + at_s - time.monotonic()) > 0 or self._paused_s is not None:
            for request in self._inbox.wait(min(max(left_s, 0.0), ANSWER_EVERY_S) or ANSWER_EVERY_S):
                self._link.send(self.view.answer(request))
            self._link.send(self.view.advance(time.monotonic_ns()))
            for order in self.view.take_orders():
                self._obey(order.wish)

    def _obey(self, wish: str) -> None:
        now_s = time.monotonic()
        if wish == "pause" and self._paused_s is None:
            self._paused_s = now_s
        elif wish == "go on" and self._paused_s is not None:
            self._start_s, self._paused_s = self._start_s + now_s - self._paused_s, None


def _verify(path: Path, *, as_json: bool, load_planner: bool) -> int:
    recording = read_recording(path)
    mission = recording.mission
    if not any(report.planner for report in recording.reports):
        raise RecordingError(path, "holds no plan to be verified")
    if mission.clusters > 1:
        raise RecordingError(path, "does not say which UAVs of other clusters a head has heard: no plan is verified")
    if otherwise := made_otherwise(recording.run):
        note(f"note: the recording was {otherwise}: another version may well plan otherwise")
    if not load_planner and mission.planner in foreign_parts(mission):
        raise RecordingError(
            path, f"names the planner {mission.planner}, not one of this project's: --load-planner loads it"
        )
    warm_up(mission)
    result = replan(recording, lambda: make_planner(mission.planner, mission))
    if as_json:
        print_json(result)
    else:
        print(
            f"{result.plans} plans, {result.commands} commands: {result.identical} identical to the last bit, "
            f"greatest difference {result.greatest_off_m:.3g} m, {len(result.differences)} differ; "
            f"{result.skipped} plans skipped, for want of fixes or commands in the record"
        )
        for d in result.differences[:MAX_DIFFERENCES_SHOWN]:
            print(shown(f"  slot {d.slot}: {d.uav} by {d.head} of term {d.term}: {d.off_m:.3g} m apart", MAX_LINE))
    if result.differences:
        return FAILED
    return NOT_JUDGED if result.skipped or not result.plans else 0
