"""Happenings, the entries of a story, with the states of a UAV that follow from them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, get_args

from msgspec import Struct

Kind = Literal[
    "take-off",
    "claim",
    "term",
    "no-head",
    "arrived",
    "left-target",
    "overlap",
    "collision",
    "goal",
    "fault",
    "dead",
    "frozen",
    "silent",
    "cut-off",
    "back",
    "battery-low",
    "battery-empty",
    "holding",
    "landed",
    "overload",
    "unknown",
    "notice",
    "end",
]
"""Kind of a happening: `docs/metrics.md` has the evidence that each needs."""

Reason = Literal["", "no-command", "not-flown", "blocked", "covered", "waiting", "no-step", "unknown"]
"""Reason of a UAV that holds away from its target; "" for every other kind."""

Level = Literal["detail", "news", "warning"]

State = Literal[
    "unknown",
    "flying",
    "holding",
    "arrived",
    "beside",
    "silent",
    "dead",
    "frozen",
    "cut-off",
    "landed",
]
"""State of a UAV in a slot."""
STATES: tuple[State, ...] = get_args(State)

NAMES_TOLD = 6
"""Most UAVs that one line names."""


class Happening(Struct, kw_only=True):
    """One entry of a story.

    Attributes
    ----------
    slot, time_s
        Slot in which it begins, and mission time.
    uavs
        UAVs that it happens to, in roster order.
    detail
        What is known of it, in words that need no subject.
    reason, by
        Why a UAV holds, and the UAV that is in its way, "" if there is none.
    last_slot
        Last slot of what lasts, once it is over; None for a moment, and for what lasts on.
    lasts
        True for what takes time: it has a last slot, or is not over.
    """

    kind: Kind
    slot: int
    time_s: float
    uavs: list[str] = []
    detail: str = ""
    level: Level = "news"
    reason: Reason = ""
    by: str = ""
    last_slot: int | None = None
    lasts: bool = False

    @property
    def who(self) -> str:
        """The UAVs in words, the first ones by name."""
        more = f" and {len(self.uavs) - NAMES_TOLD} more" if len(self.uavs) > NAMES_TOLD else ""
        return ", ".join(self.uavs[:NAMES_TOLD]) + more

    @property
    def words(self) -> str:
        """UAVs, detail and end in one line. The end of a death is told on its own: the UAV is back, or has landed."""
        until = f" (until slot {self.last_slot})" if self.last_slot is not None and self.kind != "dead" else ""
        return (": ".join(part for part in (self.who, self.detail) if part) or self.kind) + until

    def __str__(self) -> str:
        """Return one line: time, kind, UAVs, detail."""
        return f"{self.time_s:7.1f} s  {self.kind:<13} {self.words}"


def grouped(happenings: Iterable[Happening], order: Sequence[str]) -> list[Happening]:
    """Return the happenings; those of one slot that differ in their UAVs alone are one, with the time of the last.

    `order` is the roster's.
    """
    rank = {uav: k for k, uav in enumerate(order)}
    groups: dict[tuple[object, ...], Happening] = {}
    for each in happenings:
        same = (each.kind, each.slot, each.detail, each.level, each.last_slot, each.lasts)
        if each.uavs and same in groups:
            groups[same].uavs.extend(each.uavs)
            groups[same].time_s = max(groups[same].time_s, each.time_s)
        else:
            groups[same if each.uavs else (*same, len(groups))] = Happening(
                **{field: getattr(each, field) for field in each.__struct_fields__ if field != "uavs"},
                uavs=[*each.uavs],
            )
    for group in groups.values():
        group.uavs.sort(key=lambda uav: rank.get(uav, len(rank)))
    return list(groups.values())
