"""Tracks: the place of every tracked disc and every UAV in every slot, reconstructed from a recording.

A UAV publishes its waypoint in the fix of each slot. In a slot without a fix it held (with inertia: it braked), unless
its truth or its next fix shows that it executed a step: a process can die after it accepts a step and before it
publishes the fix. The fixes of a UAV that lost its memory (`voter` false) are no evidence on its disc; its truths are,
since disc and UAV move by the same vector. If the recording lacks fixes (for example because the recorder was frozen)
and no command explains the waypoint of the next fix, the slots between are `lost`: nothing is judged there.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from edc_swarm.analysis.autopilots import stray_slots
from edc_swarm.analysis.true_paths import have_inertia, parts_of, tells_path
from edc_swarm.errors import RecordingError
from edc_swarm.mission.braking import Point, braked, change_of
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.protocol.messages import Command, Fix, Truth, roster_index
from edc_swarm.recording.model import Recording

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
MAX_UAV_SLOTS = 100_000_000
"""Most UAV-slots of a recording that can be analysed."""
TRUTH_TOLERANCE_M = 1e-9
Motion = tuple[Point, Point]
"""Start and end of a step."""
Cell = tuple[int, int]
"""Slot and UAV."""


@dataclass(frozen=True, slots=True)
class Step:
    """An executed step that no fix reports, with the commands that explain it; all of them order the same motion."""

    uav: int
    slot: int
    commands: tuple[Command, ...]

    @property
    def command(self) -> Command:
        """One of the commands."""
        return self.commands[0]


@dataclass(frozen=True, slots=True)
class Tracks:
    """Positions of K UAVs over S slots; in slot t each UAV moves straight from start to end.

    Attributes
    ----------
    uavs
        Ids in roster order.
    centre_m
        (S + 1, K, 2): the tracked disc's centre at the start of slot t and, in row t + 1, at its end.
        In `lost` slots it is interpolated linearly between the last known and the next known place.
    true_from_m, true_to_m
        (S, K, 2): true position at both ends of slot t; NaN where no truth of the UAV is recorded.
    heard, executed
        (S, K): True where a fix of the slot is recorded; True where a command was executed in it.
    energy_j
        (S, K): battery at the slot's newest fix, NaN where there is none.
    silent
        Steps that no fix reports.
    lost
        (S, K): True where the fix of the slot is missing from the recording and the motion is unknown.
    grounded
        (S, K): True where the failsafe has taken the UAV out of the airspace, or a stray says that it is on the ground.
    astray
        (S, K): True where the UAV strays: it has no disc any more.
    """

    uavs: list[str]
    centre_m: Floats
    true_from_m: Floats
    true_to_m: Floats
    heard: Bools
    executed: Bools
    energy_j: Floats
    silent: list[Step]
    lost: Bools
    grounded: Bools
    astray: Bools

    @property
    def slots(self) -> int:
        """Number of slots, S."""
        return len(self.heard)

    @property
    def seen_m(self) -> tuple[Floats, Floats]:
        """(S, K, 2) centres at both ends of every slot, for use in verdicts: NaN where lost, stray or grounded."""
        return self._where(~(self.lost | self.astray | self.grounded), self.centre_m[:-1], self.centre_m[1:])

    @property
    def bodies_m(self) -> tuple[Floats, Floats]:
        """(S, K, 2) true positions at both ends of every slot: NaN where unknown, or out of the airspace."""
        return self._where(~self.grounded, self.true_from_m, self.true_to_m)

    @staticmethod
    def _where(known: Bools, from_m: Floats, to_m: Floats) -> tuple[Floats, Floats]:
        if known.all():
            return from_m, to_m
        return np.where(known[..., None], from_m, np.nan), np.where(known[..., None], to_m, np.nan)


def tracks_of(recording: Recording, unrecorded: Collection[str] = ()) -> Tracks:
    """Return the tracks of all UAVs of the mission, from slot 0 to the last slot with a fix or a truth.

    The recording may lack commands of the UAVs in `unrecorded`, and so explain no step before a process starts again.

    Raises
    ------
    RecordingError
        A message names a slot so late that the arrays would not fit into memory.
    """
    roster = recording.mission.roster
    index = roster_index(roster)
    fixes = [f for f in recording.fixes if f.slot >= 0 and f.uav in index]
    inertia, parts = have_inertia(recording.mission), parts_of(recording.mission)
    truths = [t for t in recording.truths if t.slot >= 0 and t.uav in index]
    truths = [t for t in truths if not inertia[index[t.uav]] or tells_path(t, parts)]
    cells, true_cells = _cells(fixes, index), _cells(truths, index)
    slots = 1 + max(int(cells[0].max(initial=-1)), int(true_cells[0].max(initial=-1)))
    if slots * len(roster) > MAX_UAV_SLOTS:
        raise RecordingError("recording", f"has a slot {slots - 1}, beyond the longest mission that can be analysed")
    shape = (slots, len(roster))
    heard, executed, energy_j = np.zeros(shape, bool), np.zeros(shape, bool), np.full(shape, np.nan)
    heard[cells] = True
    energy_j[cells] = _column(fixes, "energy_j")
    flying = _column(fixes, "executing") > 0
    executed[cells[0][flying], cells[1][flying]] = True
    centre_m = np.full((slots + 1, len(roster), 2), np.nan)
    centre_m[0] = np.array([(entry.start_x_m, entry.start_y_m) for entry in roster]).reshape(-1, 2)
    voters = [f for f in fixes if f.voter]
    slot, uav = _cells(voters, index)
    centre_m[slot + 1, uav] = _points(voters, "waypoint")
    change_m = [change_of(recording.mission, entry) for entry in roster]
    began_m = np.full((*shape, 2), np.nan)
    began_m[slot, uav] = _points(voters, "from")
    silent = list(_silent_steps(recording, truths, true_cells, centre_m, began_m, executed, change_m))
    for step in silent:
        executed[step.slot, step.uav] = True
        began_m[step.slot, step.uav] = (step.command.start_x_m, step.command.start_y_m)
        centre_m[step.slot + 1, step.uav] = (step.command.target_x_m, step.command.target_y_m)
    unsaid = np.isnan(centre_m[1:, :, 0])
    _fill_forward(centre_m, began_m, change_m)
    lost = _bridged(_after_holes(voters, unrecorded), index, unsaid, centre_m, change_m)
    true_from_m, true_to_m = _true_motion(truths, true_cells, centre_m)
    untold = lost | inertia  # Of a vehicle with inertia, the disc does not tell the place.
    untold[true_cells] = False
    true_from_m[untold] = true_to_m[untold] = np.nan
    for t, k in _flown_before_birth(executed & ~inertia, truths, index):
        true_from_m[t, k] = true_to_m[t, k] - (centre_m[t + 1, k] - centre_m[t, k])
    astray, down = stray_slots(fixes, index, shape)
    grounded = np.where(astray.any(axis=0), down, _grounded(recording, executed, heard))
    return Tracks(
        list(index), centre_m, true_from_m, true_to_m, heard, executed, energy_j, silent, lost, grounded, astray
    )


def last_slots(flags: Bools) -> Ints:
    """Return (K,) the last slot of (S, K) flags that is true, -1 for none."""
    slots = np.arange(len(flags))[:, None]
    last: Ints = np.max(np.where(flags, slots, -1), axis=0, initial=-1)
    return last


def stepped_slots(recording: Recording, executed: Bools, heard: Bools) -> Ints:
    """Return (K,) the slot of each UAV's last accepted step, -1 for none.

    A UAV that is silent may have accepted a command for the slot after its newest fix, which then counts, unless that
    fix grants a newer term: the UAV has then discarded the command.
    """
    index, stepped, newest = roster_index(recording.mission.roster), last_slots(executed), last_slots(heard)
    term = np.full(len(index), -1)
    for fix in recording.fixes:
        k = index.get(fix.uav, -1)
        if k >= 0 and fix.slot == newest[k]:
            term[k] = max(term[k], fix.term)
    for command in recording.commands:
        k = index.get(command.uav, -1)
        if k >= 0 and command.slot == newest[k] + 1 and command.term >= term[k]:
            stepped[k] = max(stepped[k], command.slot)
    return stepped


def _grounded(recording: Recording, executed: Bools, heard: Bools) -> Bools:
    failsafe = failsafe_of(recording.mission)
    if failsafe is None or not len(executed):
        return np.zeros_like(executed)
    free = np.array([failsafe.free_slot(slot) for slot in stepped_slots(recording, executed, heard).tolist()])
    grounded: Bools = np.arange(len(executed))[:, None] >= free
    return grounded


def _column(messages: Sequence[Any], name: str) -> Floats:
    return np.fromiter(map(attrgetter(name), messages), np.float64, len(messages))


def _cells(messages: Sequence[Any], index: dict[str, int]) -> tuple[Ints, Ints]:
    """Return slots and UAVs of all messages as indices; of several messages in one cell numpy keeps the last."""
    uavs = (index[uav] for uav in map(attrgetter("uav"), messages))
    return _column(messages, "slot").astype(np.int64), np.fromiter(uavs, np.int64, len(messages))


def _points(messages: Sequence[Any], name: str) -> Floats:
    return np.stack([_column(messages, f"{name}_x_m"), _column(messages, f"{name}_y_m")], axis=-1)


def _fill_forward(centre_m: Floats, began_m: Floats, change_m: Sequence[float]) -> None:
    """Replace every NaN with the place of a UAV that holds, or that brakes by its step change (K,)."""
    for k in np.flatnonzero(np.isfinite(change_m) & np.isnan(centre_m[..., 0]).any(axis=0)).tolist():
        for first, after in _runs(np.isnan(centre_m[:, k, 0])):
            step_m = _newest_step(k, first - 1, centre_m, began_m)
            for t in range(first, after):
                step_m = braked(*step_m, change_m[k])
                centre_m[t, k] = step_m[1]
                if step_m[0] == step_m[1]:
                    break
    known = ~np.isnan(centre_m[..., 0])
    newest = np.maximum.accumulate(np.where(known, np.arange(len(centre_m))[:, None], 0))
    centre_m[:] = np.take_along_axis(centre_m, newest[..., None], axis=0)


def _bridged(
    fixes: Iterable[Fix], index: dict[str, int], unsaid: Bools, centre_m: Floats, change_m: Sequence[float]
) -> Bools:
    """Return (S, K) lost slots, and interpolate `centre_m` over each run of them up to the next fix."""
    lost = np.zeros_like(unsaid)
    for fix in fixes if unsaid.any() else ():
        k, after = index[fix.uav], fix.slot
        first = after
        while first > 0 and unsaid[first - 1, k]:
            first -= 1
        moves = fix.executing or math.isfinite(change_m[k])
        start_m = (fix.from_x_m, fix.from_y_m) if moves else (fix.waypoint_x_m, fix.waypoint_y_m)
        if _point(centre_m[after, k]) != start_m:
            lost[first:after, k] = True
            centre_m[first : after + 1, k] = np.linspace(centre_m[first, k], start_m, after - first + 1)
    return lost


def _after_holes(fixes: Sequence[Fix], unrecorded: Collection[str]) -> Iterator[Fix]:
    """Yield the fixes that follow a sequence gap of their process, or a former process of a UAV in `unrecorded`."""
    expected: dict[tuple[str, str], int] = {}
    for fix in fixes:
        stream = fix.uav, fix.instance
        if fix.seq > expected.get(stream, 0) or (fix.uav in unrecorded and stream not in expected):
            yield fix
        expected[stream] = max(fix.seq + 1, expected.get(stream, 0))


def _true_motion(truths: list[Truth], cells: tuple[Ints, Ints], centre_m: Floats) -> tuple[Floats, Floats]:
    """Return true positions; in a slot without a truth, the disc's centre plus the UAV's first known offset.

    Several truths in one slot (of a process and its successor) are one motion, from the first to the last.
    """
    starts_m, ends_m = centre_m[:-1], centre_m[1:]
    to_m = _points(truths, "to")
    offset_m = _offsets_m(to_m, cells, ends_m)
    true_from_m, true_to_m = starts_m + offset_m, ends_m + offset_m
    true_from_m[cells[0][::-1], cells[1][::-1]] = _points(truths, "from")[::-1]
    true_to_m[cells] = to_m
    return true_from_m, true_to_m


def _offsets_m(to_m: Floats, cells: tuple[Ints, Ints], ends_m: Floats) -> Floats:
    """Return (K, 2) offsets of each UAV from the centre of its disc in the first slot with both, else NaN."""
    offset_m = np.full(ends_m.shape[1:], np.nan)
    apart_m = to_m - ends_m[cells]
    known = ~np.isnan(apart_m[:, 0])
    offset_m[cells[1][known][::-1]] = apart_m[known][::-1]
    return offset_m


def _flown_before_birth(executed: Bools, truths: Sequence[Truth], index: dict[str, int]) -> set[Cell]:
    """Return (slot, UAV) of steps whose only truth is the first of a restarted process, from after the step."""
    born: set[tuple[str, str]] = set()
    tells: dict[Cell, bool] = {}
    for truth in truths:
        tells.setdefault((truth.slot, index[truth.uav]), (truth.uav, truth.instance) not in born)
        born.add((truth.uav, truth.instance))
    return {cell for cell, first in tells.items() if first and executed[cell]}


@dataclass(frozen=True, slots=True)
class _Sightings:
    """The truths and commands of one UAV in the slots without a fix that reports its disc."""

    commands: dict[int, list[Command]]
    disc_m: dict[int, Point]
    change_m: float

    def motion(self, start: Point, end: Point) -> Motion:
        """Return a step as the state from which the UAV brakes; a vehicle that stops at once has only a place."""
        return (end, end) if math.isinf(self.change_m) else (start, end)

    def agrees(self, slot: int, end: Point) -> bool:
        """Return True if the slot has no truth, or one that agrees with a disc that ends at `end`."""
        return slot not in self.disc_m or math.dist(self.disc_m[slot], end) <= TRUTH_TOLERANCE_M


def _silent_steps(
    recording: Recording,
    truths: list[Truth],
    cells: tuple[Ints, Ints],
    centre_m: Floats,
    began_m: Floats,
    executed: Bools,
    change_m: Sequence[float],
) -> Iterator[Step]:
    """Yield the steps in slots without a fix of a voter. `began_m`: where the disc was as a slot with a fix began."""
    unsaid = np.isnan(centre_m[1:, :, 0])
    if not unsaid.any():
        return
    index = roster_index(recording.mission.roster)
    runs = {k: list(_runs(unsaid[:, k])) for k in np.flatnonzero(unsaid.any(axis=0)).tolist()}
    wanted = {k: {slot for first, after in spans for slot in range(first, after + 1)} for k, spans in runs.items()}
    seen = {k: _Sightings({}, {}, change_m[k]) for k in runs}
    for command in recording.commands:
        k = index.get(command.uav, -1)
        if k in wanted and command.slot in wanted[k]:
            seen[k].commands.setdefault(command.slot, []).append(command)
    offset_m = _offsets_m(_points(truths, "to"), cells, centre_m[1:]).tolist()
    for i in np.flatnonzero(unsaid[cells]).tolist():
        truth, k = truths[i], int(cells[1][i])
        if truth.waypoint_x_m is not UNSET and truth.waypoint_y_m is not UNSET:
            seen[k].disc_m[truth.slot] = (truth.waypoint_x_m, truth.waypoint_y_m)
        elif not math.isnan(offset_m[k][0]):
            seen[k].disc_m[truth.slot] = (truth.to_x_m - offset_m[k][0], truth.to_y_m - offset_m[k][1])
    for k, sightings in seen.items():
        for first, after in runs[k]:
            yield from _explained(k, first, after, sightings, centre_m, began_m, executed)


def _runs(flags: Bools) -> Iterator[tuple[int, int]]:
    """Yield (first index, index after the last) of every run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _explained(
    k: int, first: int, after: int, sightings: _Sightings, centre_m: Floats, began_m: Floats, executed: Bools
) -> Iterator[Step]:
    """Yield the steps of slots first..after-1 that UAV `k` must have flown to reach its next known place.

    The search keeps the set of all points that the UAV can have reached, slot by slot. A recorded truth decides
    the place at the end of its slot; otherwise all points stay possible and holding is preferred.
    """
    paths: dict[Motion, tuple[Step, ...]] = {sightings.motion(*_newest_step(k, first, centre_m, began_m)): ()}
    for slot in range(first, after):
        paths = _advanced(paths, k, slot, sightings)
    if after == len(executed):
        yield from next(iter(paths.values()))
        return
    seen = _point(centre_m[after + 1, k])
    for motion, path in paths.items():
        flown = (c for c in sightings.commands.get(after, []) if (c.start_x_m, c.start_y_m) == motion[1])
        braking = [braked(*motion, sightings.change_m)[1]]
        ends = [(c.target_x_m, c.target_y_m) for c in flown] if executed[after, k] else braking
        if seen in ends:
            yield from path
            return


