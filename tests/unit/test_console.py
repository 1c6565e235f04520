"""What the command line prints of a recording: lines that fit a narrow terminal, and whole ones elsewhere."""

from __future__ import annotations

import re

import pytest
from rich.console import Console

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.errors import RecordingError
from edc_swarm.mission.fault_help import fault_help
from processes.cli.commands.faults import faults
from processes.cli.summary import print_metrics
from processes.runtime.console import complain, print_line
from tests.unit.synthetic import flight, recorded, straight

LINE = "    5.0 s  claim         u015: claims term 2: 26 UAVs suspecting the head"


def test_a_narrow_terminal_gets_lines_cut_between_words(capsys: pytest.CaptureFixture[str]) -> None:
    """Further lines are indented, so that the eye finds the next happening."""
    print_line(LINE, Console(width=40))
    first, *others = capsys.readouterr().out.splitlines()
    assert first == "    5.0 s  claim         u015: claims"
    assert others == ["        term 2: 26 UAVs suspecting the", "        head"]


def test_elsewhere_a_line_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    """A program that reads the lines finds one for each happening."""
    print_line(LINE, Console(width=40, soft_wrap=True))
    assert capsys.readouterr().out == f"{LINE}\n"


def test_the_vocabulary_of_faults_fits_a_narrow_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Words are whole; a pipe gets the page as it stands in the docs."""
    faults()
    assert capsys.readouterr().out == fault_help()
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "40")
    faults()
    said = re.sub("\x1b\\[[0-9;]*m", "", capsys.readouterr().out)
    assert max(map(len, said.splitlines())) <= 40
    assert set(re.findall("[A-Za-z]+", said)) == set(re.findall("[A-Za-z]+", fault_help()))


def test_each_part_of_a_metric_has_a_line_on_a_terminal() -> None:
    """Reasons of many UAVs would be one long paragraph; a pipe gets a line for each metric."""
    metrics = compute_metrics(recorded(flight([straight((0, 0), (0, 20), 10), straight((9, 20), (9, 0), 10)])))
    for soft_wrap in (False, True):
        console = Console(width=120, soft_wrap=soft_wrap)
        with console.capture() as captured:
            print_metrics(metrics, console)
        (line,) = (line for line in captured.get().splitlines() if line.startswith("age of fixes"))
        assert ("; peaks" in line) is soft_wrap


def test_an_unreadable_recording_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """The reason is a sentence of its own."""
    complain(RecordingError("a.mcap", "cannot be read: Permission denied"))
    said = "error: recording = 'a.mcap': must be a readable recording; it cannot be read: Permission denied\n"
    assert capsys.readouterr().err == said
