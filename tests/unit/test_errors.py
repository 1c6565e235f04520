"""Every exception says in one line what is wrong, and keeps the data."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from edc_swarm import errors


def test_input_error_names_field_value_and_what_is_allowed() -> None:
    """`FIELD = VALUE: must be ...`, with the parts as attributes."""
    error = errors.MissionError("r_m", -1.0, "greater than 0")
    assert str(error) == "r_m = -1.0: must be greater than 0"
    assert (error.field, error.value, error.allowed) == ("r_m", -1.0, "greater than 0")


def test_long_values_are_cut() -> None:
    """A value of a megabyte does not fill the terminal, and no line break gets through."""
    text = str(errors.InputError("name", "x\n" * 1000, "short"))
    assert len(text) < 300
    assert "\n" not in text
    assert "..." in text


def test_paths_are_shown_whole() -> None:
    """Else nobody knows which file is meant."""
    path = "/" + "/".join(["folder"] * 20) + "/a.mcap"
    assert path in str(errors.InputError("--out", path, "where it can be written"))


def test_message_and_recording_errors() -> None:
    """Key or path first, then the reason."""
    assert str(errors.MessageError("uav/a/fix", "not JSON")) == "uav/a/fix: not JSON"
    error = errors.RecordingError("a.mcap", "cut short")
    assert str(error) == "a.mcap: cut short"
    assert error.path == Path("a.mcap")


@pytest.mark.parametrize("kind", [errors.InputError, errors.MessageError, errors.RecordingError])
def test_one_tree(kind: type[Exception]) -> None:
    """Callers that catch `SwarmError` catch everything of this project."""
    assert issubclass(kind, errors.SwarmError)
    assert issubclass(errors.PlacementError, errors.MissionError)
    assert issubclass(errors.MissionError, errors.InputError)


@pytest.mark.parametrize(
    "error",
    [
        errors.PlacementError("--uavs", 900, "fewer"),
        errors.MessageError("uav/a/fix", "not JSON"),
        errors.RecordingError("a.mcap", "cut short"),
    ],
)
def test_an_error_passes_from_a_worker_whole(error: errors.SwarmError) -> None:
    """One that did not would end the whole pool of workers, and nobody would learn why."""
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), str(copy), vars(copy)) == (type(error), str(error), vars(error))
