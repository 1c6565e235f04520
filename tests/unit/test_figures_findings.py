"""Findings follow from the rows: reversed data give the opposite sentence."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from edc_swarm.experiments.figures.catalogue import FIGURES
from edc_swarm.experiments.figures.findings import FigureFinding, finding, grows, trend
from edc_swarm.experiments.figures.table import Row, line, rows_of

CLAIMS = {figure.name: figure.claim for figure in FIGURES}


def rows(figure: str, lines: dict[str, Callable[[float], float]], xs: list[float], incomplete: int = 0) -> list[Row]:
    """Return rows of exact values with narrow intervals."""
    return [
        Row(figure, name, "x", x, "y", 30, y(x), y(x) - 0.01, y(x) + 0.01, y(x), y(x), incomplete)
        for name, y in lines.items()
        for x in xs
    ]


def found(figure: str, lines: dict[str, Callable[[float], float]], xs: list[float]) -> FigureFinding:
    """Return the finding on such rows."""
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
    """The verdict follows the exponent, which the sentence gives."""
    lines = {"straight": lambda x: 7 * x**power, "paper": lambda x: 6 * x**power, "edc": lambda _x: 0.0}
    said = found(figure, lines, [10, 20, 40])
    assert said.reproduced is reproduced
    assert f"{power:.2f}" in said.found[0]
    assert any("With edc no pair overlapped in any of its 90 missions" in text for text in said.found)


@pytest.mark.parametrize("figure", ["4a", "4b", "4c"])
def test_without_collisions_there_is_nothing_to_fit(figure: str) -> None:
    """Without collisions the finding is undecided."""
    said = found(figure, {"straight": lambda _x: 0.0, "paper": lambda _x: 0.0, "edc": lambda _x: 0.0}, [10, 20])
    assert (said.verdict, said.found[0]) == ("undecided, with so few runs", "Too few collisions for a fit.")


@pytest.mark.parametrize("power", [-2.0, -0.5])
def test_why_the_area_does_not_count_twice(power: float) -> None:
    """The reason is given if the exponent differs; an exponent of two points has no interval."""
    said = found("4b", {"straight": lambda x: 7e4 * x**power}, [10, 20])
    assert said.verdict == ("reproduced" if power == -2.0 else "not reproduced")
    assert ("no quadratic function" in " ".join(said.found)) is (power != -2.0)
    assert f"to the power of {power:.2f};" in said.found[0]


def test_a_line_may_grow_by_its_fit_alone() -> None:
    """The intervals of the ends overlap, but all points are on a rising line."""
    points = [Row("6a", "edc", "s", x, "y", 30, 1e-4 * x, 1e-4 * x - 1, 1e-4 * x + 1, 0, 0, 0) for x in (1, 2, 3, 4)]
    rising = line(points, "edc")
    assert rising is not None
    assert (trend(rising), grows(rising)) == (0, True)


def test_collisions_of_edc_are_not_hidden() -> None:
    """The finding reports one overlapping pair in one mission."""
    lines = {"straight": lambda x: x**2, "paper": lambda x: x**2, "edc": lambda x: float(x == 40)}
    assert any("With edc up to 1 pairs overlapped" in text for text in found("4a", lines, [10, 20, 40]).found)


@pytest.mark.parametrize(
    ("figure", "slope", "reproduced"), [("5a", -1, True), ("5a", 1, False), ("5b", 1, True), ("5b", -1, False)]
)
def test_extra_distance_is_judged_by_its_trend(figure: str, slope: int, reproduced: bool) -> None:
    """By the paper it falls with the number of UAVs and rises with the area."""
    said = found(figure, {"edc": lambda x: 100 + slope * x, "paper": lambda _x: 0.0}, [10, 20, 40])
    assert said.reproduced is reproduced
    assert ("not what the paper says" in " ".join(said.found)) is not reproduced
    assert f"the extra distance {'rises' if slope > 0 else 'falls'}, from" in said.found[0]


def test_overlapping_intervals_are_no_trend() -> None:
    """Without a clear difference the finding claims nothing."""
    said = found("5a", {"edc": lambda x: 1 + 1e-4 * x, "paper": lambda _x: 0.0}, [10, 20])
    assert (said.reproduced, "no clear trend" in said.found[0]) == (None, True)
    assert said.verdict.startswith("undecided")
    assert "not what the paper says" not in " ".join(said.found)


def test_execution_time_must_grow_with_both_planners() -> None:
    """If one falls the claim is refuted; if one was not timed it is undecided."""
    rising, falling = (lambda x: 1.0 + x), (lambda x: 100.0 - x)
    assert found("6a", {"paper": rising, "edc": rising}, [10, 50]).reproduced is True
    assert found("6b", {"paper": rising, "edc": falling}, [10, 50]).reproduced is False
    assert found("6a", {"edc": rising}, [10, 50]).reproduced is None
    assert found("6b", {"edc": falling}, [10, 50]).reproduced is False


def test_questions_of_the_project_are_none_of_the_papers() -> None:
    """The project's own questions have no verdict, and are not called undecided."""
    assert found("energy-head", {"edc": lambda x: x}, [10, 50]).verdict == "not from the paper"


