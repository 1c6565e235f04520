"""`edc-swarm join`: UAV processes of this host for a mission that another host operates."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
import zenoh

from edc_swarm.agent.leadership import startup_candidates
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.mission.roles import JOIN, OPERATOR, RECORDER, ROUTER
from edc_swarm.protocol.claims import IdClaim, Issued
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event
from processes.bus.address import unreachable_router
from processes.bus.credentials import certified_uavs, credentials, own_host
from processes.bus.operator_presence import LINGER_S, OperatorPresence
from processes.bus.session import hand_over, try_client
from processes.bus.subscriptions import Gate, Heard, heard_from
from processes.host import fork_source
from processes.host.claim_folder import ClaimFolder, ensure_state
from processes.host.ending import CLOSE_TIMEOUT_S, SILENT, Deaths, begin_end, end_fork_source, how_ended, landing_s
from processes.host.host_parts import HostParts
from processes.host.pool import THE_PLANNER, UavPool
from processes.operator import host_requests
from processes.runtime.children import Child, ChildExited, ChildReady, PartEndedError
from processes.runtime.clock import MissionClock
from processes.runtime.compiling import CompilingNote
from processes.runtime.console import MAX_NAMES, note
from processes.runtime.host_name import host_name
from processes.runtime.loop import LOOK_EVERY_S, Interrupted, Loop
from processes.runtime.output import Output, log_tail
from processes.runtime.voice import Voice
from processes.services.orders import asked
from processes.uav.process import UavSettings

LEAVE_TIMEOUT_S = 60.0
"""Longest wait for the operator to leave after the end of the mission: it may have much to read."""


class Joiner:
    """UAV processes for `uavs` claimed ids of the mission at a router, which end with the mission."""

    def __init__(
        self,
        address: str,
        uavs: int,
        folder: ClaimFolder,
        certs: str = "",
        *,
        cluster: str = "",
        arm: bool = False,
        router: bool = False,
        output: Output | None = None,
    ) -> None:
        self._address = address
        self._endpoint = address
        self._has_router = router
        self._has_own_parts = router or output is not None
        self._certs = certs
        self._arm = arm
        self._cluster = cluster
        self._uavs = uavs
        self._clock = MissionClock()
        self._folder = folder
        self._loop = Loop(self._take)
        self._parts = HostParts(self._loop, folder.path, output, certs)
        self._gate = Gate(lambda detail: note(f"malformed: {detail}"))
        self._session: zenoh.Session | None = None
        self._pool: UavPool | None = None
        self._source: Child | None = None
        self._source_ready = False
        self._compiling = CompilingNote(Voice())
        self._over = False
        self._lands_s = 0.0
        self._crashed = False
        self._deaths = Deaths(self._loop, self._log, self._note_crash)
        self._logs = Path()

    def run(self) -> bool:
        """Fly until the mission ends; return True if it ended without a crash. Afterwards no process is left."""
        self._loop.obey_signals()
        try:
            self._take_part(self._connect())
        except Interrupted:
            note("interrupted")
        finally:
            self._end()
        return self._over and not self._crashed

    def _connect(self) -> zenoh.Session:
        if self._has_router:
            self._endpoint = self._parts.start_router(self._address)

        def connect() -> bool:
            self._session = try_client(self._endpoint, credentials(self._certs, JOIN))
            return self._session is not None

        self._loop.wait(connect, partial(unreachable_router, self._endpoint), look_every_s=LOOK_EVERY_S)
        assert self._session is not None
        return self._session

    def _take_part(self, session: zenoh.Session) -> None:
        presence = OperatorPresence(session)
        mission = self._find_mission(presence)
        keys = Keys(mission)
        token = session.liveliness().declare_token(keys.alive(JOIN, self._folder.claimant))
        issued = self._claim(session, presence, mission)
        session.declare_subscriber(keys.event(OPERATOR), hand_over(self._hear))
        self._parts.start_recorder(self._endpoint, mission, issued.uavs, self._clock)
        self._start_uavs(self._start_source(issued), issued)
        self._attend(presence, mission, partial(self._claim, session, presence, mission))
        token.undeclare()

    def _find_mission(self, presence: OperatorPresence) -> str:
        def found() -> str | None:
            return presence.only_mission(self._address)

        self._loop.wait(lambda: found() is not None, f"a mission at {self._address}", look_every_s=LOOK_EVERY_S)
        mission = found()
        assert mission is not None
        return mission

    def _claim(self, session: zenoh.Session, presence: OperatorPresence, mission: str) -> Issued:
        """Repeat the claim until the operator answers; the same claim always gets the same answer."""
        among = self._certified()
        claim = msgspec.json.encode(
            IdClaim(
                claimant=self._folder.claimant,
                uavs=self._uavs,
                among=among,
                cluster=self._cluster,
                host=host_name(),
            )
        )
        answers: list[Issued] = []

        def ask() -> bool:
            presence.check_there(mission)
            payload = asked(session, Keys(mission).claims, claim)
            with contextlib.suppress(msgspec.DecodeError):
                answers.extend([msgspec.json.decode(payload, type=Issued)] if payload is not None else [])
            return bool(answers)

        self._loop.wait(ask, "an answer of the operator", look_every_s=LOOK_EVERY_S)
        if not answers[0].uavs:
            which = f" of cluster {self._cluster}" if self._cluster else ""
            free = f"no other UAV{which} is left to join"
            free += f" that has a certificate in {self._certs}" if among else ""
            raise InputError("--uavs", self._uavs, f"at most {answers[0].left}: {free}")
        return answers[0]

    def _certified(self) -> list[str]:
        """Return the UAVs that this host may fly; an own router or recorder speaks for those of its host alone."""
        if not self._certs:
            return []
        own = own_host(Path(self._certs)) if self._has_own_parts else None
        return [uav for uav in certified_uavs(self._certs) if own is None or uav in own[1]]

    # --- the UAVs ----------------------------------------------------------------------------

    def _start_source(self, issued: Issued) -> UavPool:
        """Start the fork source; it stays cold for a single UAV that does not lead at the start."""
        self._logs = self._folder.state(issued.mission.name)
        pool = self._pool = UavPool(self._loop.inbox, self._log)
        small = len(issued.uavs) == 1 and issued.uavs[0] not in startup_candidates(issued.mission)
        self._source = pool.start_source(None if small else issued.mission)
        self._loop.wait(lambda: self._source_ready, THE_PLANNER)
        return pool

    def _start_uavs(self, pool: UavPool, issued: Issued) -> None:
        """Start the UAVs that do not fly yet."""
        roster = {entry.uav: entry for entry in issued.mission.roster}
        self._lands_s = landing_s(issued.mission, issued.uavs, arm=self._arm)
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
                    arm=self._arm,
                )
            )
        who = ", ".join(issued.uavs) if len(issued.uavs) <= MAX_NAMES else f"{len(issued.uavs)} UAVs"
        note(f"{host_name()} flies {who} of mission {issued.mission.name}")

    def _replace_uavs(self, pool: UavPool, issued: Issued) -> None:
        """Replace the UAVs after an absence before the mission, in which the operator issued their ids to others."""
        if issued.begun or pool.living.keys() == set(issued.uavs):
            return
        for uav in pool.living.keys() - set(issued.uavs):
            self._deaths.expected.add(uav)  # It may fail before the signal, on a mission that gives its id to another.
            pool.signal(uav, signal.SIGTERM)
        self._start_uavs(pool, issued)

    def _log(self, name: str) -> Path:
        return self._parts.log(name) if name in {RECORDER, ROUTER} else self._logs / f"{name}.log"

    def _attend(self, presence: OperatorPresence, mission: str, claim: Callable[[], Issued]) -> None:
        """Stay until the mission is over and its operator has left, or has been away for too long."""
        pool, absences = self._pool, presence.absences
        assert pool is not None
        while not self._over:
            self._loop.pump(LOOK_EVERY_S)
            presence.check_there(mission)
            if not presence.away_s(mission) and presence.absences > absences:
                absences = presence.absences
                self._replace_uavs(pool, claim())
        self._loop.wait_quietly(lambda: not pool.living, CLOSE_TIMEOUT_S + self._lands_s)
        self._folder.forget()
        self._loop.wait_quietly(lambda: presence.away_s(mission) > LINGER_S, LEAVE_TIMEOUT_S, LOOK_EVERY_S)

    def _obey(self, request: host_requests.HostRequest | None) -> None:
        """Carry out the operator's request if it is for a UAV of this host."""
        pool = self._pool
        if request is None or pool is None or request.uav not in pool:
            return
        if isinstance(request, host_requests.RestartProcess):
            self._deaths.expected.add(request.uav)
            pool.restart(request.uav, lose_memory=request.lose_memory)
        else:
            if request.number == signal.SIGKILL:
                self._deaths.expected.add(request.uav)
            pool.signal(request.uav, request.number)

    # --- one loop ----------------------------------------------------------------------------

    def _hear(self, sample: zenoh.Sample) -> None:
        heard = heard_from(sample)
        self._loop.inbox.put(heard, len(heard.payload))

    def _take(self, item: object) -> None:
        match item:
            case Heard():
                self._take_event(item)
            case fork_source.Ready():
                self._compiling.end()
                self._source_ready = True
            case fork_source.Compiling(done=done):
                self._compiling.tell(done)
            case fork_source.Failed(reason=reason):
                self._loop.failure = SwarmError(reason)
            case fork_source.Forked() | fork_source.Exited() if self._pool is not None:
                if isinstance(item, fork_source.Exited):
                    self._deaths.take(item.uav, item.status)
                self._pool.take(item)
            case ChildReady(name):
                self._parts.ready.add(name)
            case ChildExited(name, _, status) if not self._loop.ending:
                self._take_exit(name, status)

    def _take_exit(self, name: str, status: int) -> None:
        """Take in the end of a child: the UAVs fly on without a recorder, and end without any other."""
        if name == RECORDER and name in self._parts.ready:
            if status:
                self._note_crash(f"the {name} {how_ended(status)}", log_tail(self._log(name)))
        else:
            last_lines = log_tail(self._log(name)) or SILENT
            self._loop.failure = PartEndedError(f"the {name} {how_ended(status)}: {last_lines}")

    def _take_event(self, heard: Heard) -> None:
        match self._gate.admit(heard):
            case Event(kind=EventKind.END):
                self._over = True
            case Event(kind=EventKind.HOST_REQUEST, detail=detail):
                self._obey(host_requests.decode_request(detail))

    def _note_crash(self, text: str, last_lines: str) -> None:
        self._crashed = True
        note(f"{text}: {last_lines or SILENT}")

    def _end(self) -> None:
        """Let the UAVs publish their last messages, then end all processes."""
        pool = self._pool
        begin_end(self._loop, pool)
        if pool is not None:
            for uav in list(pool.living):
                pool.signal(uav, signal.SIGTERM)
            self._loop.wait_quietly(lambda: not pool.living, CLOSE_TIMEOUT_S + self._lands_s)
        end_fork_source(pool, self._source)
        if self._session is not None:
            self._session.close()
        self._parts.end()
