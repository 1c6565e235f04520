"""One UAV: `python -m processes.uav.process --endpoint tcp/HOST:PORT --mission ID --uav ID --state FOLDER`.

One loop feeds `UavNode` with the messages from the bus and the time of its clock, and carries out the
effects in their order. Zenoh's callbacks only put items into the inbox; they never call Zenoh.
"""

from __future__ import annotations

import argparse
import os
import secrets
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NoReturn

import msgspec
import zenoh
from msgspec import Struct

from edc_swarm.agent.node import (
    Effect,
    Land,
    Listen,
    NodeEvent,
    PeerGone,
    Persist,
    PlannerReady,
    Publish,
    Received,
    Strayed,
    Tick,
    UavNode,
    WantPlanner,
)
from edc_swarm.agent.vehicle import Airframe, comes_too_late
from edc_swarm.autopilot.pilot import Said
from edc_swarm.emulation.links import LinkEmulator, have_range
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.planner.interface import Planner
from edc_swarm.protocol.claims import LAUNCHED, instance_name
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event, Goal, Message, MissionMessage, Truth
from processes.bus.credentials import credentials
from processes.bus.outbox import Outbox
from processes.bus.peers import Peers
from processes.bus.session import is_connected, open_client
from processes.bus.subscriptions import Gate, Heard, Item, Postbox, Token, UavSubscriptions, sender_of
from processes.runtime.clock import MissionClock
from processes.runtime.inbox import Inbox
from processes.runtime.priority import come_first, give_way
from processes.uav.autopilot_part import AutopilotPart
from processes.uav.flight import Flight, rehearse
from processes.uav.local_faults import LocalFaults
from processes.uav.planner_loader import SlowPlanner, load_planner
from processes.uav.publisher import Publisher
from processes.uav.response_time import measured_response_ms
from processes.uav.state import UavState
from processes.uav.wake_ups import WakeUps


class UavSettings(Struct, frozen=True, kw_only=True):
    """Settings of a UAV process; the mission message has all the rest.

    `certs`: folder with the own certificate on a secured bus. `measure_response`: measure the
    response time before connecting, not when the mission begins. `claimant`: holder of the id, "" under
    the launcher. `clock_ahead_ns`: offset of the starting process's clock, None for an own one. `arm`: permission to
    arm the vehicle of an autopilot.
    """

    endpoint: str
    mission: str
    uav: str
    state: str
    certs: str = ""
    measure_response: bool = False
    claimant: str = LAUNCHED
    clock_ahead_ns: int | None = None
    arm: bool = False


@dataclass(frozen=True, slots=True)
class Leave:
    """Order to close and end."""


