"""Measurements of a run in which every time is known, and the rows and findings of many runs."""

from __future__ import annotations

import msgspec
import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.latency_sample import Sample, sample_of
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.emulation.links import DelayError
from edc_swarm.experiments.latency.declared import sweep_of
from edc_swarm.experiments.latency.findings import NAMED, findings, is_judged, is_safe, named
from edc_swarm.experiments.latency.table import CellRow, flat, row_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Command, Event, Fix, Report, Truth
from processes.experiments.measures import simulate
from tests.unit.synthetic import change, flight, parallel, recorded, straight

SWEEP = sweep_of({"delays_ms": [0, 300], "jitters_ms": [0], "losses": [0], "uavs": [3], "repeats": 2})
FLOWN, HELD = SWEEP.cells


def sample(**fields: object) -> Sample:
    """Return the sample of a run in which nothing fails."""
    return msgspec.structs.replace(sample_of(recorded(flight(parallel()))), **fields)


def rows(*samples: Sample, at_300_ms: Sample | None = None) -> list[CellRow]:
    """Return the rows of both cells."""
    held = at_300_ms or sample(completed=False, others_flew=0)
    return [row_of(SWEEP, "sim", FLOWN, samples), row_of(SWEEP, "sim", HELD, [held])]


def test_ages_of_a_faultless_mission() -> None:
    """UAVs send fixes 2 ms and the head commands 12 ms into a slot, so ages are a slot minus that."""
    found = sample()
    assert found.fix_age_ms == pytest.approx(498.0)
    assert found.command_age_ms == pytest.approx(488.0)
    assert found.fix_to_command_ms == pytest.approx(10.0)
    assert (found.held_pct, found.completed, found.broken, found.others_flew) == (0.0, True, [], 2 * 8)
    assert found.extra_distance_pct == pytest.approx(0.0, abs=1e-9)
    energy_j = compute_metrics(recorded(flight(parallel()))).energy_propulsion_j
    assert energy_j is not None
    assert found.energy_kj == pytest.approx(energy_j / 1e3)


def test_who_stays_where_it_is_is_not_held() -> None:
    """A UAV at its target is not held, and a record that ends before the first command has no age."""
    assert sample_of(recorded(flight([[(0.0, 0.0)] * 2, [(50.0, 0.0)] * 2]))).held_pct is None
    assert sample_of(recorded(flight(parallel())[:1])).command_age_ms is None


def test_a_fix_that_no_plan_counts_ages() -> None:
    """If one UAV gets no command in one of eight slots, its fix is a slot older there."""
    messages = flight(parallel())
    messages = [m for m in messages if not (isinstance(m, Command) and (m.uav, m.slot) == ("u1", 4))]
    assert sample_of(recorded(messages)).fix_age_ms == pytest.approx(498.0 + 500.0 / (8 * 3))


def test_only_the_fix_that_a_command_names_is_counted() -> None:
    """A retransmitted fix that the head did not use does not count; without names in commands ages are unknown."""
    messages = flight(parallel())
    again = next(m for m in messages if isinstance(m, Fix) and (m.uav, m.slot) == ("u1", 3))
    messages.append(msgspec.structs.replace(again, sent_ns=again.sent_ns + 10_000_000, seq=98))
    assert sample_of(recorded(messages)).fix_age_ms == pytest.approx(498.0)
    assert change(messages, {"uav": "u1", "slot": 4}, Command, fix_seq=98) == 1
    assert sample_of(recorded(messages)).fix_age_ms == pytest.approx(498.0 - 10.0 / (8 * 3))
    change(messages, {}, Command, fix_seq=-1)
    assert sample_of(recorded(messages)).fix_age_ms is None


def test_the_dead_neither_hold_nor_age() -> None:
    """A UAV that was killed under way is left out from its last fix on."""
    messages = [m for m in flight(parallel()) if not (isinstance(m, Fix) and m.uav == "u2" and m.slot > 3)]
    for slot in range(4, 9):
        assert change(messages, {"slot": slot}, Report, heard=["u0", "u1"]) == 1
    messages.append(Event(source="operator", slot=4, kind="fault", detail="kill u2 @4"))
    messages = [m for m in messages if not (isinstance(m, Truth) and m.uav == "u2" and m.slot > 3)]
    found = sample_of(recorded(messages))
    assert (found.held_pct, found.fix_age_ms, found.command_age_ms) == (0.0, pytest.approx(498.0), pytest.approx(488.0))


def test_who_is_there_holds_nothing_up() -> None:
    """A UAV at its target without a command is not held."""
    messages = flight([straight((0.0, 40.0), (0.0, 44.0), 2), *parallel()])
    for slot in range(3, 9):
        assert change(messages, {"uav": "u0", "slot": slot}, Fix, executing=False, command_term=-1) == 1
    assert sample_of(recorded(messages)).held_pct == 0.0


