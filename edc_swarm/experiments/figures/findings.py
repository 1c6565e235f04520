"""Findings: sentences computed from the rows of a figure, compared with the paper's claims.

A verdict is about a trend. Its evidence is a fitted exponent with its 95 % interval, and the overlap of the
intervals of a line's end points. With too few runs it is undecided. Each finding gives the reason if a claim does
not reproduce.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec import Struct

from edc_swarm.experiments.figures.table import Line, Row, line
from edc_swarm.experiments.statistics import PowerLaw, power_law

TOLERANCE = 0.5
"""Greatest distance between a fitted exponent and the integer that it supports."""
ZERO = 1e-3
"""Extra distance that counts as none, in metres per UAV."""
OWN = frozenset({"energy-head", "energy-minimise"})
"""Figures of the project's own, without a claim in the paper."""

VACUOUS = (
    "the convexified constraints (eq. 37-43) bound the dotted variables only on the side on which they are free to "
    "grow, so they exclude nothing and the optimum is the straight line"
)


class FigureFinding(Struct, frozen=True):
    """The paper's claim, True if the data reproduce it (None: undecided), and the result in sentences."""

    claim: str
    reproduced: bool | None
    found: list[str]
    from_paper: bool = True

    @property
    def verdict(self) -> str:
        """The verdict in words."""
        if not self.from_paper:
            return "not from the paper"
        return {True: "reproduced", False: "not reproduced", None: "undecided, with so few runs"}[self.reproduced]


def finding(figure: str, claim: str, rows: Sequence[Row]) -> FigureFinding:
    """Return the finding that the rows of `figure` support."""
    reproduced, found = _FINDERS[figure](rows)
    return FigureFinding(claim, reproduced, [*found, *_unfinished(rows)], figure not in OWN)


Found = tuple[bool | None, list[str]]


def _law(rows: Sequence[Row], series: str) -> PowerLaw | None:
    points = line(rows, series)
    return power_law(points.x, points.mean) if points is not None else None


def _exponent(law: PowerLaw) -> str:
    """Return for example "2.02 (95 %: 1.97 to 2.07)"."""
    if law.low is None or law.high is None:
        return f"{law.exponent:.2f}"
    return f"{law.exponent:.2f} (95 %: {law.low:.2f} to {law.high:.2f})"


def _near(law: PowerLaw, expected: float) -> bool:
    return abs(law.exponent - expected) <= TOLERANCE


def _expected(power: int) -> str:
    return f"; the paper says {power}, and within {TOLERANCE} of it counts."


def trend(points: Line) -> int:
    """Return 1 if a line rises, -1 if it falls, 0 if the confidence intervals of its ends overlap."""
    if points.low[-1] > points.high[0]:
        return 1
    return -1 if points.high[-1] < points.low[0] else 0


def grows(points: Line) -> bool | None:
    """Return True if a line rises, by its ends or else by its fitted exponent; False if it falls; None if unclear."""
    if ends := trend(points):
        return ends == 1
    law = power_law(points.x, points.mean)
    if law is None or law.low is None or law.high is None or law.low <= 0 <= law.high:
        return None
    return law.low > 0


def _trend_words(points: Line) -> str:
    return {1: "rises", -1: "falls", 0: "shows no clear trend"}[trend(points)]


def _from_to(points: Line, digits: int = 1) -> str:
    return f"from {points.mean[0]:.{digits}f} to {points.mean[-1]:.{digits}f}"


def _avoidance(rows: Sequence[Row]) -> list[str]:
    """Return sentences on the two planners that are meant to avoid collisions."""
    said = []
    straight, paper, edc = (line(rows, name) for name in ("straight", "paper", "edc"))
    if paper and straight:
        said.append(
            f"The paper's planner avoids nothing: at the last point {paper.mean[-1]:.1f} pairs overlap, with avoidance"
            f" off {straight.mean[-1]:.1f}, since {VACUOUS} (flown more slowly, all arriving at once)."
        )
    if edc:
        pairs = "no pair" if edc.largest == 0 else f"up to {edc.largest:.0f} pairs"
        said.append(f"With edc {pairs} overlapped in any of its {edc.runs} missions.")
    return said


def _by_number(rows: Sequence[Row]) -> Found:
    law = _law(rows, "straight")
    if law is None:
        return None, ["Too few collisions for a fit."]
    return _near(law, 2), [
        f"Without avoidance collisions grow as the number of UAVs to the power of {_exponent(law)}{_expected(2)}",
        *_avoidance(rows),
    ]


def _by_area(rows: Sequence[Row]) -> Found:
    law = _law(rows, "straight")
    if law is None:
        return None, ["Too few collisions for a fit."]
    reproduced = _near(law, -2)
    said = [f"Without avoidance collisions change as the area to the power of {_exponent(law)}{_expected(-2)}"]
    if not reproduced:
        said.append(
            f"With the density changed by the area they are no quadratic function of it (power {-law.exponent:.2f}):"
            " a pair on straight ways meets with a probability that falls as way length x radius / area, and ways"
            " grow as the square root of the area. Only the number of UAVs enters quadratically (Fig. 4a)."
        )
    return reproduced, said + _avoidance(rows)


def _by_radius(rows: Sequence[Row]) -> Found:
    law = _law(rows, "straight")
    if law is None:
        return None, ["Too few collisions for a fit."]
    return _near(law, 1), [
        f"Without avoidance collisions grow as the GPS error to the power of {_exponent(law)}{_expected(1)}",
        *_avoidance(rows),
    ]