def _advanced(
    paths: dict[Motion, tuple[Step, ...]], k: int, slot: int, sightings: _Sightings
) -> dict[Motion, tuple[Step, ...]]:
    """Return the motions that the UAV can make in a slot; without a command, if none explains the recorded truth."""
    braking = {braked(*motion, sightings.change_m): path for motion, path in paths.items()}
    reached = {motion: path for motion, path in braking.items() if sightings.agrees(slot, motion[1])}
    ordered: dict[Motion, list[Command]] = {}
    for command in sightings.commands.get(slot, []):
        motion = (command.start_x_m, command.start_y_m), (command.target_x_m, command.target_y_m)
        ordered.setdefault(motion, []).append(command)
    for (start, end), commands in ordered.items():
        for motion, path in paths.items():
            if motion[1] == start and sightings.agrees(slot, end):
                reached.setdefault(sightings.motion(start, end), (*path, Step(k, slot, tuple(commands))))
    return reached or braking


def _newest_step(k: int, row: int, centre_m: Floats, began_m: Floats) -> Motion:
    """Return the step that led UAV `k` to its place in `row` of `centre_m`, by its own word; at the start none."""
    return _point(began_m[row - 1, k] if row else centre_m[0, k]), _point(centre_m[row, k])


def _point(xy_m: Floats) -> Point:
    return float(xy_m[0]), float(xy_m[1])
