"""Watch of a mission: its begin, its faults, the presence of remote parts, and the reason for its end."""

from __future__ import annotations

import signal
import time

from edc_swarm.mission.autopilots import takeoff_s
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.prospect import COMPLETED, GIVEN_UP, NOBODY_LEFT, STALLED
from edc_swarm.mission.roles import ROUTER
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import MissionMessage, mission_message
from processes.host import fork_source
from processes.host.run_state import RunState
from processes.operator import host_requests
from processes.operator.bus_client import Operator
from processes.operator.fault_injector import Injector
from processes.operator.ground_commands import GroundCommands
from processes.operator.remote_parts import Remote
from processes.runtime.children import PartEndedError
from processes.runtime.console import note
from processes.runtime.display import Display
from processes.runtime.loop import LOOK_EVERY_S
from processes.services.recorder import NAME as RECORDER

EPOCH_AHEAD_NS = 200_000_000
READ_NS = 10_000_000
MOST_AHEAD_NS = 5_000_000_000
"""Time from the mission's publication to its slot 0, more for each UAV, all of which read the mission first, and the
most."""


class MissionWatch:
    """Watch of the mission from its begin to its end. The fault injector uses it as its `Processes`."""

    def __init__(self, state: RunState) -> None:
        self._state = state
        self._setup = state.setup
        self._parts = state.parts
        self._remote = Remote([*self._setup.elsewhere, *((RECORDER,) if self._setup.bus is not None else ())])
        self._injector: Injector | None = None
        self._ground: GroundCommands | None = None

    def run(self) -> None:
        """Begin the mission and watch it until it ends; then publish its end."""
        mission, state, takeover = self._begin(), self._state, self._setup.takeover
        injector = Injector(mission, self, takeover.told if takeover is not None else ())
        monitor = self.bus.monitor
        self._injector = injector
        self._ground = ground = GroundCommands(mission, self, injector, permitted=self._setup.view.commands)
        assert monitor is not None
        teller = self.bus.teller
        assert teller is not None
        with Display(mission, self._setup.voice, self.bus.hosts) as display:
            while not (why := self._end_reason(mission)):
                injector.inject_due()
                ground.carry_out_due()
                self._check_remote()
                display.show(monitor, teller, self.bus.slot_now() - 1)
                state.loop.pump(min(LOOK_EVERY_S, injector.next_in_s()))
                if state.times.publishing_at_s is None and len(self.bus.seen.heard) == len(mission.roster):
                    state.times.publishing_at_s = time.monotonic()
            state.publish_end(why)
            display.show(monitor, teller, self.bus.slot_now() + 1)

    def _begin(self) -> MissionMessage:
        """Begin the mission, or continue one that has begun."""
        takeover = self._setup.takeover
        if takeover is not None and takeover.mission is not None:
            note(f"taking over mission {self._setup.mission.name}")
            self.bus.take_over(takeover.mission, takeover.in_force, takeover.goals)
            self.bus.seen.landed |= takeover.landed
            for goal in takeover.goals:
                note(f"giving goal {goal.number} to {goal.uav} again: the operator before had no answer")
            if takeover.told is None:
                note("the recording cannot be read: faults that were due before now are not injected")
            return takeover.mission
        ahead_s = takeoff_s(self._setup.mission)
        if ahead_s:
            note(f"arming: slot 0 begins in {ahead_s:g} s, and who is not in the air by then does not fly")
        ahead_ns = min(EPOCH_AHEAD_NS + READ_NS * len(self._setup.mission.roster), MOST_AHEAD_NS)
        ahead_ns += round(ahead_s * NS_PER_S)
        mission = mission_message(self._setup.mission, self._setup.clock.now_ns() + ahead_ns)
        self.bus.publish_mission(mission)
        return mission

    def _end_reason(self, mission: MissionMessage) -> str:
        """Return the reason for the mission to end now, "" while it goes on."""
        slot, monitor, pool = self.bus.slot_now(), self.bus.monitor, self._parts.pool
        assert monitor is not None
        pauses = self._ground is not None and self._ground.pauses
        # Nobody waits for a UAV that has landed, only for its process: the record says whether it is gone for good.
        may_end = not pauses and self._remote.is_settled(self.bus.alive)
        if slot > 0 and may_end and monitor.complete(slot - 1):
            return COMPLETED
        flying = {*pool.living, *pool.to_restart, *(self._remote.expected - {RECORDER})}
        if not flying and not any(map(self._will_restart, self._setup.roster)):
            return NOBODY_LEFT
        if slot > mission.max_slots:
            return GIVEN_UP
        return STALLED if may_end and monitor.stalled(slot - 1) else ""

    def _check_remote(self) -> None:
        """Tell of a part that leaves the bus; give up one that is away for too long, and wait for it if it comes back.

        The bus sees the end of a process at once, long before its fixes are missed. That of a UAV which has landed is
        no news.
        """
        killed, landed = self._state.deaths.expected, self.bus.seen.landed
        dead = landed.union(uav for uav in killed if not self._will_restart(uav))
        for part in self._remote.left(self.bus.alive):
            if part not in killed | landed:
                self.bus.publish_event(EventKind.OFF_BUS, part)
        gone, back = self._remote.look(self.bus.alive, dead, time.monotonic())
        assert self.bus.monitor is not None
        for part in gone:
            if part == RECORDER:
                self._state.loop.failure = PartEndedError("the recorder has gone from the bus")
            self.bus.monitor.end(part)
            if part not in dead:
                self._state.report_exit(f"{part} has gone from the bus")
        for uav in back:
            self.bus.monitor.revive(uav)

    def take_uav_exit(self, news: fork_source.Exited) -> None:
        """Take in the end of a UAV process; the pool starts it again if a fault asked for that.

        Before the mission no fault asks for a death, and the start waits for every UAV: such an end fails the run.
        """
        monitor = self._state.monitor
        if monitor is None and not self._state.loop.ending:
            self._state.fail(f"UAV process {news.uav}", news.uav, news.status)
        else:
            self._state.deaths.take(news.uav, news.status)
        if monitor is not None and not self._will_restart(news.uav):
            monitor.end(news.uav)
        self._revive(news.uav, self._parts.pool.take(news))

    # --- what the fault injector needs -------------------------------------------------------

    @property
    def bus(self) -> Operator:
        """The operator's side of the bus."""
        return self._state.bus

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a UAV, the router or the recorder; a death by it is expected."""
        if number == signal.SIGKILL:
            self._state.deaths.expected.add(name)
        if name in self._setup.elsewhere and name not in self._parts.children:
            self._request(host_requests.SendSignal(uav=name, number=number))
        else:
            self._parts.signal(name, number)

    def restart(self, name: str, *, lose_memory: bool) -> None:
        """Kill a process if it is alive, and start it again once it is dead."""
        pool, expected = self._parts.pool, self._state.deaths.expected
        if name == ROUTER:
            self._parts.restart_router()
        elif name in self._setup.elsewhere:
            expected.discard(name)
            self._request(host_requests.RestartProcess(uav=name, lose_memory=lose_memory))
        else:
            if name in pool.living:
                expected.add(name)
            self._revive(name, pool.restart(name, lose_memory=lose_memory))

    def _request(self, request: host_requests.HostRequest) -> None:
        self.bus.publish_event(EventKind.HOST_REQUEST, host_requests.encode_request(request))

    def _will_restart(self, uav: str) -> bool:
        """Return True if a later fault starts the UAV again."""
        return self._injector is not None and self._injector.will_restart(uav)

    def _revive(self, uav: str, started: bool) -> None:
        monitor = self._state.monitor
        if started and monitor is not None:
            monitor.revive(uav)
