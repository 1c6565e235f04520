"""Reading of regular files, and of no other kind: a pipe or a device may never end."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_regular(path: str | Path) -> BinaryIO:
    """Open the file at `path` for reading, without waiting.

    Raises
    ------
    OSError
        The file cannot be opened, or is no regular file; `strerror` says which.
    """
    file = open(path, "rb", opener=_open_without_waiting)  # noqa: SIM115  (the caller closes it)
    mode = os.fstat(file.fileno()).st_mode
    if stat.S_ISREG(mode):
        return file
    file.close()
    raise _not_regular(path, mode)


def read_regular(path: str | Path) -> bytes:
    """Read the whole regular file at `path`; raise `OSError` as `open_regular` does."""
    with open_regular(path) as file:
        return file.read()


def _open_without_waiting(path: str, flags: int) -> int:
    """Open a file without waiting: a plain `open` of a pipe waits for a writer."""
    mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode):
        raise _not_regular(path, mode)
    return os.open(path, flags | os.O_NONBLOCK)


def _not_regular(path: str | Path, mode: int) -> OSError:
    return OSError(errno.EINVAL, f"not a regular file: it is {KINDS.get(stat.S_IFMT(mode), 'something else')}", path)
