"""Verdicts on guarantees: held, broken, not judged, or not applicable.

"held" needs evidence: a checker that finds nothing to examine returns `not_judged`, never `verdict(..., [])`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Literal, get_args

from msgspec import Struct
from msgspec.structs import replace

from edc_swarm.foreign_text import MAX_LINE, shown

Status = Literal["held", "broken", "not-judged", "not-applicable"]


class Violation(Struct, frozen=True):
    """One place and time at which a guarantee is broken.

    Attributes
    ----------
    kind
        Short fixed word for the kind of violation.
    text
        Description for people.
    slot
        First slot of the violation, -1 if slots do not apply.
    uavs
        Ids of the UAVs concerned.
    time_s
        Mission time, None if the violation has no single instant.
    value_m
        Size in metres (depth of an overlap, length of a jump), None if that has no meaning.
    """

    kind: str
    text: str
    slot: int = -1
    uavs: list[str] = []
    time_s: float | None = None
    value_m: float | None = None

    def __str__(self) -> str:
        """Return one line with slot, time and description."""
        slot = f"slot {self.slot}" if self.slot >= 0 else ""
        time = f"{self.time_s:.3f} s" if self.time_s is not None else ""
        return ": ".join([", ".join(filter(None, [slot, time])), self.text]).removeprefix(": ")


class GuaranteeResult(Struct, frozen=True):
    """The verdict on one guarantee.

    `notes` give what weakens a verdict, the evidence that is missing (not-judged), or the reason why the guarantee
    promises nothing about this run (not-applicable). `scope` says how far a "held" reaches, where that is not all of
    the run.
    """

    guarantee: str
    title: str
    status: Status
    violations: list[Violation] = []
    notes: list[str] = []
    scope: str = ""

    @property
    def words(self) -> str:
        """The status in words, with the scope."""
        return self.status.replace("-", " ") + (f", {self.scope}" if self.scope else "")

    @property
    def held(self) -> bool:
        """True if the guarantee was judged and no violation was found."""
        return self.status == "held"

    @property
    def broken(self) -> bool:
        """True if a violation was found."""
        return self.status == "broken"

    @property
    def judged(self) -> bool:
        """True if there was enough evidence for everything that the guarantee promises about this run."""
        return self.status != "not-judged"

    @property
    def where(self) -> list[str]:
        """One line per violation, with slot, time and description."""
        return [str(violation) for violation in self.violations]

    @property
    def counted(self) -> str:
        """The number of violations in words, and how many there are of each kind, the most frequent first."""
        kinds = Counter(violation.kind for violation in self.violations)
        each = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        return f"{len(self.violations)} violations in all: {each}"


def verdict(guarantee: str, title: str, violations: list[Violation], notes: list[str] | None = None) -> GuaranteeResult:
    """Return "held", or "broken" if there are violations."""
    printable = [replace(violation, text=shown(violation.text, MAX_LINE)) for violation in violations]
    ordered = sorted(printable, key=lambda violation: violation.slot)
    return GuaranteeResult(guarantee, title, "broken" if ordered else "held", ordered, _printable(notes or []))


def not_judged(guarantee: str, title: str, why: str, notes: list[str] | None = None) -> GuaranteeResult:
    """Return "not-judged": the guarantee applies, but the evidence to judge it is missing."""
    return GuaranteeResult(guarantee, title, "not-judged", notes=_printable([why, *(notes or [])]))


def not_applicable(guarantee: str, title: str, why: str) -> GuaranteeResult:
    """Return "not-applicable": the guarantee promises nothing about this run."""
    return GuaranteeResult(guarantee, title, "not-applicable", notes=_printable([why]))


def headline(results: Sequence[GuaranteeResult]) -> str:
    """Return all verdicts in one line; "every guarantee held" only if each was judged and held.

    Where a verdict does not cover all of the run, the line says how far it reaches. G8 needs no mention in a mission
    without zones.
    """
    results = [result for result in results if (result.guarantee, result.status) != ("G8", "not-applicable")]
    names = {status: [r.guarantee for r in results if r.status == status] for status in get_args(Status)}
    scopes = "".join(f" ({r.guarantee} {r.scope})" for r in results if r.scope)
    parts = [
        f"{word}: {', '.join(names[status])}{scopes if status == 'held' else ''}"
        for status, word in (
            ("broken", "broken"),
            ("not-judged", "not judged"),
            ("held", "held"),
            ("not-applicable", "does not apply"),
        )
        if names[status]
    ]
    if not results:
        return "no guarantee was judged"
    return "every guarantee held" + scopes if len(names["held"]) == len(results) else "; ".join(parts)


def safety(results: Sequence[GuaranteeResult]) -> str:
    """Return in one line whether the UAVs were safe: apart from each other (G3) and where zones allow them (G8).

    "unknown" unless both were judged; a mission without zones needs G3 alone.
    """
    found = {result.guarantee: result for result in results}
    status = {name: found[name].status if name in found else "not-judged" for name in ("G3", "G8")}
    if "broken" in status.values():
        answer = "no"
    else:
        answer = "yes" if status["G3"] == "held" and status["G8"] in {"held", "not-applicable"} else "unknown"
    said = [f"{name} {found[name].title.lower()}: {found[name].words}" for name in status if name in found]
    return f"safe: {answer}" + (f" ({'; '.join(said)})" if said else "")


def _printable(notes: list[str]) -> list[str]:
    """Return notes with unprintable characters escaped, since keys and details may come from foreign publishers."""

    return [shown(note, MAX_LINE) for note in notes]