class UavProcess:
    """A UAV on the bus, from its connection to its last message."""

    def __init__(self, settings: UavSettings) -> None:
        self._settings = settings
        self._state = UavState(Path(settings.state), settings.uav)
        self._instance = instance_name(f"{os.getpid()}-{secrets.token_hex(4)}", settings.claimant)
        self._clock = MissionClock(settings.clock_ahead_ns)
        self._inbox: Inbox[Item] = Inbox()
        self._gate = Gate(self._report_malformed)
        self._peers = Peers()
        self._flight: Flight | None = None
        self._leaving = False
        self._comes_first = False
        give_way()  # Before Zenoh's threads begin, which inherit it.
        self._response_ms = measured_response_ms() if settings.measure_response else 0.0
        self._session = open_client(settings.endpoint, credentials(settings.certs, settings.uav))
        keys = Keys(settings.mission)
        self._outbox = Outbox(self._session, keys.again(settings.uav, self._instance), self._inbox)
        self._publisher = Publisher(keys, self._outbox, self._clock)
        self._subscriptions = UavSubscriptions(self._session, keys, settings.uav, self._inbox)
        self._wake_ups = WakeUps(self._clock, self._inbox, self._outbox, self._publisher, self._subscriptions)
        self._token = self._session.liveliness().declare_token(keys.alive(settings.uav, self._instance))
        self._subscriptions.ask_for_mission()

    def leave(self) -> None:
        """Order the loop to end; a signal handler may call this."""
        self._inbox.put_always(Leave())

    def run(self) -> None:
        """Work until the order to leave, then publish the last sequence numbers and end."""
        while not self._leaving:
            items = self._wake_ups.wait(self._peers.next_ns)
            for item in items:
                self._take(item)
            if items and self._wake_ups.in_crowd and not self._subscriptions.hears_swarm:
                self._publisher.send_truth()
            self._deliver_postponed()
            self._check_peers()
            self._tick()
            self._check_clock()
            self._outbox.flush()
        self._close()

    # --- taking in ---------------------------------------------------------------------------

    def _take(self, item: Item) -> None:
        match item:
            case Heard():
                self._hear(item)
            case Token():
                self._peers.take(item, self._clock.now_ns())
            case PlannerReady():
                self._step(item)
            case Leave():
                self._leaving = True
            case Said():
                self._note(item)
            case zenoh.Query():
                self._outbox.hear(item)

    def _note(self, said: Said) -> None:
        """Publish news of the autopilot; the node strays, or leaves, if it no longer flies."""
        assert self._flight is not None
        match said.kind:
            case "strayed":
                self._step(Strayed(said.text))
            case "grounded":
                self._carry_out([self._flight.node.event(EventKind.GROUNDED, said.text)])
                self._leaving = True
            case _:
                self._carry_out([self._flight.node.event(EventKind.AUTOPILOT, said.text)])

    def _hear(self, heard: Heard) -> None:
        match message := self._gate.admit(heard):
            case None:
                pass
            case MissionMessage():
                self._begin(message)
            case Event(source="operator"):
                self._obey(message)
            case Truth():
                if self._flight is not None:
                    self._flight.place(message)
            case Goal():
                self._step(Received(message))
            case _:
                self._receive(message, heard)

    def _report_malformed(self, detail: str) -> None:
        if self._flight is not None:
            self._carry_out([self._flight.node.event(EventKind.MALFORMED, detail)])

    def _begin(self, mission: MissionMessage) -> None:
        """Make the node of this mission; a second mission never replaces the first."""
        if self._flight is not None:
            return
        entry = next((entry for entry in mission.roster if entry.uav == self._settings.uav), None)
        if entry is None:
            raise InputError("uav", self._settings.uav, f"in the roster of mission {mission.name}")
        self._clock.check_epoch(mission)
        if mission.claimant_of(entry.uav) != self._settings.claimant:
            raise InputError("uav", entry.uav, f"an id that mission {mission.name} has not issued to another claimant")
        if mission.elect == "response-time" and not self._response_ms:
            self._response_ms = measured_response_ms()
        autopilot = AutopilotPart.of(mission, entry, self._state, self._clock, self._inbox, arm=self._settings.arm)
        if autopilot is None:
            rehearse(mission, entry)
        node = UavNode(
            mission,
            entry.uav,
            self._instance,
            self._state.promise,
            self._state.airframe,
            response_ms=self._response_ms * entry.compute_factor,
            cpu_s=time.process_time,
            body=autopilot.body if autopilot is not None else None,
        )
        self._gate.know(mission)
        self._subscriptions.join_cluster(mission, entry.uav)
        postbox = Postbox(LinkEmulator(mission, entry.uav))
        if have_range(mission):
            self._subscriptions.listen_to_truths()
        faults = LocalFaults(mission, entry.uav, postbox.links, self._clock)
        self._flight = self._wake_ups.flight = Flight(mission, node, postbox, faults, autopilot)
        self._carry_out(node.wishes())

    def _obey(self, event: Event) -> None:
        """Carry out the operator's event: end, or apply a fault."""
        if event.kind == EventKind.END:
            if self._flight is None:
                self._leaving = True
            else:
                self._flight.end(event.detail, self._clock.now_ns())
        elif event.kind == EventKind.FAULT and self._flight is not None:
            for node_event in self._flight.faults.apply(event.detail):
                self._step(node_event)

    def _receive(self, message: Message, heard: Heard) -> None:
        """Pass a message, which came as `heard`, through the link model to the node."""
        if self._flight is None or sender_of(message) == self._settings.uav:
            return
        now_ns = self._clock.now_ns() - (time.monotonic_ns() - heard.at_ns)
        if self._flight.postbox.arrive(message, now_ns, self._flight.mission_s(now_ns), len(heard.payload)):
            self._step(Received(message))

    def _deliver_postponed(self) -> None:
        if self._flight is None:
            return
        while (message := self._flight.postbox.take_due(self._clock.now_ns())) is not None:
            self._step(Received(message))

    def _check_peers(self) -> None:
        """Report a gone peer to the node, if the own session is up and no fault cuts the link to that peer."""
        now_ns = self._clock.now_ns()
        for uav in self._peers.gone(now_ns):
            flight = self._flight
            if flight is None or not is_connected(self._session):
                continue
            if not flight.postbox.links.is_cut(uav, flight.mission_s(now_ns)):
                self._step(PeerGone(uav))

    def _tick(self) -> None:
        """Step the node with a `Tick` if the wake-up time that it named before the wait has come."""
        if self._flight is not None and self._clock.now_ns() >= self._flight.wake_ns:
            self._step(Tick())
            self._wake_ups.await_report(self._flight)
        if self._flight is not None and self._flight.leave_ns is not None:
            self._leaving = self._leaving or self._clock.now_ns() >= self._flight.leave_ns

    def _check_clock(self) -> None:
        if self._flight is not None and (jump := self._clock.jump()) is not None:
            self._carry_out([self._flight.node.event(EventKind.CLOCK_JUMP, jump)])

    # --- carrying out ------------------------------------------------------------------------

    def _step(self, event: NodeEvent) -> None:
        if self._flight is not None and (effects := self._flight.node.step(event, self._clock.now_ns())):
            self._carry_out(effects)

    def _carry_out(self, effects: Sequence[Effect]) -> None:
        for done, effect in enumerate(effects):
            match effect:
                case Persist(promise, airframe):
                    if self._comes_too_late(airframe):
                        assert self._flight is not None
                        self._carry_out(self._flight.node.ground(effects[done:]))
                        return
                    self._state.write(promise, airframe)
                case Publish(message):
                    self._publisher.publish(message)
                    if isinstance(message, Truth) and self._flight is not None:
                        self._flight.place(message)
                case Listen(all_fixes, near):
                    self._subscriptions.listen_to_fixes(all_fixes, near)
                case WantPlanner(rehearsed):
                    assert self._flight is not None
                    self._take_precedence()
                    take = partial(self._take_planner, self._flight.faults)
                    load_planner(self._flight.mission, take, rehearsed=rehearsed)
                case Land():
                    self._leaving = True
        if not (self._subscriptions.hears_swarm or self._wake_ups.in_crowd):
            self._publisher.send_truth()
        self._outbox.flush()
        self._take_precedence()
        if (flight := self._flight) is not None and self._subscriptions.watch(flight.node.grant[1], flight.node.slot):
            self._peers = Peers()

    def _take_precedence(self) -> None:
        """Put this process before all followers while they wait for it."""
        comes_first = self._flight is not None and self._flight.node.is_awaited
        if comes_first != self._comes_first:
            self._comes_first = comes_first
            (come_first if comes_first else give_way)()

    def _comes_too_late(self, airframe: Airframe) -> bool:
        """Return True if the vehicle has begun to land and so does not accept the step to be written."""
        assert self._flight is not None
        return comes_too_late(airframe, self._state.airframe, self._flight.mission, self._clock.now_ns())

    def _take_planner(self, faults: LocalFaults, planner: Planner) -> None:
        faults.planner = SlowPlanner(planner)
        self._inbox.put_always(PlannerReady(faults.planner))

    def _close(self) -> None:
        if self._flight is not None and self._flight.autopilot is not None:
            for said in self._flight.autopilot.landed():
                self._note(said)
        self._publisher.send_truth()
        if self._flight is not None:
            self._carry_out([*self._flight.delay_error(), *self._flight.link_delays()])
            last = msgspec.json.encode(self._flight.node.last_seqs).decode()
            self._carry_out([self._flight.node.event(EventKind.CLOSED, last)])
        self._outbox.stay(self._inbox)
        self._session.close()


