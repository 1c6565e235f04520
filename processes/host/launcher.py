"""`edc-swarm run`: starts all processes, waits for them on the bus, flies the mission, ends all processes.

Other hosts may fly some of the UAVs (`edc-swarm join`). On a given bus, others run every process, and this command
is the operator alone.
"""

from __future__ import annotations

import time

import msgspec
import zenoh

from edc_swarm.errors import SwarmError
from edc_swarm.mission.autopilots import autopilots
from edc_swarm.mission.configuration import Mission
from processes.bus.subscriptions import Heard, Token
from processes.host import fork_source
from processes.host.ending import CLOSE_TIMEOUT_S, RECORDER_TIMEOUT_S, begin_end, landing_s
from processes.host.pool import FORK_SOURCE
from processes.host.run_report import RunReport, report_on
from processes.host.run_setup import Bus, Protection, RunSetup, View
from processes.host.run_state import RunState
from processes.host.start import RunStart
from processes.host.watch import MissionWatch
from processes.operator.bus_client import Operator
from processes.operator.takeover import new_mission_id
from processes.runtime.children import ChildExited, ChildReady, PartEndedError
from processes.runtime.compiling import CompilingNote
from processes.runtime.console import note
from processes.runtime.loop import LOOK_EVERY_S, Interrupted, Loop
from processes.runtime.output import Output
from processes.runtime.voice import Voice
from processes.services.ground_station import NAME as GROUND
from processes.services.recorder import CANNOT_WRITE
from processes.services.recorder import NAME as RECORDER
from processes.services.visualiser import NAME as VIZ
from processes.uav.flight import FAILED, INTERRUPTED


class Launcher:
    """One run: its processes, from the first to the last.

    The last `remote` UAVs of the roster fly on other hosts; on a given `bus`, others run every process.
    """

    def __init__(
        self,
        mission: Mission,
        output: Output,
        *,
        listen: str | None,
        view: View,
        voice: Voice,
        remote: int = 0,
        bus: Bus | None = None,
        protection: Protection | None = None,
        arm: bool = False,
    ) -> None:
        takeover = bus.takeover if bus is not None else None
        name = takeover.mission_id if takeover is not None else new_mission_id(mission)
        self._setup = RunSetup(
            mission=msgspec.structs.replace(mission, name=name),
            output=output,
            listen=listen,
            view=view,
            voice=voice,
            remote=remote,
            bus=bus,
            protection=protection,
            arm=arm,
        )
        self._compiling = CompilingNote(voice)
        self._loop = Loop(self._take, self._flush)
        self._state = RunState(self._setup, self._loop)
        self._parts = self._state.parts
        self._watch = MissionWatch(self._state)

    def run(self) -> RunReport:
        """Fly the mission; afterwards no process is left and the recording is complete."""
        self._loop.obey_signals()
        try:
            RunStart(self._state).start()
            self._watch.run()
        except Interrupted:
            pass
        except PartEndedError as ended:
            self._state.failed = True
            self._state.notes.append(f"error: {' '.join(str(ended).split())}")
        finally:
            self._end()
        return report_on(self._state)

    def leave(self) -> None:
        """Leave the bus, after everything else: the parts of a given bus stay until their operator has left."""
        if self._state.operator is not None:
            self._state.operator.disconnect()

    # --- one loop ----------------------------------------------------------------------------

    def _flush(self) -> None:
        if self._state.operator is not None:
            self._state.operator.flush()

    def _take(self, item: object) -> None:
        match item:
            case Heard() | Token() | zenoh.Query():
                self._state.bus.take(item)
            case ChildReady(name):
                self._parts.ready.add(name)
                self._state.deaths.expected.discard(name)
            case ChildExited(name, _, status):
                self._take_exit(name, status)
            case _:
                self._take_news(item)

    def _take_news(self, news: object) -> None:
        match news:
            case fork_source.Ready(warm_s=warm_s):
                self._compiling.end()
                self._state.times.warm_s, self._state.times.ready_at_s = warm_s, time.monotonic()
                self._parts.ready.add(FORK_SOURCE)
            case fork_source.Compiling(done=done):
                self._compiling.tell(done)
            case fork_source.Failed(reason=reason):
                self._loop.failure = SwarmError(reason)
            case fork_source.Forked():
                self._parts.pool.take(news)
            case fork_source.Exited():
                self._watch.take_uav_exit(news)

    def _take_exit(self, name: str, status: int) -> None:
        """Take in the end of a child: the mission goes on without a viewer, and ends without any other."""
        deaths, output = self._state.deaths, self._setup.output
        if self._parts.take_exit(name) or self._loop.ending or name in deaths.expected:
            return
        if name in {VIZ, GROUND}:
            deaths.take(name, status)
        elif name == RECORDER and status == CANNOT_WRITE:
            self._loop.failure = output.cannot_write(output.last_line(RECORDER))
        elif name == RECORDER and self._state.times.publishing_at_s is not None:
            deaths.take(name, status)  # No recorder is left: end in order, and keep the messages recorded so far.
            self._loop.interrupted = True
        else:
            self._state.fail(name, name, status)

    # --- end ---------------------------------------------------------------------------------

    def _end(self) -> None:
        """Let all parts publish their last messages, then end all processes."""
        begin_end(self._loop, self._parts.pool)
        self._parts.cancel_restart()
        if self._state.operator is not None:
            self._close_bus(self._state.operator)
        self._parts.end()

    def _close_bus(self, operator: Operator) -> None:
        """Close the publishers, then the operator, whose last message ends the recorder.

        The router keeps the order. So once the operator has heard a publisher's last message, that message
        is in the recorder's queue before the operator's.
        """
        self._state.publish_end(INTERRUPTED if self._loop.interrupted else FAILED)
        remote = set(self._setup.elsewhere) & operator.alive
        flown = {*self._parts.pool.living, *self._setup.elsewhere}
        lands_s = landing_s(self._setup.mission, flown, arm=self._setup.arm)
        if lands_s:
            note(f"landing {len(flown & autopilots(self._setup.mission).keys())} vehicles")
        publishers = {*self._parts.pool.living, *remote, *self._state.viewers}
        self._loop.wait_quietly(lambda: operator.seen.closed >= publishers, CLOSE_TIMEOUT_S + lands_s)
        operator.close()
        self._await_recorder()
        if self._setup.bus is None:
            operator.disconnect()

    def _await_recorder(self) -> None:
        """Let the recorder finish; after a failure or Ctrl-C only as long as its file still grows.

        An overloaded recorder has a backlog at the end of a run; one that is killed meanwhile would seem to have died.
        """
        hurried = self._loop.interrupted or self._loop.failure is not None
        end_s = time.monotonic() + RECORDER_TIMEOUT_S
        while not self._is_recorded() and time.monotonic() < end_s:
            written_bytes = self._written_bytes()
            self._loop.wait_quietly(
                self._is_recorded, CLOSE_TIMEOUT_S if hurried else end_s - time.monotonic(), LOOK_EVERY_S
            )
            if hurried and self._written_bytes() == written_bytes:
                return

    def _written_bytes(self) -> int:
        part = self._setup.output.part
        return part.stat().st_size if part.exists() else 0

    def _is_recorded(self) -> bool:
        """Return True if the recorder has finished."""
        if self._setup.bus is not None:
            return not self._setup.output.part.exists()
        return RECORDER not in self._parts.children
