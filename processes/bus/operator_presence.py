"""Presence of operators at a router, by liveliness tokens. A part finds its mission by it, and leaves after it."""

from __future__ import annotations

import time

import zenoh

from edc_swarm.errors import InputError, SwarmError
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.keys import PREFIX
from processes.bus.session import hand_over
from processes.runtime.console import MAX_NAMES

LINGER_S = 1.0
"""Time that a part stays after its operator has left, so that the operator is the first to leave."""
OPERATOR_LOST_S = 60.0
"""Longest absence of an operator after which it may still come back."""
MAX_OPERATORS = 1000
"""Most operators that are remembered: a flood of tokens fills no memory."""
GAVE_UP = f"{PREFIX}/-/alive/gave-up"
"""Token of a router without a mission: its operator has ended without one, or has not come."""


class OperatorPresence:
    """The operators on the bus, by mission.

    Attributes
    ----------
    absences
        Number of times that a mission lost its operator, cuts of the own link included.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._there: set[tuple[str, str]] = set()
        self._empty_since_s: dict[str, float] = {}
        self._gave_up = False
        self.absences = 0
        tokens = f"{PREFIX}/*/alive/{OPERATOR}/*"
        self._subscriber = session.liveliness().declare_subscriber(tokens, hand_over(self._take), history=True)
        self._notice = session.liveliness().declare_subscriber(GAVE_UP, hand_over(self._take_notice), history=True)

    def missions(self) -> list[str]:
        """Return the missions that have an operator."""
        return sorted({mission for mission, _ in self._there.copy()})

    def only_mission(self, endpoint: str) -> str | None:
        """Return the one mission at the router `endpoint`, None while there is no mission.

        Raises
        ------
        InputError
            There are several missions.
        SwarmError
            There will be no mission: the operator has ended without one, or has not come.
        """
        if self._gave_up:
            raise SwarmError(f"there is no mission at {endpoint}: its operator has ended without one, or has not come")
        missions = self.missions()
        if len(missions) > 1:
            named = ", ".join(missions[:MAX_NAMES])
            raise InputError("address", endpoint, f"the router of one mission, not of {named}")
        return missions[0] if missions else None

    def check_there(self, mission: str) -> None:
        """Raise `SwarmError` if the operator has been away for more than `OPERATOR_LOST_S`."""
        if self.is_lost(mission):
            raise SwarmError(f"the operator of mission {mission} has been away for {OPERATOR_LOST_S:g} s")

    def is_lost(self, mission: str) -> bool:
        """Return True if the operator has been away for so long that it comes back no more."""
        return self.away_s(mission) > OPERATOR_LOST_S

    def away_s(self, mission: str) -> float:
        """Return the seconds for which the mission has been without an operator, 0 while it has one."""
        if mission in self.missions():
            return 0.0
        return time.monotonic() - self._empty_since_s.setdefault(mission, time.monotonic())

    def _take(self, sample: zenoh.Sample) -> None:
        _, mission, _, _, instance = str(sample.key_expr).split("/")
        if sample.kind == zenoh.SampleKind.PUT:
            self._come(mission, instance)
        elif (mission, instance) in self._there:
            self._there.discard((mission, instance))
            self.absences += mission not in self.missions()

    def _come(self, mission: str, instance: str) -> None:
        if len(self._there) < MAX_OPERATORS:
            self._there.add((mission, instance))
            self._empty_since_s.pop(mission, None)

    def _take_notice(self, sample: zenoh.Sample) -> None:
        self._gave_up |= sample.kind == zenoh.SampleKind.PUT
