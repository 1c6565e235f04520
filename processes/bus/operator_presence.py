"""Who operates which mission at a router, by liveliness tokens: what takes part finds it, and leaves after it."""

from __future__ import annotations

import time

import zenoh

from edc_swarm.errors import InputError, SwarmError
from edc_swarm.mission.configuration import OPERATOR
from edc_swarm.protocol.keys import PREFIX
from processes.bus.session import hand_over

LINGER_S = 1.0
"""Who works for an operator leaves so long after it, so that the first to leave is the operator."""
OPERATOR_LOST_S = 60.0
"""An operator that has been away so long does not come back."""
MAX_OPERATORS = 1000
"""Operators that are remembered: a flood of tokens fills no memory."""
MOST_NAMED = 10
GAVE_UP = f"{PREFIX}/-/alive/gave-up"
"""Token of a router whose operator has ended before it had a mission, or has not come."""


class Operators:
    """The operators on the bus.

    Attributes
    ----------
    absences
        How often one has gone, if only because the own link was cut.
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
        """Missions that have an operator."""
        return sorted({mission for mission, _ in self._there.copy()})

    def only_mission(self, endpoint: str) -> str | None:
        """The mission to take part in at the router `endpoint`; None while there is none.

        Raises
        ------
        InputError
            There are several.
        SwarmError
            There will be none: the operator has ended, or has not come.
        """
        if self._gave_up:
            raise SwarmError(f"there is no mission at {endpoint}: its operator has ended without one, or has not come")
        missions = self.missions()
        if len(missions) > 1:
            named = ", ".join(missions[:MOST_NAMED])
            raise InputError("address", endpoint, f"the router of one mission, not of {named}")
        return missions[0] if missions else None

    def check_there(self, mission: str) -> None:
        """Raise `SwarmError` when the operator has been away for too long."""
        if self.away_s(mission) > OPERATOR_LOST_S:
            raise SwarmError(f"the operator of mission {mission} has been away for {OPERATOR_LOST_S:g} s")

    def away_s(self, mission: str) -> float:
        """For how long the mission has had no operator, 0 while it has one."""
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
