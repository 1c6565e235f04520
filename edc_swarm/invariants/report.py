"""What a check says: per guarantee held, broken (where and when), or not applicable (why)."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

Status = Literal["held", "broken", "not-applicable"]


class Violation(Struct, frozen=True):
    """One place and time at which a guarantee is broken.

    Attributes
    ----------
    kind
        What is wrong, as a short fixed word.
    text
        What is wrong, for people.
    slot
        First slot in which it is seen, -1 where slots do not apply.
    uavs
        Who is concerned.
    time_s
        Mission time, None where it is not to an instant.
    value_m
        How large it is in metres (depth of an overlap, length of a jump), None where that has no meaning.
    """

    kind: str
    text: str
    slot: int = -1
    uavs: list[str] = []
    time_s: float | None = None
    value_m: float | None = None

    def __str__(self) -> str:
        """Slot, time, what: one line."""
        slot = f"slot {self.slot}" if self.slot >= 0 else ""
        time = f"{self.time_s:.3f} s" if self.time_s is not None else ""
        return ": ".join([", ".join(filter(None, [slot, time])), self.text]).removeprefix(": ")


class GuaranteeResult(Struct, frozen=True):
    """The verdict on one guarantee; `notes` say what weakens it or why it does not apply."""

    guarantee: str
    title: str
    status: Status
    violations: list[Violation] = []
    notes: list[str] = []

    @property
    def held(self) -> bool:
        """Whether nothing is broken (also where the guarantee does not apply)."""
        return self.status != "broken"

    @property
    def where(self) -> list[str]:
        """Every violation in one line: slot, time, what."""
        return [str(violation) for violation in self.violations]


def verdict(guarantee: str, title: str, violations: list[Violation], notes: list[str] | None = None) -> GuaranteeResult:
    """Held, or broken where there are violations."""
    ordered = sorted(violations, key=lambda violation: violation.slot)
    return GuaranteeResult(guarantee, title, "broken" if ordered else "held", ordered, notes or [])


def not_applicable(guarantee: str, title: str, why: str) -> GuaranteeResult:
    """Nothing to hold the run against."""
    return GuaranteeResult(guarantee, title, "not-applicable", notes=[why])
