"""The list of happenings, as it grows."""

from __future__ import annotations

from collections.abc import Sequence

from edc_swarm.story.happening import Happening, Kind, Level, Reason

MAX_HAPPENINGS = 50_000
"""Most happenings that are kept; `left_out` counts the others."""


class Log:
    """The happenings of a mission, and those of the slot that is told now."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s
        self.happenings: list[Happening] = []
        self.told: list[Happening] = []
        self.left_out = 0
        self.slot = 0

    def begin(self, slot: int) -> None:
        """Begin to tell a slot."""
        self.slot, self.told = slot, []

    def tell(
        self,
        kind: Kind,
        uavs: Sequence[str] = (),
        detail: str = "",
        *,
        level: Level = "news",
        slot: int | None = None,
        time_s: float | None = None,
        lasts: bool = False,
        reason: Reason = "",
        by: str = "",
    ) -> Happening:
        """Add a happening of this slot, or of an earlier `slot`."""
        begun = self.slot if slot is None else slot
        made = Happening(
            kind=kind,
            slot=begun,
            time_s=begun * self._dt_s if time_s is None else time_s,
            uavs=list(uavs),
            detail=detail,
            level=level,
            lasts=lasts,
            reason=reason,
            by=by,
        )
        if len(self.happenings) < MAX_HAPPENINGS:
            self.happenings.append(made)
        else:
            self.left_out += 1
        self.told.append(made)
        return made

    def tell_again(self, happening: Happening) -> None:
        """Tell a happening once more in this slot, since it has become news."""
        self.told.append(happening)
