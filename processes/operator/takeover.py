"""Takeover of a mission whose operator has died, by the next operator with the same mission.

Its claimants, UAVs, recorder and visualiser are still on the bus. The recorder has received the mission message
and keeps its own orders, so it answers queries for both.
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import msgspec
import zenoh

from edc_swarm.emulation.links import MAX_CHANGES
from edc_swarm.errors import RecordingError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roles import OPERATOR, RECORDER
from edc_swarm.protocol.codec import decode
from edc_swarm.protocol.goals import PendingGoals
from edc_swarm.protocol.keys import ALL_ALIVE, Keys
from edc_swarm.protocol.messages import Event, Goal, MissionMessage
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from processes.operator.bus_client import ENDS_OF_FLIGHT, is_in_force
from processes.operator.fault_injector import TOLD_OF_FAULTS
from processes.services.orders import ASK_TIMEOUT_S, asked
from processes.services.recorder_settings import RecorderSettings


@dataclass(frozen=True, slots=True)
class Takeover:
    """A mission without operator.

    Attributes
    ----------
    mission_id
        Id of the run.
    mission
        The mission message if the mission has begun.
    recorder
        Orders of the recorder.
    told
        Events of faults and of their ends that the operator before has published; None if the record of a mission that
        has begun cannot be read.
    goals
        Goals of the operator that has died which no UAV has answered, as far as the recorder has written.
    landed
        UAVs that have said that they have landed, or that their battery is empty: their processes have ended.
    """

    mission_id: str
    mission: MissionMessage | None = None
    recorder: RecorderSettings | None = None
    told: Sequence[Event] | None = ()
    goals: Sequence[Goal] = ()
    landed: frozenset[str] = frozenset()

    @property
    def in_force(self) -> list[Event]:
        """The faults that a UAV which starts late must receive."""
        return [event for event in self.told or () if is_in_force(event)][-MAX_CHANGES:]


def new_mission_id(mission: Mission) -> str:
    """Return an id that no other run has."""
    return f"{_stem(mission)}-{secrets.token_hex(4)}"


def find_takeover(session: zenoh.Session, mission: Mission) -> Takeover | None:
    """Return the run of this very mission that is on the bus without an operator, if there is one."""
    tokens = _tokens(session)
    runs = {run for run, _ in tokens if run.startswith(f"{_stem(mission)}-")}
    orphans = sorted(runs - {run for run, who in tokens if who == OPERATOR})
    return _takeover(session, orphans[0]) if orphans else None


def _stem(mission: Mission) -> str:
    """Return name and digest of a mission: an operator takes over only the same mission, to the last field."""
    digest = hashlib.blake2s(msgspec.json.encode(mission), digest_size=4).hexdigest()
    return f"{mission.name[:45]}-{digest}"


def _tokens(session: zenoh.Session) -> set[tuple[str, str]]:
    """Return mission and id of every liveliness token."""
    replies = session.liveliness().get(ALL_ALIVE, timeout=ASK_TIMEOUT_S)
    keys = [str(reply.ok.key_expr).split("/") for reply in replies if reply.ok is not None]
    return {(parts[1], parts[3]) for parts in keys if len(parts) == 5}


def _takeover(session: zenoh.Session, run: str) -> Takeover:
    keys = Keys(run)
    said, orders = asked(session, keys.mission), asked(session, keys.orders(RECORDER))
    recorder = msgspec.json.decode(orders, type=RecorderSettings) if orders is not None else None
    mission = cast("MissionMessage", decode(keys.mission, said)) if said is not None else None
    if mission is None:
        return Takeover(run, recorder=recorder)
    recording = _recorded(recorder.part) if recorder is not None else None
    if recording is None:
        return Takeover(run, mission, recorder, told=None)
    return Takeover(run, mission, recorder, _told(recording), unanswered_goals(recording), landed(recording))


def _recorded(part: str) -> Recording | None:
    """Return what the recorder has written so far, None if that cannot be read."""
    try:
        return read_recording(part, salvage=True)
    except RecordingError:
        return None


def _told(recording: Recording) -> list[Event]:
    """Return what the operator has said of faults, by time."""
    return [event for event in recording.events if event.source == OPERATOR and event.kind in TOLD_OF_FAULTS]


def landed(recording: Recording) -> frozenset[str]:
    """Return the UAVs that, by the record, fly no more and have ended by themselves."""
    return frozenset(event.source for event in recording.events if event.kind in ENDS_OF_FLIGHT)


def unanswered_goals(recording: Recording) -> list[Goal]:
    """Return the operator's goals that, by the record, no UAV has accepted or refused, and no operator has given up."""
    pending = PendingGoals(recording.mission)
    for goal in recording.goals:
        if goal.source == OPERATOR:
            pending.resume(goal, 0)
    for fix in recording.fixes:
        pending.hear_fix(fix)
    for event in recording.events:
        pending.hear_event(event)
    return pending.unanswered
