"""Who operates which mission at a router, by liveliness tokens: what takes part finds it, and leaves after it."""

from __future__ import annotations

import time

import zenoh

from edc_swarm.config import OPERATOR
from edc_swarm.errors import InputError
from edc_swarm.messages import PREFIX
from processes.bus import hand_over

LINGER_S = 1.0
"""Who works for an operator leaves so long after it, so that the first to leave is the operator."""
GIVE_UP_S = 60.0
"""An operator that has been away so long does not come back."""


class Operators:
    """The operators on the bus.

    Attributes
    ----------
    absences
        How often one has gone, if only because the own link was cut.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._there: dict[str, set[str]] = {}
        self._empty_since_s: dict[str, float] = {}
        self.absences = 0
        tokens = f"{PREFIX}/*/alive/{OPERATOR}/*"
        self._subscriber = session.liveliness().declare_subscriber(tokens, hand_over(self._take), history=True)

    def missions(self) -> list[str]:
        """Missions that have an operator."""
        return [mission for mission, instances in self._there.copy().items() if instances]

    def only_mission(self, endpoint: str) -> str | None:
        """The mission to take part in at the router `endpoint`; None while there is none.

        Raises
        ------
        InputError
            There are several.
        """
        missions = self.missions()
        if len(missions) > 1:
            raise InputError("address", endpoint, f"the router of one mission, not of {', '.join(sorted(missions))}")
        return missions[0] if missions else None

    def away_s(self, mission: str) -> float:
        """For how long the mission has had no operator, 0 while it has one."""
        if self._there.get(mission):
            return 0.0
        return time.monotonic() - self._empty_since_s.setdefault(mission, time.monotonic())

    def _take(self, sample: zenoh.Sample) -> None:
        _, mission, _, _, instance = str(sample.key_expr).split("/")
        instances = self._there.setdefault(mission, set())
        if sample.kind == zenoh.SampleKind.PUT:
            instances.add(instance)
            self._empty_since_s.pop(mission, None)
        else:
            instances.discard(instance)
            self.absences += not instances
