"""What several checkers need of a recording, gathered once."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from edc_swarm.messages import Command, Fix, MissionMessage, Report, roster_index
from edc_swarm.recording import Gap, Recording, find_gaps
from edc_swarm.recording.tracks import Tracks, tracks_of

PLANNED = frozenset({"planned", "no-qp-needed", "failed"})


@dataclass(frozen=True, slots=True)
class Evidence:
    """A recording with its tracks.

    Attributes
    ----------
    index
        Roster position by id.
    fixes
        By UAV, in the order of the record (roster UAVs only).
    commands
        By UAV and slot.
    plans
        Reports that say that a plan was made.
    """

    recording: Recording
    mission: MissionMessage
    index: dict[str, int]
    tracks: Tracks
    fixes: dict[str, list[Fix]]
    commands: dict[tuple[str, int], list[Command]]
    plans: list[Report]
    gaps: list[Gap]

    def time_s(self, slot: int, share: float = 0.0) -> float:
        """Mission time at a share of a slot."""
        return (slot + share) * self.mission.dt_s

    def fixes_lost(self) -> set[str]:
        """UAVs of whose fixes some are missing from the record: what they granted there is unknown."""
        return {
            uav for uav in self.index if any(gap.key == f"uav/{uav}/fix" and not gap.duplicate for gap in self.gaps)
        }

    def command_lost(self, fix: Fix) -> bool:
        """Whether the command that `fix` names is missing from the record, as its number says."""
        return any(
            gap.key.endswith(f"/command/{fix.uav}") and gap.first <= fix.command_seq <= gap.last
            for gap in self.gaps
            if not gap.duplicate
        )

    def gap_notes(self) -> list[str]:
        """A warning where what looks broken may only be missing from the record."""
        return ["the record has gaps (see G5): what is missing here may have been said"] if self.gaps else []


def gather(recording: Recording) -> Evidence:
    """Evidence of a recording."""
    index = roster_index(recording.mission.roster)
    fixes: dict[str, list[Fix]] = {uav: [] for uav in index}
    for fix in recording.fixes:
        if fix.uav in fixes:
            fixes[fix.uav].append(fix)
    commands: dict[tuple[str, int], list[Command]] = defaultdict(list)
    for command in recording.commands:
        commands[command.uav, command.slot].append(command)
    return Evidence(
        recording=recording,
        mission=recording.mission,
        index=index,
        tracks=tracks_of(recording),
        fixes=fixes,
        commands=dict(commands),
        plans=[report for report in recording.reports if report.status in PLANNED],
        gaps=find_gaps(recording),
    )
