"""Every exception that edc_swarm raises, in one tree.

Expected outcomes (no quorum, infeasible, stale, unheard) are values, never exceptions. What is
raised here is bad input, with the data that a caller needs to say what is wrong in one line. What is given
to an exception is its `args`, so it passes from a worker's process to another whole.
"""

from __future__ import annotations

from pathlib import Path


class SwarmError(Exception):
    """Base of all exceptions of this project."""


class InputError(SwarmError):
    """A value from outside is not acceptable.

    Attributes
    ----------
    field
        Name of the field or option, as the user wrote it.
    value
        The offending value.
    allowed
        What would have been accepted, completing "must be ...".
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(field, value, allowed)
        self.field = field
        self.value = value
        self.allowed = allowed

    def __str__(self) -> str:
        return f"{self.field} = {_shown(self.value)}: must be {self.allowed}"


class MissionError(InputError):
    """A mission file, option or mission message does not describe a mission that can be flown."""


class PlacementError(MissionError):
    """The random mission's UAVs cannot be placed at this density."""


class MessageError(SwarmError):
    """Bytes from the bus are not a message of the expected kind: count, report, drop.

    Attributes
    ----------
    key
        Key expression on which the bytes arrived.
    reason
        Why they were refused.
    """

    def __init__(self, key: str, reason: str) -> None:
        super().__init__(key, reason)
        self.key = key
        self.reason = reason

    def __str__(self) -> str:
        return f"{self.key}: {self.reason}"


class RecordingError(SwarmError):
    """A recording cannot be read or written.

    Attributes
    ----------
    path
        The file.
    reason
        What is wrong with it, in the user's terms.
    """

    def __init__(self, path: str | Path, reason: str) -> None:
        super().__init__(path, reason)
        self.path = Path(path)
        self.reason = reason

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"


def _shown(value: object, limit: int = 200) -> str:
    """Return the value in one line; a path is mostly shorter than the limit, and shown whole."""
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."