def test_why_times_do_not_grow_is_said() -> None:
    """The finding gives a known reason, names a line that was not timed, and gives the longest slot."""
    rising, falling, slot = (lambda x: 1.0 + x), (lambda x: 100.0 - x), (lambda x: 0.002 * x)
    reason = "edc plans slot by slot"
    said = found("6b", {"paper": rising, "edc": falling, "edc-slot": slot}, [10, 50])
    assert reason in said.found[-1]
    assert "takes edc 100 ms in the mean at its worst point and 100 ms in the worst mission" in said.found[-2]
    assert reason not in " ".join(found("6b", {"paper": rising, "edc": rising}, [10, 50]).found)
    assert "not timed here" in found("6a", {"edc": rising}, [10, 50]).found[0]


def test_what_the_papers_planner_flies_too_much_is_said() -> None:
    """Less than a millimetre is none; without its line, or that of edc, there is no finding."""
    edc = {"edc": lambda x: x}
    for paper, words in ((lambda _x: 9e-4, "no extra distance"), (lambda x: 0.01 * x, "from 0.100 to 0.400 m more")):
        assert words in found("5a", {**edc, "paper": paper}, [10, 40]).found[-1]
    for lines in (edc, {"paper": lambda _x: 0.0}):
        assert found("5a", lines, [10, 40]).found[:-1] == []
        assert found("5a", lines, [10, 40]).reproduced is None


def test_energy_is_compared_with_the_straight_lines() -> None:
    """The comparison is at both ends of edc's line, and over the whole line of the paper's planner."""
    lines = {"bound": lambda _x: 100.0, "paper": lambda x: 110.0 + x, "edc": lambda x: 110.0 + 2 * x}
    said = found("energy-plan", lines, [10, 20])
    assert said.reproduced is True
    assert "edc spends 30 % more than the straight lines at full speed would with 10 UAVs and 50 %" in said.found[0]
    assert "still spends 20 to 30 % more" in said.found[1]
    for missing in lines:
        rest = {name: line for name, line in lines.items() if name != missing}
        assert (found("energy-plan", rest, [10, 20]).reproduced, found("energy-plan", rest, [10, 20]).found) == (
            None,
            [],
        )


def test_energy_of_the_head_is_said() -> None:
    """The finding gives the range from the first point to the last."""
    assert "costs from 1.00 to 4.00 J per mission" in found("energy-head", {"edc": lambda x: x / 10}, [10, 40]).found[0]
    assert found("energy-head", {}, [10, 40]).found == []


@pytest.mark.parametrize(
    ("energy", "saves"),
    [
        (-2.0, "saves energy at 2 of 2 points, and costs some at 0"),
        (2.0, "saves energy at 0 of 2 points, and costs some at 2"),
    ],
)
def test_what_is_minimised_is_compared(energy: float, saves: str) -> None:
    """The finding gives the changes at both ends, in the mean, and the points with a saving."""
    lines = {"energy": lambda x: energy * x / 10, "distance": lambda _x: 1.0, "time": lambda _x: -1.0}
    said = found("energy-minimise", lines, [10, 20])
    ends = f"{energy:+.1f} % (x = 10) to {2 * energy:+.1f} % (x = 20), {1.5 * energy:+.1f} % in the mean"
    assert f"changes propulsion energy by {ends}" in said.found[0]
    assert saves in said.found[2]
    for missing in lines:
        rest = {name: line for name, line in lines.items() if name != missing}
        assert found("energy-minimise", rest, [10, 20]).found == []


def test_missions_that_did_not_end_are_said() -> None:
    """The finding names every incomplete mission."""
    lines = {"edc": lambda x: x, "paper": lambda _x: 0.0}
    said = finding("5a", "", rows("5a", lines, [10, 20], incomplete=2))
    assert "4 of 60 missions of edc did not bring every UAV home." in said.found
    assert "did not bring" not in " ".join(found("5a", lines, [10, 20]).found)


def test_energy_is_saved_only_where_it_shows() -> None:
    """A mean below 0 whose interval contains 0 is no saving."""
    lines = {"energy": lambda x: 1 - x / 10, "distance": lambda _x: 1.0, "time": lambda _x: 1.0}
    said = found("energy-minimise", lines, [9.98, 10, 10.05, 20, 40]).found
    assert "saves energy at 2 of 5 points, and costs some at 0." in said[-1]


@pytest.mark.parametrize(
    ("said", "expected"), [([True, True], 0), ([True, False], 1), ([True, None], 1), ([None, None], None)]
)
def test_only_a_run_that_says_so_is_complete(said: list[bool | None], expected: int | None) -> None:
    """A result without `completed` counts as complete nowhere; where no run is a flight, nothing is counted."""
    figure = next(figure for figure in FIGURES if figure.name == "4a")
    results = {}
    for series in figure.series:
        for x in figure.axis.values:
            for (run,), completed in zip(figure.samples(series, x, len(said)), said, strict=False):
                told = {} if completed is None else {"completed": completed}
                results[run.key] = {"potential_collisions": 1, "uavs": 10, **told}
    assert {row.incomplete for row in rows_of(figure, len(said), results) if row.series == "edc"} == {expected}
    unknown = {key: {**result, "potential_collisions": None} for key, result in results.items()}
    assert rows_of(figure, len(said), unknown) == [], "an unknown count is no point of a line"