def test_nobody_is_held_before_the_first_commands() -> None:
    """The slots before a late election do not count."""
    messages = flight([straight((12.0 * k, 0.0), (12.0 * k, 16.0), 8, wait=3) for k in range(3)])
    late = [m for m in messages if not (isinstance(m, Command) and m.slot < 3)]
    for slot in (1, 2):
        assert change(late, {"slot": slot}, Fix, executing=False, command_term=-1, command_seq=-1) == 3
    assert sample_of(recorded(late)).held_pct == 0.0


def test_a_swarm_that_only_holds() -> None:
    """Only the head flies; the share held is that of the others, and commands grow old."""
    recording, _ = simulate(Mission(uavs=3, max_slots=40, link=[Link(delay_ms=300)]))
    found = sample_of(recording)
    assert (found.others_flew, found.completed, found.extra_distance_pct) == (0, False, None)
    assert found.held_pct is not None
    assert found.held_pct > 60.0
    assert found.command_age_ms is not None
    assert found.command_age_ms > 2000.0
    assert found.broken == []
    open_ones = {verdict.guarantee for verdict in check(recording) if not verdict.held} - {"G8"}
    assert open_ones == {"G7"}, "nothing is promised"


def test_a_swarm_without_a_head() -> None:
    """If no UAV hears another, all are held, and nothing else is measured."""
    recording, _ = simulate(Mission(uavs=3, max_slots=30, link=[Link(loss=1.0)]))
    found = sample_of(recording)
    assert (found.held_pct, found.terms, found.fix_to_command_ms) == (100.0, 0, None)


def test_delay_error_is_over_all_uavs() -> None:
    """The error has the median of medians, and the greatest of the other values."""
    told = [DelayError(10, 0.1, 0.5, 0.9), DelayError(30, 0.3, 0.4, 2.0), DelayError(20, 0.2, 0.7, 1.0)]
    events = [
        Event(source=f"u{k}", instance=f"i{k}", kind=EventKind.DELAY_ERROR, detail=msgspec.json.encode(one).decode())
        for k, one in enumerate(told)
    ]
    messages = flight(parallel())
    assert sample_of(recorded([*messages, *events])).delay_error == DelayError(60, 0.2, 0.7, 2.0)
    assert sample_of(recorded(messages)).delay_error is None


def test_overloaded_runs_are_told_apart() -> None:
    """Times of overloaded runs are left out, their safety is not."""
    assert [sample(ticks_late_pct=pct).invalid for pct in (1.0, 1.1)] == [False, True]
    good, slow = sample(), sample(ticks_late_pct=3.0, fix_age_ms=9e9, potential_collisions=1, min_disc_gap_m=-1.0)
    (row, _) = rows(good, slow)
    assert (row.runs, row.invalid_runs, row.potential_collisions, row.min_disc_gap_m) == (2, 1, 1, -1.0)
    assert row.quantities["fix_age_ms"].mean == good.fix_age_ms
    assert any("1 runs are invalid" in found.text for found in findings([row]))


def test_a_row_is_about_the_worst_of_its_runs() -> None:
    """A row has the earliest limit, the most late ticks, every broken guarantee; it only holds if no run flew."""
    still = sample(limit_slots=200, others_flew=0, ticks_late_pct=3.0, broken=["G1"], terms=3)
    (row, _) = rows(sample(), still)
    assert (row.limit_slots, row.ticks_late_pct, row.broken, row.only_holds) == (200, 3.0, ["G1"], False)
    assert row.terms == 2.0
    assert rows(still)[0].only_holds


def test_the_largest_delay_with_which_it_flies_is_told() -> None:
    """The finding gives the largest such delay, not the least."""
    sweep = sweep_of({"delays_ms": [0, 100, 300], "jitters_ms": [0], "losses": [0], "uavs": [3], "repeats": 1})
    flown = [sample(), sample(), sample(completed=False, others_flew=0)]
    made = [row_of(sweep, "sim", cell, [one]) for cell, one in zip(sweep.cells, flown, strict=True)]
    assert "the largest with which it flies: 100 ms." in findings(made)[1].text


def test_a_cell_of_invalid_runs_alone() -> None:
    """A cell with invalid runs only has a row without numbers."""
    (row, _) = rows(sample(ticks_late_pct=3.0))
    assert (row.quantities, row.completed_pct) == ({}, None)
    assert flat(row)["makespan_s"] is None


def test_findings_of_a_sweep_as_promised() -> None:
    """Nothing overlaps, all missions complete, and holding starts where two delays fill a slot."""
    found = findings(rows(sample(), sample()))
    assert [one.kept for one in found] == [True, True, True]
    assert "the least with which the swarm only holds: 300 ms (expected 300 ms)" in found[1].text


@pytest.mark.parametrize(
    ("broken", "which"),
    [
        ({"potential_collisions": 1}, 0),
        ({"true_collisions": 1}, 0),
        ({"broken": ["G1"]}, 0),
        ({"others_flew": 0}, 1),
        ({"completed": False}, 2),
    ],
)
def test_findings_of_a_broken_promise(broken: dict[str, object], which: int) -> None:
    """Each kind of failure in one of two runs appears in its sentence."""
    made = rows(sample(**broken), sample(**broken) if which == 1 else sample())
    assert [one.kept for one in findings(made)] == [index != which for index in range(3)]
    assert is_safe(made) is (which != 0)


