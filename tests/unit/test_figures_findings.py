"""Findings are computed from the rows: turn the data round and the sentence turns round."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from edc_swarm.figures.catalogue import FIGURES
from edc_swarm.figures.findings import Finding, finding, grows, trend
from edc_swarm.figures.table import Row, line

CLAIMS = {figure.name: figure.claim for figure in FIGURES}


def rows(figure: str, lines: dict[str, Callable[[float], float]], xs: list[float], incomplete: int = 0) -> list[Row]:
    """Rows of exact values with narrow intervals."""
    return [
        Row(figure, name, "x", x, "y", 30, y(x), y(x) - 0.01, y(x) + 0.01, y(x), y(x), incomplete)
        for name, y in lines.items()
        for x in xs
    ]


def found(figure: str, lines: dict[str, Callable[[float], float]], xs: list[float]) -> Finding:
    """The finding on such rows."""
    return finding(figure, CLAIMS[figure], rows(figure, lines, xs))


@pytest.mark.parametrize(
    ("figure", "power", "reproduced"),
    [
        ("4a", 2.0, True),
        ("4a", 1.0, False),
        ("4b", -2.0, True),
        ("4b", -0.5, False),
        ("4c", 1.0, True),
        ("4c", 2.0, False),
    ],
)
def test_collisions_are_judged_by_the_fitted_exponent(figure: str, power: float, reproduced: bool) -> None:
    """The verdict follows the exponent, and the exponent is said."""
    lines = {"straight": lambda x: 7 * x**power, "paper": lambda x: 6 * x**power, "edc": lambda _x: 0.0}
    said = found(figure, lines, [10, 20, 40])
    assert said.reproduced is reproduced
    assert f"{power:.2f}" in said.found[0]
    assert any("With edc no pair overlapped in any of its 90 missions" in text for text in said.found)


@pytest.mark.parametrize("figure", ["4a", "4b", "4c"])
def test_without_collisions_there_is_nothing_to_fit(figure: str) -> None:
    """That is no reproduction."""
    said = found(figure, {"straight": lambda _x: 0.0, "paper": lambda _x: 0.0, "edc": lambda _x: 0.0}, [10, 20])
    assert (said.verdict, said.found[0]) == ("not reproduced", "Too few collisions for a fit.")


@pytest.mark.parametrize("power", [-2.0, -0.5])
def test_why_the_area_does_not_count_twice(power: float) -> None:
    """Is said where it does not; an exponent of two points has no interval."""
    said = found("4b", {"straight": lambda x: 7e4 * x**power}, [10, 20])
    assert said.verdict == ("reproduced" if power == -2.0 else "not reproduced")
    assert ("no quadratic function" in " ".join(said.found)) is (power != -2.0)
    assert said.found[0].endswith(f"to the power of {power:.2f}.")
    assert Finding("", None, []).verdict == "not from the paper"


def test_a_line_may_grow_by_its_fit_alone() -> None:
    """Its ends are not clearly apart, but all its points are on a rising line."""
    points = [Row("6a", "edc", "s", x, "y", 30, 1e-4 * x, 1e-4 * x - 1, 1e-4 * x + 1, 0, 0, 0) for x in (1, 2, 3, 4)]
    rising = line(points, "edc")
    assert rising is not None
    assert (trend(rising), grows(rising)) == (0, True)


def test_collisions_of_edc_are_not_hidden() -> None:
    """One overlapping pair in one mission is said."""
    lines = {"straight": lambda x: x**2, "paper": lambda x: x**2, "edc": lambda x: float(x == 40)}
    assert any("With edc up to 1 pairs overlapped" in text for text in found("4a", lines, [10, 20, 40]).found)


@pytest.mark.parametrize(
    ("figure", "slope", "reproduced"), [("5a", -1, True), ("5a", 1, False), ("5b", 1, True), ("5b", -1, False)]
)
def test_extra_distance_is_judged_by_its_trend(figure: str, slope: int, reproduced: bool) -> None:
    """Falling with number, rising with area is what the paper says."""
    said = found(figure, {"edc": lambda x: 100 + slope * x, "paper": lambda _x: 0.0}, [10, 20, 40])
    assert said.reproduced is reproduced
    assert ("not what the paper says" in " ".join(said.found)) is not reproduced
    assert f"the extra distance {'rises' if slope > 0 else 'falls'}, from" in said.found[0]


def test_overlapping_intervals_are_no_trend() -> None:
    """Without a clear difference nothing is claimed."""
    said = found("5a", {"edc": lambda x: 1 + 1e-4 * x, "paper": lambda _x: 0.0}, [10, 20])
    assert (said.reproduced, "no clear trend" in said.found[0]) == (False, True)


def test_execution_time_must_grow_with_both_planners() -> None:
    """If one falls the claim does not hold."""
    rising, falling = (lambda x: 1.0 + x), (lambda x: 100.0 - x)
    assert found("6a", {"paper": rising, "edc": rising}, [10, 50]).reproduced is True
    assert found("6b", {"paper": rising, "edc": falling}, [10, 50]).reproduced is False


def test_missions_that_did_not_end_are_said() -> None:
    """No incomplete mission passes in silence."""
    lines = {"edc": lambda x: x, "paper": lambda _x: 0.0}
    said = finding("5a", "", rows("5a", lines, [10, 20], incomplete=2))
    assert "4 of 60 missions of edc did not bring every UAV home." in said.found
