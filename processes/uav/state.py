"""The state of a UAV on disk: its promise, and the emulated airframe that outlives the process.

These are two files, so that a test or a fault can remove the promise and leave the vehicle in its place.
The fault model is the death of a process, not of the machine: a completed `pwrite` survives SIGKILL, so
no fsync is needed (with one, a slow disk would make ticks late). A record is a page and
one call writes it, so no reader sees half of it.
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
from edc_swarm.mission.roster_entry import RosterEntry

RECORD_BYTES = 4096

Record = TypeVar("Record", bound=Struct)


class StateFile(Generic[Record]):
    """File with one record of fixed size, locked until this process ends."""

    def __init__(self, path: Path, kind: type[Record]) -> None:
        self._kind = kind
        self._file = os.open(path, os.O_RDWR)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError("state file", str(path), "of a UAV that no other process flies") from None

    def read(self) -> Record | None:
        """Return the record, or None if the bytes are no such record."""
        try:
            return msgspec.json.decode(os.pread(self._file, RECORD_BYTES, 0).rstrip(), type=self._kind)
        except msgspec.DecodeError:
            return None

    def write(self, record: Record) -> None:
        """Replace the record."""
        os.pwrite(self._file, _padded(record), 0)


class UavState:
    """Promise and airframe of one UAV in `folder`.

    A missing or unreadable promise is a lost memory: `promise` then stays None.
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
        """Write the promise, if there is one, and then the airframe."""
        if promise is not None and self._promise is not None:
            self._promise.write(promise)
        self._airframe.write(airframe)
        self.airframe = airframe


def create_state(folder: Path, entry: RosterEntry) -> None:
    """Create the files of a new UAV, with term 0 and the start position of the roster.

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
            made.unlink(missing_ok=True)  # A later run would take half a file for a lost memory.
        raise InputError("state file", path.name, f"on a disk that can be written: {folder}: {_why(error)}") from None


def has_state(folder: Path, uav: str) -> bool:
    """Return True if the files of `uav` were created; its promise may be lost since."""
    return _airframe_path(folder, uav).exists()


def promise_path(folder: Path, uav: str) -> Path:
    """Return the path of the promise of `uav`."""
    return folder / f"{uav}.promise"


def _airframe_path(folder: Path, uav: str) -> Path:
    return folder / f"{uav}.airframe"


def _why(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def _padded(record: Struct) -> bytes:
    return msgspec.json.encode(record).ljust(RECORD_BYTES - 1) + b"\n"
