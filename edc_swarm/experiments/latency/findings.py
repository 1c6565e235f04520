"""Findings of a latency experiment, as sentences computed from its rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct

from edc_swarm.experiments.latency.table import CellRow, total

LITTLE_LOSS = 0.1
"""Greatest loss at which every mission is expected to complete."""
NAMED = 6
"""Most cells that a sentence names."""


class LatencyFinding(Struct, frozen=True):
    """One sentence, with True if it is as promised, False if not, None without a promise."""

    kept: bool | None
    text: str


def findings(rows: Sequence[CellRow]) -> list[LatencyFinding]:
    """Return all findings of the rows."""
    return [_safety(rows), *_holding(rows), *_completion(rows), *_noise(rows)]


def is_safe(rows: Sequence[CellRow]) -> bool:
    """Return True if no row has an overlap, a collision or a broken guarantee."""
    return not any(row.potential_collisions or row.true_collisions or row.broken for row in rows)


def is_judged(rows: Sequence[CellRow]) -> bool:
    """Return True if there are runs and every guarantee could be judged in each."""
    return bool(rows) and not any(row.not_judged for row in rows)


def named(row: CellRow) -> str:
    """Return a cell in words."""
    cell = row.cell
    return (
        f"{row.engine}, {cell.uavs} UAVs, slot {cell.slot_s:g} s, delay {cell.delay_ms:g} + {cell.jitter_ms:g} ms,"
        f" loss {100 * cell.loss:g} %"
    )


def _some(rows: Sequence[CellRow]) -> str:
    more = [f"and {len(rows) - NAMED} more"] if len(rows) > NAMED else []
    return "; ".join([named(row) for row in rows[:NAMED]] + more)


def _safety(rows: Sequence[CellRow]) -> LatencyFinding:
    runs = sum(row.runs for row in rows)
    overlaps = _known(total([row.potential_collisions for row in rows]))
    hits = _known(total([row.true_collisions for row in rows]))
    broken = sorted({name for row in rows for name in row.broken})
    unjudged = sorted({name for row in rows for name in row.not_judged})
    parts = [f"broken guarantees: {' '.join(broken)}"] if broken else []
    parts += [f"not judged in every run: {' '.join(unjudged)}"] if unjudged else []
    guarantees = "; ".join(parts) or "G1-G5 held in every run"
    text = f"{len(rows)} cells, {runs} runs: {overlaps} overlaps of discs, {hits} true collisions; {guarantees}."
    return LatencyFinding(None if is_safe(rows) and not is_judged(rows) else is_safe(rows), text)


def _known(count: int | None) -> str:
    return "an unknown number of" if count is None else str(count)


def _holding(rows: Sequence[CellRow]) -> Iterator[LatencyFinding]:
    """Yield, for each swarm, the delay from which all hold, without jitter and loss, beside the predicted one."""
    for engine, uavs, slot_s in dict.fromkeys((row.engine, row.cell.uavs, row.cell.slot_s) for row in rows):
        still = [
            row
            for row in rows
            if (row.engine, row.cell.uavs, row.cell.slot_s) == (engine, uavs, slot_s)
            and not row.cell.jitter_ms
            and not row.cell.loss
        ]
        if not still:
            continue
        expected = min((row.cell.delay_ms for row in still if row.predicted_to_hold), default=None)
        found = min((row.cell.delay_ms for row in still if row.only_holds), default=None)
        flew = max((row.cell.delay_ms for row in still if not row.only_holds), default=None)
        yield LatencyFinding(
            found == expected,
            f"{engine}, {uavs} UAVs, slot {slot_s:g} s: two delays and the transport fill a slot from"
            f" {still[0].hold_delay_ms:g} ms on. Of the delays flown, the least with which the swarm only holds:"
            f" {_ms(found)} (expected {_ms(expected)}); the largest with which it flies: {_ms(flew)}.",
        )


def _ms(value: float | None) -> str:
    return "none of them" if value is None else f"{value:g} ms"


def _completion(rows: Sequence[CellRow]) -> Iterator[LatencyFinding]:
    flown = [row for row in rows if not row.predicted_to_hold and row.completed_pct is not None]
    able = [row for row in flown if not (row.predicted_to_starve or row.predicted_to_land)]
    little = [row for row in able if row.cell.loss <= LITTLE_LOSS]
    more = [row for row in able if row.cell.loss > LITTLE_LOSS]
    starved = [row for row in flown if row.predicted_to_starve]
    landed = [row for row in flown if row.predicted_to_land and not row.predicted_to_starve]
    yield from _completed(f"Below that delay, loss up to {100 * LITTLE_LOSS:g} %", little, promised=True)
    yield from _completed("Below that delay, more loss", more, promised=False)
    yield from _completed(
        "Below that delay, but with so few commands in time that UAVs are expected to land", landed, promised=False
    )
    yield from _completed(
        "Below that delay, but with fewer commands in time than the longest way needs", starved, promised=False
    )


def _completed(title: str, rows: Sequence[CellRow], *, promised: bool) -> Iterator[LatencyFinding]:
    if not rows:
        return
    short = [row for row in rows if row.completed_pct != 100.0]
    rest = f" Not all in: {_some(short)}." if short else ""
    text = f"{title}: all missions completed in {len(rows) - len(short)} of {len(rows)} cells.{rest}"
    yield LatencyFinding(not short if promised else None, text)


def _noise(rows: Sequence[CellRow]) -> Iterator[LatencyFinding]:
    invalid = [row for row in rows if row.invalid_runs]
    if invalid:
        runs = sum(row.invalid_runs for row in invalid)
        yield LatencyFinding(
            None,
            f"{runs} runs are invalid, since the machine was overloaded (more than 1 % of the ticks late); their"
            f" times are left out, their safety is not: {_some(invalid)}.",
        )