def run_uav(settings: UavSettings, *, obey_ctrl_c: bool) -> int:
    """Run the UAV of `settings` until the mission ends, and return the exit status.

    UAVs of the launcher ignore Ctrl-C: the launcher ends them in order.
    """
    try:
        process = UavProcess(settings)
        signal.signal(signal.SIGTERM, lambda *_: process.leave())
        signal.signal(signal.SIGINT, (lambda *_: process.leave()) if obey_ctrl_c else signal.SIG_IGN)
        process.run()
    except (SwarmError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def main() -> NoReturn:
    """Run one UAV that no fork source has forked, and end this process."""
    parser = argparse.ArgumentParser(prog="python -m processes.uav.process", description="One UAV on the bus.")
    for name, text in (
        ("endpoint", "the router, tcp/HOST:PORT"),
        ("mission", "id of the mission"),
        ("uav", "own id, one of the roster"),
        ("state", "folder with the state files of promise and airframe"),
    ):
        parser.add_argument(f"--{name}", required=True, help=text)
    parser.add_argument("--certs", default="", help="folder with the own certificate, on a secured bus")
    status = run_uav(UavSettings(**vars(parser.parse_args())), obey_ctrl_c=True)
    sys.stderr.flush()
    os._exit(status)  # An interpreter that ends aborts if a thread is in OSQP, as while it loads the planner.


__all__ = ["UavProcess", "UavSettings", "main", "run_uav"]

if __name__ == "__main__":
    main()