def _extra(expected: int, reason: str) -> Callable[[Sequence[Row]], Found]:
    """Return the judge of the extra distance, which by the paper falls (-1) or rises (1) along the axis."""

    def found(rows: Sequence[Row]) -> Found:
        edc, paper = line(rows, "edc"), line(rows, "paper")
        if edc is None or paper is None:
            return None, []
        said = [f"With edc the extra distance {_trend_words(edc)}, {_from_to(edc)} m per UAV."]
        reproduced = {expected: True, -expected: False}.get(trend(edc))
        if reproduced is False:
            said.append(f"That is not what the paper says: {reason}.")
        nothing = max(map(abs, paper.mean)) < ZERO
        said.append(
            f"The paper's planner flies no extra distance at any point, since {VACUOUS}."
            if nothing
            else f"The paper's planner flies {_from_to(paper, 3)} m more per UAV."
        )
        return reproduced, said

    return found


def _times(reason: str) -> Callable[[Sequence[Row]], Found]:
    """Return the judge of the execution time, which by the paper grows; `reason` explains why that of edc may not."""

    def found(rows: Sequence[Row]) -> Found:
        said, growing = [], dict[str, bool | None]()
        for name, words in (
            ("paper", "One solution of the paper's model as printed takes"),
            ("edc", "Planning all slots of a mission with edc takes"),
        ):
            points = line(rows, name)
            law = _law(rows, name)
            if points is None or law is None:
                growing[name] = None
                said.append(f"{words}: not timed here (--runs 30 or more does).")
                continue
            growing[name] = grows(points)
            ends = f"from x = {points.x[0]:g} to {points.x[-1]:g}"
            said.append(f"{words} {_from_to(points, 2)} s {ends}, as the power {_exponent(law)}.")
        slot = line(rows, "edc-slot")
        if slot is not None:
            said.append(
                f"The longest slot of a mission takes edc {1e3 * max(slot.mean):.0f} ms in the mean at its worst point"
                f" and {1e3 * slot.largest:.0f} ms in the worst mission, of the 500 ms that a slot has."
            )
        if growing["edc"] is False and reason:
            said.append(reason)
        return False if False in growing.values() else True if all(growing.values()) else None, said

    return found


def _energy_plan(rows: Sequence[Row]) -> Found:
    bound, paper, edc = (line(rows, name) for name in ("bound", "paper", "edc"))
    if bound is None or edc is None or paper is None:
        return None, []
    above = [100 * (e / b - 1) for e, b in zip(edc.mean, bound.mean, strict=True)]
    slower = [100 * (p / b - 1) for p, b in zip(paper.mean, bound.mean, strict=True)]
    return grows(edc), [
        f"edc spends {above[0]:.0f} % more than the straight lines at full speed would with {edc.x[0]:g} UAVs and"
        f" {above[-1]:.0f} % more with {edc.x[-1]:g}: avoiding costs waiting and detours, and both cost energy.",
        f"The paper's planner, which flies no metre too many, still spends {min(slower):.0f} to {max(slower):.0f} %"
        " more: all its UAVs arrive together, so most fly slowly, and slow flight costs more per metre.",
    ]


def _energy_head(rows: Sequence[Row]) -> Found:
    edc = line(rows, "edc")
    if edc is None:
        return None, []
    return None, [
        f"At 5 W of processor power the computing of the head costs {_from_to(edc, 2)} J per mission:"
        " beside the propulsion of a single UAV, some 140 J in every second, that is next to nothing."
    ]


def _energy_minimise(rows: Sequence[Row]) -> Found:
    energy, distance, time = (line(rows, name) for name in ("energy", "distance", "time"))
    if energy is None or distance is None or time is None:
        return None, []
    saves, costs = sum(high < 0 for high in energy.high), sum(low > 0 for low in energy.low)
    return None, [
        f'minimise = "energy" changes propulsion energy by {_changes(energy)}, distance by {_changes(distance)} and the'
        f" time until all have arrived by {_changes(time)}.",
        "A rotary wing spends more on hovering than on cruising at 5 m/s, so the weights for least energy are those for"
        " least time: UAVs go round each other rather than wait.",
        f"Beyond the interval of its runs it saves energy at {saves} of {len(energy.x)} points, and costs some at"
        f" {costs}.",
    ]


def _changes(points: Line) -> str:
    """Return for example "-2.4 % (x = 10) to 1.4 % (x = 50), -1.2 % in the mean"."""
    mean = sum(points.mean) / len(points.mean)
    ends = [f"{points.mean[end]:+.1f} % (x = {points.x[end]:g})" for end in (0, -1)]
    return f"{ends[0]} to {ends[1]}, {mean:+.1f} % in the mean"


def _unfinished(rows: Sequence[Row]) -> list[str]:
    """Return a sentence for each line with missions that did not bring every UAV home."""
    said = []
    for series in dict.fromkeys(row.series for row in rows):
        points = line(rows, series)
        if points is not None and points.incomplete:
            said.append(f"{points.incomplete} of {points.runs} missions of {series} did not bring every UAV home.")
    return said


_FINDERS: dict[str, Callable[[Sequence[Row]], Found]] = {
    "4a": _by_number,
    "4b": _by_area,
    "4c": _by_radius,
    "5a": _extra(
        -1,
        "more UAVs have more conflicts to resolve, and each costs a detour; only a planner that avoids nothing is"
        " spared them",
    ),
    "5b": _extra(
        1,
        "a wider area has room, so fewer ways cross closely; ways get longer, but detours come from conflicts, not"
        " from length",
    ),
    "6a": _times(""),
    "6b": _times(
        "edc plans slot by slot: more room means fewer conflicts in each, which outweighs that there are more slots to"
        " fly; the paper's model has one long horizon, and that grows with the ways."
    ),
    "energy-plan": _energy_plan,
    "energy-head": _energy_head,
    "energy-minimise": _energy_minimise,
}
