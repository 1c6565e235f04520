"""`edc-swarm join`: UAV processes of this host for a mission that another host operates."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
import zenoh

from edc_swarm.agent.node import startup_candidates
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.mission.configuration import JOIN, OPERATOR
from edc_swarm.protocol.claims import Claim, Issued
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event
from processes.bus.address import unreachable_router
from processes.bus.credentials import certified_uavs, credentials
from processes.bus.operator_presence import LINGER_S, OperatorPresence
from processes.bus.session import hand_over, try_client
from processes.bus.subscriptions import Gate, Heard, heard_from
from processes.host import fork_source
from processes.host.claim_folder import ClaimFolder, ensure_state
from processes.host.pool import UavPool
from processes.operator import host_requests
from processes.runtime.children import Child, ChildExited, PartEndedError
from processes.runtime.clock import MissionClock
from processes.runtime.console import note
from processes.runtime.loop import Interrupted, Loop
from processes.services.orders import asked
from processes.uav.process import UavSettings

LOOK_EVERY_S = 0.1
CLOSE_TIMEOUT_S = 1.2
MOST_NAMED = 10
LEAVE_TIMEOUT_S = 60.0
"""Longest wait for the operator to leave after the end of the mission: it may have much to read."""


class Joiner:
    """Claims `uavs` ids of the mission at a router, flies them and ends with the mission."""

    def __init__(self, endpoint: str, uavs: int, folder: ClaimFolder, certs: str = "") -> None:
        self._endpoint = endpoint
        self._certs = certs
        self._uavs = uavs
        self._clock = MissionClock()
        self._folder = folder
        self._loop = Loop(self._take)
        self._gate = Gate(lambda detail: note(f"malformed: {detail}"))
        self._session: zenoh.Session | None = None
        self._pool: UavPool | None = None
        self._source: Child | None = None
        self._source_ready = False
        self._over = False
        self._crashes: list[str] = []
        self._ordered_deaths: set[str] = set()
        self._logs = Path()

    def run(self) -> bool:
        """Fly until the mission ends; whether it ended in order. Afterwards no process is left."""
        self._loop.obey_signals()
        try:
            self._take_part(self._connect())
        except Interrupted:
            note("interrupted")
        finally:
            self._end()
        return self._over and not self._crashes

    def _connect(self) -> zenoh.Session:
        def connect() -> bool:
            self._session = try_client(self._endpoint, credentials(self._certs, JOIN))
            return self._session is not None

        self._loop.wait(connect, partial(unreachable_router, self._endpoint), look_every_s=LOOK_EVERY_S)
        assert self._session is not None
        return self._session

    def _take_part(self, session: zenoh.Session) -> None:
        operators = OperatorPresence(session)
        mission = self._found(lambda: operators.only_mission(self._endpoint), "a mission")
        keys = Keys(mission)
        token = session.liveliness().declare_token(keys.alive(JOIN, self._folder.claimant))
        issued = self._claim(session, operators, mission)
        session.declare_subscriber(keys.event(OPERATOR), hand_over(self._hear))
        self._fly(self._start(issued), issued)
        self._attend(operators, mission, partial(self._claim, session, operators, mission))
        token.undeclare()

    def _found(self, look: Callable[[], str | None], what: str) -> str:
        self._loop.wait(lambda: look() is not None, f"{what} at {self._endpoint}", look_every_s=LOOK_EVERY_S)
        found = look()
        assert found is not None
        return found

    def _claim(self, session: zenoh.Session, operators: OperatorPresence, mission: str) -> Issued:
        """Ask until the operator answers; the same claim has the same answer, so it may be repeated."""
        among = certified_uavs(self._certs) if self._certs else []
        claim = msgspec.json.encode(Claim(claimant=self._folder.claimant, uavs=self._uavs, among=among))
        answers: list[Issued] = []

        def ask() -> bool:
            operators.check_there(mission)
            payload = asked(session, Keys(mission).claims, claim)
            with contextlib.suppress(msgspec.DecodeError):
                answers.extend([msgspec.json.decode(payload, type=Issued)] if payload is not None else [])
            return bool(answers)

        self._loop.wait(ask, "an answer of the operator", look_every_s=LOOK_EVERY_S)
        if not answers[0].uavs:
            whom = "else is to be flown by others" + (f" and has a certificate in {self._certs}" if among else "")
            raise InputError("--uavs", self._uavs, f"at most {answers[0].left}: nobody {whom}")
        return answers[0]

    # --- the UAVs ----------------------------------------------------------------------------

    def _start(self, issued: Issued) -> UavPool:
        """Start the fork source; a UAV alone that will not lead at the start stays small."""
        self._logs = self._folder.state(issued.mission.name)
        pool = self._pool = UavPool(self._loop.inbox, self._log)
        small = len(issued.uavs) == 1 and issued.uavs[0] not in startup_candidates(issued.mission)
        self._source = pool.start_source(None if small else issued.mission)
        self._loop.wait(lambda: self._source_ready, "the planner to be imported, at the first run compiled")
        return pool

    def _fly(self, pool: UavPool, issued: Issued) -> None:
        """Fork the UAVs that do not fly yet."""
        roster = {entry.uav: entry for entry in issued.mission.roster}
        for uav in (uav for uav in issued.uavs if uav not in pool.living):
            ensure_state(self._logs, roster[uav], begun=issued.begun)
            pool.start(
                UavSettings(
                    endpoint=self._endpoint,
                    mission=issued.mission.name,
                    uav=uav,
                    state=str(self._logs.resolve()),
                    certs=self._certs,
                    measure_response=issued.mission.elect == "response-time",
                    claimant=self._folder.claimant,
                    clock_ahead_ns=self._clock.ahead_ns,
                )
            )
        who = ", ".join(issued.uavs) if len(issued.uavs) <= MOST_NAMED else f"{len(issued.uavs)} UAVs"
        note(f"flying {who} of mission {issued.mission.name}")

    def _fly_instead(self, pool: UavPool, issued: Issued) -> None:
        """After an absence before the mission: the ids may have been issued to others meanwhile."""
        if issued.begun or pool.living.keys() == set(issued.uavs):
            return
        for uav in pool.living.keys() - set(issued.uavs):
            self._ordered_deaths.add(uav)  # It may hear first that the mission has given its id to another.
            pool.signal(uav, signal.SIGTERM)
        self._fly(pool, issued)

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"

    def _attend(self, operators: OperatorPresence, mission: str, claim: Callable[[], Issued]) -> None:
        """Stay until the mission is over and its operator has left, or has been away for too long."""
        pool, absences = self._pool, operators.absences
        assert pool is not None
        while not self._over:
            self._loop.pump(LOOK_EVERY_S)
            operators.check_there(mission)
            if not operators.away_s(mission) and operators.absences > absences:
                absences = operators.absences
                self._fly_instead(pool, claim())
        self._loop.wait_quietly(lambda: not pool.living, CLOSE_TIMEOUT_S)
        self._folder.forget()
        self._loop.wait_quietly(lambda: operators.away_s(mission) > LINGER_S, LEAVE_TIMEOUT_S, LOOK_EVERY_S)

    def _obey(self, deed: host_requests.Deed | None) -> None:
        """Do to the own UAVs what a fault calls for."""
        pool = self._pool
        if deed is None or pool is None or deed.uav not in pool:
            return
        if isinstance(deed, host_requests.Restart):
            self._ordered_deaths.add(deed.uav)
            pool.restart(deed.uav, lose_memory=deed.lose_memory)
        else:
            if deed.number == signal.SIGKILL:
                self._ordered_deaths.add(deed.uav)
            pool.signal(deed.uav, deed.number)

    # --- one loop ----------------------------------------------------------------------------

    def _hear(self, sample: zenoh.Sample) -> None:
        heard = heard_from(sample)
        self._loop.inbox.put(heard, len(heard.payload))

    def _take(self, item: object) -> None:
        match item:
            case Heard():
                self._take_event(item)
            case fork_source.Ready():
                self._source_ready = True
            case fork_source.Failed(reason=reason):
                self._loop.failure = SwarmError(reason)
            case fork_source.Forked() | fork_source.Exited() if self._pool is not None:
                if isinstance(item, fork_source.Exited):
                    self._note_crash(item)
                self._pool.take(item)
            case ChildExited(name, _, status) if not self._loop.ending:
                self._loop.failure = PartEndedError(f"the {name} ended with status {status}: {_tail(self._log(name))}")

    def _take_event(self, heard: Heard) -> None:
        match self._gate.admit(heard):
            case Event(kind=EventKind.END):
                self._over = True
            case Event(kind=EventKind.HOST_REQUEST, detail=detail):
                self._obey(host_requests.asked_for(detail))

    def _note_crash(self, news: fork_source.Exited) -> None:
        """A process that nobody asked to die is told of, with the last that it said."""
        if news.status != 0 and news.uav not in self._ordered_deaths and not self._loop.ending:
            self._crashes.append(news.uav)
            note(f"{news.uav} ended with status {news.status}: {_tail(self._log(news.uav))}")
        self._ordered_deaths.discard(news.uav)

    def _end(self) -> None:
        """Let the UAVs say the last word, then see to it that nobody is left."""
        self._loop.ending = True
        pool, source = self._pool, self._source
        if pool is not None:
            pool.to_restart.clear()
            for uav in list(pool.living):
                pool.signal(uav, signal.SIGTERM)
            self._loop.wait_quietly(lambda: not pool.living, CLOSE_TIMEOUT_S)
            pool.close()
        if source is not None:
            source.end(CLOSE_TIMEOUT_S)
        if self._session is not None:
            self._session.close()


def _tail(log: Path, lines: int = 8) -> str:
    """The last that a process said."""
    try:
        return "\n".join(log.read_text(errors="replace").splitlines()[-lines:]) or "it said nothing"
    except OSError:
        return "it said nothing"
