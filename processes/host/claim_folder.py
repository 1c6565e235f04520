"""The folder of `edc-swarm join`: its claimant's token, and the state files of its UAVs."""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
import tempfile
from pathlib import Path
from types import TracebackType

from edc_swarm.errors import InputError, SwarmError
from edc_swarm.mission.roster_entry import RosterEntry
from processes.uav.state import create_state, has_state

FIELD = "--state"


class ClaimFolder:
    """A folder that identifies a claimant: `join` with the same folder is the same claimant again.

    Without a `path` it is a temporary folder, which the end of the command removes.

    Attributes
    ----------
    path
        The folder.
    claimant
        The token; a lock on its file keeps other processes from using it at the same time.
    """

    def __init__(self, path: Path | None) -> None:
        self._permanent = path is not None
        self.path = path if path is not None else Path(tempfile.mkdtemp(prefix="edc-swarm-"))
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self.path / "claimant", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(FIELD, str(path), "a folder that no other join uses") from None
        except OSError as error:
            allowed = f"a folder that can be written ({(error.strerror or str(error)).lower()})"
            raise InputError(FIELD, str(path), allowed) from None
        self.claimant = self._token()

    def __enter__(self) -> ClaimFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._file)
        if not self._permanent:
            shutil.rmtree(self.path, ignore_errors=True)

    def state(self, mission: str) -> Path:
        """Return the folder for the UAVs of a mission; remove the folders of other missions."""
        folder = self._missions / mission
        for other in self._missions.glob("*"):
            if other != folder:
                shutil.rmtree(other, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def forget(self) -> None:
        """Remove the state files after the mission: no UAV needs its promise any more."""
        shutil.rmtree(self._missions, ignore_errors=True)

    @property
    def _missions(self) -> Path:
        return self.path / "missions"

    def _token(self) -> str:
        found = os.pread(self._file, 64, 0).decode(errors="replace")
        if re.fullmatch("[0-9a-f]{16}", found):
            return found
        made = secrets.token_hex(8)
        os.truncate(self._file, 0)
        os.pwrite(self._file, made.encode(), 0)
        return made


def ensure_state(folder: Path, entry: RosterEntry, *, begun: bool) -> None:
    """Create the state files of a UAV that has none.

    Raises
    ------
    SwarmError
        The UAV has no files although the mission has begun: its promise is lost, and must not be invented.
    """
    if has_state(folder, entry.uav):
        return
    if begun:
        raise SwarmError(f"the files of {entry.uav}, which has flown in this mission, are not in {folder}")
    create_state(folder, entry)
