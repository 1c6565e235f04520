"""What a UAV keeps on disk: its promise, and the emulated body that outlives the process.

Two files, so that a test or a fault can take away the memory and leave the vehicle where it is. The
fault model is the death of a process, not of the machine: what a completed `pwrite` has given to
the kernel survives SIGKILL, so no fsync is needed (with one, a slow disk would make ticks late). A
record is far smaller than a page and is written by one call, so it is never half there.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import Generic, TypeVar

import msgspec
from msgspec import Struct

from edc_swarm.agent.vehicle import Airframe, Promise, first_airframe, first_promise
from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import RosterEntry

RECORD_BYTES = 512

Record = TypeVar("Record", bound=Struct)


class StateFile(Generic[Record]):
    """One record of fixed size, locked for as long as this process lives."""

    def __init__(self, path: Path, kind: type[Record]) -> None:
        self._kind = kind
        self._file = os.open(path, os.O_RDWR)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError("state file", str(path), "of a UAV that no other process flies") from None

    def read(self) -> Record | None:
        """The record, or None when the bytes are no such record."""
        try:
            return msgspec.json.decode(os.pread(self._file, RECORD_BYTES, 0).rstrip(), type=self._kind)
        except msgspec.DecodeError:
            return None

    def write(self, record: Record) -> None:
        """Replace the record."""
        os.pwrite(self._file, _padded(record), 0)


class UavState:
    """Promise and airframe of one UAV in `folder`.

    A missing or unreadable promise is a lost memory: `promise` is then None for good.
    """

    def __init__(self, folder: Path, uav: str) -> None:
        self._airframe = StateFile(_airframe_path(folder, uav), Airframe)
        path = promise_path(folder, uav)
        self._promise = StateFile(path, Promise) if path.exists() else None
        airframe = self._airframe.read()
        if airframe is None:
            raise InputError("state file", str(_airframe_path(folder, uav)), "the record of an airframe")
        self.airframe = airframe
        self.promise = self._promise.read() if self._promise is not None else None

    def write(self, promise: Promise | None, airframe: Airframe) -> None:
        """Keep what was promised, then where the body is."""
        if promise is not None and self._promise is not None:
            self._promise.write(promise)
        self._airframe.write(airframe)


def create_state(folder: Path, entry: RosterEntry) -> None:
    """Make the files of a new UAV: term 0 and the roster start.

    Raises
    ------
    InputError
        The disk is full, or the folder cannot be written.
    """
    path = promise_path(folder, entry.uav)
    try:
        path.write_bytes(_padded(first_promise(entry)))
        path = _airframe_path(folder, entry.uav)
        path.write_bytes(_padded(first_airframe(entry)))
    except OSError as error:
        for made in (promise_path(folder, entry.uav), _airframe_path(folder, entry.uav)):
            made.unlink(missing_ok=True)  # Half a file would pass for a lost memory.
        raise InputError("state file", path.name, f"on a disk that can be written: {folder}: {_why(error)}") from None


def has_state(folder: Path, uav: str) -> bool:
    """Whether `uav` has been made; its promise may have been lost since."""
    return _airframe_path(folder, uav).exists()


def promise_path(folder: Path, uav: str) -> Path:
    """Where the promise of `uav` is."""
    return folder / f"{uav}.promise"


def _airframe_path(folder: Path, uav: str) -> Path:
    return folder / f"{uav}.airframe"


def _why(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def _padded(record: Struct) -> bytes:
    return msgspec.json.encode(record).ljust(RECORD_BYTES - 1) + b"\n"
