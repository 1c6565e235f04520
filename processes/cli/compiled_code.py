"""The folder of the compiled planner: beside the package, else in the user's cache, else a temporary one."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import edc_swarm.planner
from edc_swarm.planner.machine_code import library_path
from processes.runtime.console import note

VARIABLE = "NUMBA_CACHE_DIR"
"""Environment variable with the folder that Numba tries first; child processes inherit it."""


def choose_code_folder() -> None:
    """Choose a folder that takes compiled code, and note it on standard error if it is no usual one."""
    if library_path().is_file():
        return
    given = os.environ.get(VARIABLE, "")
    usual = [given] if given else [str(Path(edc_swarm.planner.__file__).parent / "__pycache__"), _user_cache()]
    if any(map(_takes_files, usual)):
        return
    own, reason = _temporary_folder(), f"{' and '.join(usual)} cannot be written"
    if own is not None:
        os.environ[VARIABLE] = str(own)
        note(f"note: the compiled planner is kept in {own}, since {reason}")
    else:
        note(f"note: the planner is compiled anew at every start, since {reason} and neither can a temporary folder")


def _temporary_folder() -> Path | None:
    """Return a temporary folder to which only this user can write, or None."""
    try:
        own = Path(tempfile.gettempdir()) / f"edc-swarm-compiled-{os.getuid()}"
    except OSError:
        return None
    return own if _is_ours(own) and _takes_files(str(own)) else None


def _user_cache() -> str:
    """Return Numba's folder for this user."""
    base = os.environ.get("XDG_CACHE_HOME", "") or str(Path(os.path.expanduser("~")) / ".cache")
    return str(Path(base) / "numba")


def _takes_files(folder: str) -> bool:
    """Return True if a file can be made there: access rights do not reveal a read-only disk."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_ours(folder: Path) -> bool:
    """Make the folder if needed; return True if nobody else can put code there, since this process runs it."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
