"""All exceptions of edc_swarm, in one tree.

Expected outcomes (no quorum, infeasible, stale, unheard) are values, never exceptions. These exceptions report bad
input, with the data that a caller needs for an error in one line. Their arguments are their `args`, so they can be
pickled and pass from a worker process to its parent.
"""

from __future__ import annotations

from pathlib import Path


class SwarmError(Exception):
    """Base of all exceptions of this project."""


class InputError(SwarmError):
    """Rejection of a value that comes from outside.

    Attributes
    ----------
    field
        Name of the field or option, as the user wrote it.
    value
        The offending value.
    allowed
        The values that are accepted, to complete "must be ...".
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(field, value, allowed)
        self.field = field
        self.value = value
        self.allowed = allowed

    def __str__(self) -> str:
        return f"{self.field} = {_shown(self.value)}: must be {self.allowed}"


class MissionError(InputError):
    """Rejection of a mission file, option or mission message that describes no mission that can be flown."""


class PlacementError(MissionError):
    """Rejection of a random mission whose UAVs do not fit into its area."""


class SpacingError(MissionError):
    """Rejection of a roster in which the discs of two UAVs overlap at their starts, or at their targets."""


class MessageError(SwarmError):
    """Rejection of bytes from the bus that are no message of the expected kind; callers count, report and drop them.

    Attributes
    ----------
    key
        Key expression on which the bytes arrived.
    reason
        Why they are rejected.
    """

    def __init__(self, key: str, reason: str) -> None:
        super().__init__(key, reason)
        self.key = key
        self.reason = reason

    def __str__(self) -> str:
        return f"{self.key}: {self.reason}"


class RecordingError(SwarmError):
    """Failure to read or write a recording.

    Attributes
    ----------
    path
        The file.
    reason
        The fault of the file, in words that follow "it".
    """

    def __init__(self, path: str | Path, reason: str) -> None:
        super().__init__(path, reason)
        self.path = Path(path)
        self.reason = reason

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"


class EarlyEndError(RecordingError):
    """Failure to read a torn recording that ends before its mission: it may be one of any mission."""


class FormatError(SwarmError):
    """Rejection of a file that holds no mission of a known format.

    Attributes
    ----------
    item
        The place in the file, such as "item 3"; "" for the whole file.
    reason
        The fault of the item, and what it must be.
    file
        Name of the file; "" until the caller that knows it adds it (`of`).
    """

    def __init__(self, item: str, reason: str, file: str = "") -> None:
        super().__init__(item, reason, file)
        self.item = item
        self.reason = reason
        self.file = file

    def of(self, file: str) -> FormatError:
        """Return the same error with the name of its file."""
        return FormatError(self.item, self.reason, self.file or file)

    def __str__(self) -> str:
        return ": ".join(part for part in (self.file, self.item, self.reason) if part)


def _shown(value: object, limit: int = 200) -> str:
    """Return the value in one line. Most paths are shorter than the limit, so errors show them whole."""
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."
