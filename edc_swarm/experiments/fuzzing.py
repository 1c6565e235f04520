"""The fuzzer: random missions under random fault schedules, with every guarantee checked.

A run is a function of its seed: `scenario(seed)` draws a mission and a schedule, `fly` simulates it and returns the
violations. `smallest` drops faults one by one while a violation remains.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.breaches import breaches
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.inside import MEMORY_SLOTS
from edc_swarm.analysis.guarantees.progress import PROGRESS
from edc_swarm.analysis.voyages import forgotten
from edc_swarm.experiments.fuzz_scenarios import (
    RECKLESS,
    scenario,
)
from edc_swarm.geometry import DISC_TOLERANCE_M, Floats, segment_distance_m
from edc_swarm.mission.braking import braked, change_of
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.faults import ChangeGps, WeakMotor, parse_faults
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.vehicle_budget import budget_of, vehicle_of
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.computers import Motion
from edc_swarm.simulation.simulator import Simulation

CHECKED = ("G1", "G2", "G3", "G4", "G5", "G8")
"""Guarantees that are checked with every planner; `PROGRESS` only with one that completes missions."""
RESTS_M = 0.05
"""Distance from the waypoint, beside what wind explains, at which a UAV rests by its own fixes."""


@dataclass(frozen=True, slots=True)
class Counterexample:
    """A run that violates a guarantee: its seed, the indices of its faults, and the violations."""

    seed: int
    kept: tuple[int, ...]
    broken: tuple[str, ...]
    clusters: bool = False

    @property
    def command(self) -> str:
        """The command line that repeats this run."""
        kept = ",".join(str(index) for index in self.kept)
        clusters = " --clusters" if self.clusters else ""
        return f"edc-swarm fuzz --seed {self.seed} --runs 1 --keep {kept or 'none'}{clusters}"


def fly(mission: Mission) -> list[str]:
    """Simulate a mission, and return one line for each violation and each guarantee that could not be judged."""
    message = mission_message(complete_mission(mission))
    said: list[Message] = []
    simulation = Simulation(
        message, lambda: make_planner(mission.planner, message), lambda _key, said_now, _ns: said.append(said_now)
    )
    try:
        end = simulation.run()
    except AssertionError as error:
        return [f"assertion: {error}"]
    motions = with_braking(message, end.motions)
    seen = [*overlaps(message, motions, end.stepped_slot), *trespasses(message, motions)]
    recording = Recording.from_messages(said)
    return [*seen, *errors_ignored(recording), *_broken(recording, _asked(mission))]


def search(seed: int, kept: Collection[int] | None = None, *, clusters: bool = False) -> Counterexample | None:
    """Run the scenario of `seed`, with several `clusters` if asked; return None if every guarantee held."""
    mission = scenario(seed, kept, clusters=clusters)
    broken = fly(mission)
    if not broken:
        return None
    indices = tuple(sorted(kept)) if kept is not None else tuple(range(len(mission.fault)))
    return Counterexample(seed, indices, tuple(broken), clusters)


def smallest(finding: Counterexample) -> Counterexample:
    """Drop faults one by one while a violation remains, and return the smallest such run."""
    index = 0
    while index < len(finding.kept):
        kept = finding.kept[:index] + finding.kept[index + 1 :]
        fewer = search(finding.seed, kept, clusters=finding.clusters)
        if fewer is None:
            index += 1
        else:
            finding = fewer
    return finding


def with_braking(mission: MissionMessage, motions: Sequence[Motion]) -> list[Motion]:
    """Return the accepted steps with the steps of UAVs that brake after them, until each rests or accepts another."""
    following: dict[str, int] = {}
    flown: list[Motion] = []
    changes = {entry.uav: change_of(mission, entry) for entry in mission.roster}
    for motion in reversed(motions):
        step, slot = (motion.from_m, motion.to_m), motion.slot
        braking = [motion]
        while True:
            step, slot = braked(*step, changes[motion.uav]), slot + 1
            if step[0] == step[1] or slot >= following.get(motion.uav, slot + 1):
                break
            braking.append(Motion(slot, motion.uav, *step, late=motion.late))
        following[motion.uav] = motion.slot
        flown += reversed(braking)
    return flown[::-1]


def overlaps(mission: MissionMessage, motions: Sequence[Motion], stepped_slot: Mapping[str, int]) -> list[str]:
    """Return one line for each pair whose discs could overlap while flying `motions`, at any pace within each slot.

    The check compares the two segments flown in a slot as sets of points. The segment of the previous slot counts
    too with `lag_slots` 1, or if the UAV began it too late to finish it in time. A UAV that dies or freezes stays at
    the end of its last step, until the failsafe has taken it out of the airspace: `stepped_slot` has the slot of each
    UAV's last accepted step.
    """
    first, last = _paths(mission, motions)
    _take_away(mission, stepped_slot, first, last)
    before_first, before_last = first.copy(), last.copy()
    still = _still_flying(mission, motions, len(first))
    before_first[1:][still[:-1]], before_last[1:][still[:-1]] = first[:-1][still[:-1]], last[:-1][still[:-1]]
    r_m = np.array([entry.r_m for entry in mission.roster])
    i, j = np.triu_indices(len(r_m), 1)
    gap_m = np.minimum.reduce(
        [
            _gaps(first, last, first, last, i, j),
            _gaps(before_first, before_last, first, last, i, j),
            _gaps(first, last, before_first, before_last, i, j),
        ]
    )
    bad = np.argwhere(gap_m < r_m[i] + r_m[j] - DISC_TOLERANCE_M)
    ids = [entry.uav for entry in mission.roster]
    return [
        f"G3: {ids[i[pair]]} and {ids[j[pair]]} can come within {gap_m[slot, pair]:.6f} m in slot {slot}"
        for slot, pair in bad[:10]
    ]


def trespasses(mission: MissionMessage, motions: Sequence[Motion]) -> list[str]:
    """Return one line for each zone and UAV whose accepted steps break it, those of dying UAVs included."""
    if not motions:
        return []
    r_m = {entry.uav: entry.r_m for entry in mission.roster}
    p_m, q_m = (np.array([getattr(motion, end) for motion in motions]) for end in ("from_m", "to_m"))
    said: dict[tuple[str, str], str] = {}
    for zone in mission.zone:
        keep_m = np.array([r_m[motion.uav] * zone.keeps_disc for motion in motions])
        breach_m, _ = breaches(zone, p_m, q_m, keep_m)
        for row in np.flatnonzero(breach_m > DISC_TOLERANCE_M).tolist():
            uav, slot = motions[row].uav, motions[row].slot
            said.setdefault((zone.name, uav), f"G8: {uav} breaks {zone.name} by {breach_m[row]:.6f} m in slot {slot}")
    return list(said.values())[:10]


def errors_ignored(recording: Recording) -> list[str]:
    """Return one line for each UAV that knows its true position: its body rests where it is, not where GPS says.

    A controller brings the measured position to the waypoint. With a constant GPS error, only wind keeps the measured
    position of a UAV that rests from there. Other models of the error, and changes of it, are left out.
    """
    mission, said = recording.mission, list[str]()
    if mission.gps_model != "bias" or any(isinstance(f, ChangeGps | WeakMotor) for f in parse_faults(mission)):
        return []
    for entry in mission.roster:
        fixes = [fix for fix in recording.fixes if fix.uav == entry.uav and fix.voter]
        budget, waypoint, since = budget_of(mission, entry), None, 0
        if vehicle_of(mission, entry).is_ideal:
            continue
        for fix in fixes:
            if (at_m := (fix.waypoint_x_m, fix.waypoint_y_m)) != waypoint:
                waypoint, since = at_m, fix.slot
            off_m = math.dist((fix.x_m, fix.y_m), at_m)
            if fix.slot - since >= MEMORY_SLOTS and off_m > budget.gust_m + budget.between_m + RESTS_M:
                said.append(f"GPS: {entry.uav} rests {off_m:.2f} m from its waypoint by its own fix, slot {fix.slot}")
                break
    return said


def _take_away(mission: MissionMessage, stepped_slot: Mapping[str, int], *ways_m: Floats) -> None:
    """Set the places of every UAV to NaN, which is near nothing, from the slot in which its airspace is free."""
    failsafe = failsafe_of(mission)
    if failsafe is None:
        return
    for k, entry in enumerate(mission.roster):
        for way_m in ways_m:
            way_m[failsafe.free_slot(stepped_slot[entry.uav]) :, k] = np.nan


def _gaps(a: Floats, b: Floats, c: Floats, d: Floats, i: Any, j: Any) -> Floats:
    """Return the distances (slots, pairs) of the segments a-b of UAVs i from the segments c-d of UAVs j."""
    return segment_distance_m(a[:, i], b[:, i], c[:, j], d[:, j])


def _paths(mission: MissionMessage, motions: Sequence[Motion]) -> tuple[Floats, Floats]:
    """Return start and end points (slots, UAVs, 2) of the segment that each UAV flew in each slot."""
    index = {entry.uav: k for k, entry in enumerate(mission.roster)}
    starts = np.array([(entry.start_x_m, entry.start_y_m) for entry in mission.roster], dtype=np.float64)
    slots = max((motion.slot for motion in motions), default=0) + 2
    first = np.broadcast_to(starts, (slots, *starts.shape)).copy()
    last = first.copy()
    for motion in motions:
        k = index[motion.uav]
        first[motion.slot, k] = motion.from_m
        last[motion.slot, k] = motion.to_m
        first[motion.slot + 1 :, k] = last[motion.slot + 1 :, k] = motion.to_m
    return first, last


def _still_flying(mission: MissionMessage, motions: Sequence[Motion], slots: int) -> NDArray[np.bool_]:
    """Return (slots, UAVs) flags: True if the step of a slot may last into the next one."""
    index = {entry.uav: k for k, entry in enumerate(mission.roster)}
    still = np.full((slots, len(index)), bool(mission.lag_slots))
    for motion in motions:
        still[motion.slot, index[motion.uav]] |= motion.late
    return still


def _asked(mission: Mission) -> tuple[str, ...]:
    """Return the guarantees to check on a mission."""
    return CHECKED if mission.planner == RECKLESS else (*CHECKED, PROGRESS)


def _broken(recording: Recording, asked: Collection[str]) -> list[str]:
    """Return the violations of the given guarantees; a guarantee that could not be judged counts as one."""
    results = {result.guarantee: result for result in check(recording)}
    said: list[str] = []
    for result in map(results.__getitem__, asked):
        said += [f"{result.guarantee}: {found.text}" for found in result.violations[:5]]
        said += [] if result.judged else [f"{result.guarantee}: not judged: {'; '.join(result.notes)}"]
    return said + [f"{PROGRESS}: {fix.uav} forgot {course} in slot {fix.slot}" for fix, course in forgotten(recording)]
