"""What `edc-swarm join` keeps on disk: its claimant's token, and the files of the UAVs that it flies."""

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
from edc_swarm.mission.configuration import RosterEntry
from processes.uav.state import create_state, has_state

FIELD = "--state"


class ClaimFolder:
    """A folder that makes whoever starts `join` with it again the same claimant. None: one that nobody will.

    Attributes
    ----------
    claimant
        The token, held by this process alone as long as it lives.
    """

    def __init__(self, path: Path | None) -> None:
        self._for_good = path is not None
        self._path = path if path is not None else Path(tempfile.mkdtemp(prefix="edc-swarm-"))
        try:
            self._path.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self._path / "claimant", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
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
        if not self._for_good:
            shutil.rmtree(self._path, ignore_errors=True)

    def state(self, mission: str) -> Path:
        """The folder of a mission's UAVs; those of other missions are removed."""
        folder = self._missions / mission
        for other in self._missions.glob("*"):
            if other != folder:
                shutil.rmtree(other, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def forget(self) -> None:
        """The mission is over: nobody needs what its UAVs have promised."""
        shutil.rmtree(self._missions, ignore_errors=True)

    @property
    def _missions(self) -> Path:
        return self._path / "missions"

    def _token(self) -> str:
        found = os.pread(self._file, 64, 0).decode(errors="replace")
        if re.fullmatch("[0-9a-f]{16}", found):
            return found
        made = secrets.token_hex(8)
        os.truncate(self._file, 0)
        os.pwrite(self._file, made.encode(), 0)
        return made


def make_state(folder: Path, entry: RosterEntry, *, begun: bool) -> None:
    """Make the files of a UAV that has none.

    Raises
    ------
    SwarmError
        The mission has begun: what the UAV has promised is lost, and must not be made up.
    """
    if has_state(folder, entry.uav):
        return
    if begun:
        raise SwarmError(f"the files of {entry.uav}, which has flown in this mission, are not in {folder}")
    create_state(folder, entry)