def test_a_run_that_was_not_judged_is_not_counted_as_safe() -> None:
    """The finding promises nothing and names the missing evidence, and the whole sweep is not judged."""
    made = rows(sample(), sample(not_judged=["G3"]))
    assert (made[0].not_judged, flat(made[0])["not_judged"]) == (["G3"], "G3")
    assert (is_safe(made), is_judged(made), is_judged(rows(sample())), is_judged([])) == (True, False, True, False)
    assert findings(made)[0].kept is None
    assert "not judged in every run: G3" in findings(made)[0].text
    assert findings(rows(sample(broken=["G1"]), sample(not_judged=["G3"])))[0].kept is False


@pytest.mark.parametrize("swept", [{"jitters_ms": [0, 600]}, {"losses": [0, 0.9]}])
def test_the_arithmetic_is_about_delay_alone(swept: dict[str, object]) -> None:
    """A swarm that holds because of jitter or loss does not contradict the arithmetic."""
    sweep = sweep_of({"delays_ms": [0], "jitters_ms": [0], "losses": [0], "uavs": [3], "repeats": 1, **swept})
    flown = [sample(), sample(completed=False, others_flew=0)]
    made = [row_of(sweep, "sim", cell, [one]) for cell, one in zip(sweep.cells, flown, strict=True)]
    assert findings(made)[1].kept is True


def test_up_to_a_tenth_lost_all_is_promised() -> None:
    """The promise includes a loss of exactly a tenth, and nothing beyond it."""
    sweep = sweep_of({"delays_ms": [0], "jitters_ms": [0], "losses": [0.1, 0.2], "uavs": [3], "repeats": 1})
    made = [row_of(sweep, "sim", cell, [sample(completed=False)]) for cell in sweep.cells]
    promised, more = findings(made)[-2:]
    assert (promised.kept, more.kept) == (False, None)
    assert "0 of 1 cells. Not all in: sim" in promised.text
    (*_, whole) = findings(rows(sample()))
    assert whole.text.endswith("in 1 of 1 cells.")


def test_what_broke_is_said() -> None:
    """Each guarantee appears once, in order; holding is expected from the least delay that fills a slot."""
    sweep = sweep_of({"delays_ms": [0, 300, 400], "jitters_ms": [0], "losses": [0], "uavs": [3], "repeats": 1})
    flown = [sample(broken=["G3", "G1"]), sample(completed=False, others_flew=0, broken=["G2", "G1"])]
    made = [row_of(sweep, "sim", cell, [one]) for cell, one in zip(sweep.cells, [*flown, flown[1]], strict=True)]
    found = findings(made)
    assert found[0].text.endswith("broken guarantees: G1 G2 G3.")
    assert "expected 300 ms" in found[1].text
    assert findings(rows(sample()))[0].text.endswith("G1-G5 held in every run.")


def test_so_many_cells_are_named() -> None:
    """The finding counts the other cells."""
    delays = list(range(NAMED + 2))
    sweep = sweep_of({"delays_ms": delays, "jitters_ms": [0], "losses": [0], "uavs": [3], "repeats": 1})
    made = [row_of(sweep, "sim", cell, [sample(completed=False)]) for cell in sweep.cells]
    *_, told = findings(made)
    assert named(made[NAMED - 1]) in told.text
    assert told.text.endswith("; and 2 more.")
    *_, told = findings(made[:NAMED])
    assert told.text.endswith(f"{named(made[NAMED - 1])}.")


def test_a_swarm_that_flies_where_it_should_hold() -> None:
    """The finding reports such a swarm."""
    assert findings(rows(sample(), at_300_ms=sample()))[1].kept is False


def test_a_line_of_the_table_has_every_number() -> None:
    """A line has the cell, the counts, and every quantity with its interval."""
    (row, _) = rows(sample(makespan_s=4.0), sample(makespan_s=6.0))
    line = flat(row)
    assert (line["uavs"], line["delay_ms"], line["runs"], line["makespan_s"]) == (3, 0.0, 2, 5.0)
    assert line["makespan_s_low"] < 4.0
    assert line["makespan_s_high"] > 6.0
    assert line["mean_min_disc_gap_m"] == pytest.approx(line["min_disc_gap_m"])


@pytest.mark.parametrize("predicted", ["predicted_to_starve", "predicted_to_land"])
def test_a_cell_that_cannot_be_completed_breaks_no_promise(predicted: str) -> None:
    """A cell with too few commands in time to fly the longest way, or to stay in the air, is told without a promise."""
    (row, _) = rows(sample(completed=False))
    starved = msgspec.structs.replace(row, **{predicted: True})
    assert [found.kept for found in findings([row])][-1] is False
    (*_, told) = findings([starved])
    assert [found.kept for found in findings([starved])] == [True, True, None]
    assert "0 of 1 cells" in told.text
