"""Setup of one run: its mission, its files, and the parts that other hosts run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import zenoh

from edc_swarm.mission.configuration import Mission
from processes.operator.takeover import Takeover
from processes.runtime.clock import MissionClock
from processes.runtime.output import Output
from processes.runtime.voice import Voice


@dataclass(frozen=True, slots=True)
class View:
    """Views of the mission.

    Attributes
    ----------
    viz
        True for a view in the recording.
    live_port
        Port of the live view on this host; 0: no live view.
    ground
        Host and port of a ground station, None without one.
    commands
        True if the ground station may command, through the operator.
    """

    viz: bool = True
    live_port: int = 0
    ground: tuple[str, int] | None = None
    commands: bool = False


@dataclass(frozen=True, slots=True)
class Bus:
    """A bus on which others run router, recorder, visualiser and UAVs; `takeover`: a mission to continue."""

    endpoint: str
    session: zenoh.Session
    takeover: Takeover | None = None


@dataclass(frozen=True, slots=True)
class Protection:
    """A secured bus; `certs` is a folder made by `edc-swarm certs`, None for certificates of this run alone."""

    certs: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSetup:
    """Setup of one run. The last `remote` UAVs of the roster fly elsewhere; on a given `bus`, all of them do.

    `arm`: permission to arm the vehicles of autopilots.
    """

    mission: Mission
    output: Output
    listen: str | None
    view: View
    voice: Voice
    remote: int = 0
    bus: Bus | None = None
    protection: Protection | None = None
    arm: bool = False
    clock: MissionClock = field(default_factory=MissionClock)

    @property
    def takeover(self) -> Takeover | None:
        """The mission that this run continues, None for a new one."""
        return self.bus.takeover if self.bus is not None else None

    @property
    def protocol(self) -> str:
        """Protocol of the router's address."""
        return "tcp" if self.protection is None else "tls"

    @property
    def roster(self) -> list[str]:
        """Ids of all UAVs."""
        return [entry.uav for entry in self.mission.roster]

    @property
    def local(self) -> list[str]:
        """Ids of the UAVs that this host flies."""
        return [] if self.bus is not None else self.roster[: len(self.roster) - self.remote]

    @property
    def elsewhere(self) -> list[str]:
        """Ids of the UAVs that other hosts fly."""
        return self.roster[len(self.local) :]
