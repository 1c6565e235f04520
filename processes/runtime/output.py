"""The files of a run: one recording, the logs beside it, and the UAVs' state files during the run."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from edc_swarm.errors import InputError, RecordingError, SwarmError
from edc_swarm.files import open_regular
from edc_swarm.recording.reader import recover

SUFFIX = ".mcap"
PART = ".part"
TORN = ".torn"
FOLDER = Path("recordings")


class Output:
    """The files of one run. It claims them at the start, so it overwrites nothing and no other run writes them.

    `begun`: a recorder writes them already, for the operator before this one.

    Attributes
    ----------
    path
        The complete recording; until it is complete, the recorder writes `part`.
    salvaged
        Recordings recovered from the parts that killed runs left in the same folder.
    logs
        Folder with the log of every process; removed at the end if all logs are empty.
    state
        Folder with the UAVs' promises and airframes; removed at the end.
    """

    def __init__(self, path: Path, *, force: bool, begun: bool = False) -> None:
        path = through_links(path)
        if not begun:
            check_output(path, force=force)
        self.path = path
        self.part = path.with_name(path.name + PART)
        self.logs = path.with_name(path.name.removesuffix(SUFFIX) + ".logs")
        self.state = self.logs / "state"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.salvaged = salvage_parts(path.parent)
            self._lock = _claimed(self.part, os.O_RDWR | (0 if begun else os.O_CREAT | os.O_EXCL))
            shutil.rmtree(self.logs, ignore_errors=True)
            self.state.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise InputError("--out", str(path), f"a file that no other run is writing ({self.part.name})") from None
        except OSError as error:
            raise InputError("--out", str(path), f"in a folder that can be written ({_why(error)})") from None

    def __enter__(self) -> Output:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self.state, ignore_errors=True)
        _remove_empty_logs(self.logs)
        if self.part.exists() and self.part.stat().st_size == 0:
            self.part.unlink()
        os.close(self._lock)

    def log(self, name: str) -> Path:
        """Return the path of the log file of the process `name`."""
        return self.logs / f"{name}.log"

    def tail(self, name: str, lines: int = 8) -> str:
        """Return the last lines of the log of the process `name`, "" if there are none."""
        return log_tail(self.log(name), lines)

    def recover_part(self) -> list[str]:
        """Recover the recording of a recorder that died; return what is missing, one line each."""
        try:
            missing = write_recovered(self.part, self.path)
        except RecordingError as error:
            if Path(error.path) != self.path:
                raise
            raise self.cannot_write(error.reason) from None
        except InputError as error:
            cause = error.__context__
            raise self.cannot_write(_why(cause) if isinstance(cause, OSError) else error.allowed) from None
        self.part.unlink()
        return missing

    def cannot_write(self, reason: str) -> InputError:
        """Return the error that names the folder, and the part that holds the messages recorded so far."""
        kept = f"; edc-swarm recover {self.part} -o FILE.mcap, on another disk, makes a recording of what there is"
        allowed = f"in a folder that can be written: {self.part.parent.resolve()}: {reason}"
        return InputError("--out", str(self.path), allowed + (kept if self.part.exists() else ""))


def log_tail(log: Path, lines: int = 8) -> str:
    """Return the last lines of a log, "" if there are none."""
    try:
        return "\n".join(log.read_text(errors="replace").splitlines()[-lines:])
    except OSError:
        return ""


def default_output(name: str, planner: str, which: str) -> Path:
    """Return `recordings/NAME-PLANNER-WHICH.mcap`, with a number if that name is taken."""
    stem = f"{name}-{planner.rpartition(':')[2]}-{which}"
    for number in range(1, 1000):
        path = FOLDER / (f"{stem}{SUFFIX}" if number == 1 else f"{stem}-{number}{SUFFIX}")
        if not path.exists() and not path.with_name(path.name + PART).exists():
            return path
    raise InputError("--out", str(FOLDER / stem), "given: every default name is taken")


def timestamp() -> str:
    """Return the local time as text for a file name."""
    return time.strftime("%Y%m%d-%H%M%S")


def check_output(path: Path, *, force: bool) -> None:
    """Raise `InputError` if writing a recording at `path` would overwrite something."""
    check_new(path, SUFFIX, force=force)


def check_new(path: Path, suffix: str, *, force: bool) -> None:
    """Raise `InputError` unless a file of this kind can be written at `path` without overwriting something."""
    if path.suffix != suffix:
        raise InputError("--out", str(path), f"a name that ends in {suffix}")
    try:
        os.fsencode(path).decode()
        os.fsencode(path.absolute()).decode()
    except UnicodeDecodeError:
        raise InputError("--out", str(path), "a path in UTF-8, folders included") from None
    except FileNotFoundError:
        raise InputError("--out", str(path), "an absolute path, since the working folder was removed") from None
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError("--out", str(path), f"a path that can be written ({_why(error)})") from None
    if not stat.S_ISREG(mode):
        raise InputError("--out", str(path), f"a regular file, not {'a folder' if stat.S_ISDIR(mode) else 'a device'}")
    if not force:
        raise InputError("--out", str(path), "a new file (or give --force)")


def through_links(path: Path) -> Path:
    """Return the target of `path` if it is a symbolic link, else `path`: a write replaces the target, not the link."""
    return Path(os.path.realpath(path)) if os.path.islink(path) else path


def unusable(error: OSError) -> SwarmError:
    """Return the error for a refused system call: one line with the file and, if there is one, a remedy."""
    named = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, (str, bytes)) else ""
    return SwarmError(f"{named}{_why(error)}")


def unwritten(option: str, path: Path, error: OSError) -> InputError:
    """Return the error for a file at `path` that cannot be written."""
    return InputError(option, str(path), f"where it can be written ({_why(error)})")


def salvage_parts(folder: Path) -> list[Path]:
    """Recover the parts that killed runs left in `folder`; keep the originals as NAME.mcap.part.torn.

    A locked part belongs to a run in progress, which may still be starting; it stays untouched.
    """
    return [found for part in sorted(folder.glob(f"*{SUFFIX}{PART}")) if (found := _salvage(part)) is not None]


def recovered_name(part: Path) -> Path:
    """Return NAME.recovered.mcap, beside NAME.mcap.part or NAME.mcap."""
    return part.with_name(part.name.removesuffix(PART).removesuffix(SUFFIX) + ".recovered" + SUFFIX)


def is_same_file(path: Path, other: Path) -> bool:
    """Return True if both paths lead to one existing file."""
    try:
        return path.samefile(other)
    except OSError:
        return False


@contextmanager
def held_for_writing(part: Path, *, keep: bool = False) -> Iterator[BinaryIO]:
    """Open `part` and lock it, so that no other run recovers it. The caller renames it before the lock ends.

    The run that claimed `part` holds the same lock, shared, so the part is safe even if one of the two has died.

    Raises
    ------
    InputError
        The file cannot be written; it is then removed.
    OSError
        With `keep`: the file cannot be written; it stays, since it can be recovered.
    """
    try:
        with part.open("r+b") as stream:
            fcntl.flock(stream, fcntl.LOCK_SH)
            yield stream
    except OSError as error:
        if keep:
            raise
        part.unlink(missing_ok=True)
        raise unwritten("--out", part.with_name(part.name.removesuffix(PART)), error) from None


@contextmanager
def locked_for_reading(part: Path) -> Iterator[None]:
    """Lock `part`, so that no run begins to write it meanwhile.

    Raises
    ------
    RecordingError
        The file cannot be opened, or a run in progress is writing it.
    """
    try:
        with open_regular(part) as held:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
    except BlockingIOError:
        raise RecordingError(part, "is being written by a run in progress") from None
    except OSError as error:
        raise RecordingError(part, f"cannot be read: {_why(error)}") from None


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """Yield a temporary file that becomes `path` once the caller has written it completely.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    path = through_links(path)
    unfinished = path.with_name(path.name + ".tmp")
    try:
        with unfinished.open("wb") as stream:
            yield stream
        unfinished.replace(path)
    except OSError as error:
        raise unwritten("--out", path, error) from None
    finally:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)


