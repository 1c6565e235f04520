"""Text of strangers is escaped and cut before people see it."""

from __future__ import annotations

import pytest

from edc_swarm.analysis.guarantees.verdict import Violation, not_judged, verdict
from edc_swarm.foreign_text import MAX_LINE, shown
from processes.runtime.console import note


def test_control_characters_are_escaped() -> None:
    """Escapes, bells, direction marks and lone surrogates alike."""
    assert shown("\x1b[31m\a\u202e\udcff ä") == r"\x1b[31m\x07\u202e\udcff ä"


def test_long_text_is_cut_and_its_length_told() -> None:
    """However long it is."""
    assert shown("x" * 600_000) == "x" * 200 + "... (600000 characters)"


def test_verdicts_and_notes_hold_no_escapes(capsys: pytest.CaptureFixture[str]) -> None:
    """Neither violations nor notes nor what is told beside the result."""
    foreign = "\x1b]0;title\a" + "x" * 600_000
    result = verdict("G5", "", [Violation("k", foreign)], [foreign])
    note(f"two\nlines {foreign}")
    for text in (
        *result.where,
        *result.notes,
        *not_judged("G5", "", foreign).notes,
        *capsys.readouterr().err.split("\n"),
    ):
        assert text.isprintable()
        assert len(text) < 2 * MAX_LINE
