"""The count of runs on standard error."""

from __future__ import annotations

import pytest

from processes.runtime import run_count as module
from processes.runtime.run_count import run_count


def test_without_a_terminal_a_line_tells_how_far_the_runs_are(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is said more often than asked for, and an interrupt says what has ended."""
    with run_count("fuzz", 3) as end_run:
        end_run("0 broken")
    assert capfd.readouterr().err == ""
    monkeypatch.setattr(module, "LINE_EVERY_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        _interrupted()
    assert capfd.readouterr().err.splitlines() == [
        "fuzz: 5 of 7 runs, 0 broken, about 0 min left",
        "fuzz: 6 of 7 runs, 1 broken, about 0 min left",
        "fuzz: 6 of 7 runs, 1 broken",
    ]


def _interrupted() -> None:
    with run_count("fuzz", 7, 4) as end_run:
        end_run("0 broken")
        end_run("1 broken")
        raise KeyboardInterrupt