def write_recovered(part: Path, whole: Path) -> list[str]:
    """Recover `part` as the recording `whole`; return what is missing, one line each."""
    with new_file(whole) as stream:
        return recover(part, stream)


def _claimed(part: Path, flags: int) -> int:
    """Open `part` and lock it, and return its descriptor: until it is closed, no other run recovers the part."""
    while True:
        descriptor = os.open(part, flags, 0o644)
        fcntl.flock(descriptor, fcntl.LOCK_SH)
        # Between the two calls another run may have taken the new file for one that a killed run has left.
        with suppress(FileNotFoundError):
            if os.fstat(descriptor).st_ino == part.stat().st_ino:
                return descriptor
        os.close(descriptor)


def _salvage(part: Path) -> Path | None:
    whole = recovered_name(part)
    try:
        with locked_for_reading(part):
            if part.stat().st_size == 0:
                part.unlink()
                return None
            if not whole.exists():
                with suppress(SwarmError):
                    write_recovered(part, whole)
            part.rename(part.with_name(part.name + TORN))
    except RecordingError:
        return None
    return whole if whole.exists() else None


def _remove_empty_logs(logs: Path) -> None:
    for log in logs.glob("*.log"):
        if log.stat().st_size == 0:
            log.unlink()
    if logs.exists() and not any(logs.iterdir()):
        logs.rmdir()


def _why(error: OSError) -> str:
    why = (error.strerror or str(error)).lower()
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        why += ": free some of that disk, or write to another one"
    return why
