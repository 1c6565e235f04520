"""Findings are computed from the rows: turn the data round and the sentence turns round."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from edc_swarm.figures.catalogue import FIGURES
from edc_swarm.figures.findings import Finding, finding
from edc_swarm.figures.table import Row

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


def test_overlapping_intervals_are_no_trend() -> None:
    """Without a clear difference nothing is claimed."""
    said = found("5a", {"edc": lambda x: 1 + 1e-4 * x, "paper": lambda _x: 0.0}, [10, 20])
    assert (said.reproduced, "no clear trend" in said.found[0]) == (None, True)
    assert said.verdict.startswith("undecided")
    assert "not what the paper says" not in " ".join(said.found)


def test_execution_time_must_grow_with_both_planners() -> None:
    """If one falls the claim does not hold; if one was not timed it is open."""
    rising, falling = (lambda x: 1.0 + x), (lambda x: 100.0 - x)
    assert found("6a", {"paper": rising, "edc": rising}, [10, 50]).reproduced is True
    assert found("6b", {"paper": rising, "edc": falling}, [10, 50]).reproduced is False
    assert found("6a", {"edc": rising}, [10, 50]).reproduced is None
    assert found("6b", {"edc": falling}, [10, 50]).reproduced is False


def test_questions_of_the_project_are_none_of_the_papers() -> None:
    """They have no verdict, and are not called undecided."""
    assert found("energy-head", {"edc": lambda x: x}, [10, 50]).verdict == "not from the paper"


def test_missions_that_did_not_end_are_said() -> None:
    """No incomplete mission passes in silence."""
    lines = {"edc": lambda x: x, "paper": lambda _x: 0.0}
    said = finding("5a", "", rows("5a", lines, [10, 20], incomplete=2))
    assert "4 of 60 missions of edc did not bring every UAV home." in said.found


def test_energy_is_saved_only_where_it_shows() -> None:
    """A mean below zero whose interval holds zero saves nothing."""
    lines = {"energy": lambda x: 1 - x / 10, "distance": lambda _x: 1.0, "time": lambda _x: 1.0}
    said = found("energy-minimise", lines, [9.98, 10, 10.05, 20, 40]).found
    assert "saves energy at 2 of 5 points, and costs some at 0." in said[-1]
