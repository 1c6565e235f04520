"""Plan times of a simulated recording, which are in a file beside it: FILE.timings.json."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
from msgspec import Struct

from edc_swarm.errors import RecordingError
from edc_swarm.files import read_regular
from edc_swarm.recording.model import Recording


class Timing(Struct, frozen=True):
    """Measured plan time of one slot. A simulated recording lacks it, since its bytes must not depend on a clock."""

    slot: int
    plan_ms: float
    guidance_ms: float = 0.0
    assemble_ms: float = 0.0
    solve_ms: float = 0.0


class Timings(Struct, frozen=True):
    """Content of FILE.timings.json: plan times, and the SHA-256 of their recording."""

    recording: str
    plans: list[Timing]


def content_hash(recording_path: str | Path) -> str:
    """Return the SHA-256 of a recording's bytes.

    Raises
    ------
    RecordingError
        The file cannot be read.
    """
    try:
        with Path(recording_path).open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(recording_path, f"cannot be read: {error.strerror}") from None


def _ignore(_: str) -> None:
    pass


def load_timings(recording_path: str | Path, warn: Callable[[str], None] = _ignore) -> list[Timing]:
    """Read the plan times of a simulated recording from FILE.timings.json beside it; empty if they are unknown.

    Times of another recording are ignored, with a warning through `warn`.

    Raises
    ------
    RecordingError
        The file cannot be read or is not a list of timings.
    """
    path = Path(recording_path).with_suffix(".timings.json")
    try:
        timings = msgspec.json.decode(read_regular(path), type=Timings | list[Timing])
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingError(path, f"holds no timings: {error}") from None
    if isinstance(timings, Timings) and timings.recording == content_hash(recording_path):
        return timings.plans
    warn(f"warning: {path} is not known to belong to {recording_path}: plan times are unknown")
    return []


def measured(recording: Recording, timings: Sequence[Timing]) -> Sequence[Timing]:
    """Return `timings` for a simulated run, and nothing for a real one, whose reports contain its plan times."""
    return () if recording.run.get("clock") == "wall" else timings
