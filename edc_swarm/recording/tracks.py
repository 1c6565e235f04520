"""Where every tracked disc and every UAV was in every slot, as far as the record tells.

A UAV publishes its waypoint in the fix of each slot; a slot without a fix is a slot in which it
stayed, unless its truth or its next fix shows that it had accepted a step and then said nothing
(a process can die between accepting a step and saying so). Fixes of a UAV that lost its memory
(`voter` false) say nothing about the disc, which stays where it was.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edc_swarm.errors import RecordingError
from edc_swarm.messages import Command, Truth, roster_index
from edc_swarm.recording.model import Recording

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Point = tuple[float, float]
MAX_CELLS = 100_000_000
"""Most UAV-slots that are examined."""
Moved = dict[tuple[int, int], bool]
"""By slot and UAV: whether the recorded truth moved."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step that was executed without a fix that says so, and the command that explains it."""

    uav: int
    slot: int
    command: Command


@dataclass(frozen=True, slots=True)
class Tracks:
    """Positions of K UAVs over S slots; in slot t everything moves straight from start to end.

    Attributes
    ----------
    uavs
        Ids in roster order.
    centre_m
        (S + 1, K, 2): the tracked disc's centre at the start of slot t and, in row t + 1, at its end.
    true_from_m, true_to_m
        (S, K, 2): true position at both ends of slot t; NaN where no truth of the UAV is recorded.
    heard, executed
        (S, K): whether a fix of the slot is recorded, and whether a command was executed in it.
    energy_j
        (S, K): battery at the slot's newest fix, NaN where there is none.
    silent
        Steps that no fix reports.
    """

    uavs: list[str]
    centre_m: Floats
    true_from_m: Floats
    true_to_m: Floats
    heard: Bools
    executed: Bools
    energy_j: Floats
    silent: list[Step]

    @property
    def slots(self) -> int:
        """Number of slots, S."""
        return len(self.heard)


def tracks_of(recording: Recording) -> Tracks:
    """Tracks of all UAVs of the mission, from slot 0 to the last slot with a fix or a truth.

    Raises
    ------
    RecordingError
        A message names a slot that no mission reaches: the arrays would not fit into memory.
    """
    roster = recording.mission.roster
    index = roster_index(roster)
    fixes = [f for f in recording.fixes if f.slot >= 0 and f.uav in index]
    truths = [t for t in recording.truths if t.slot >= 0 and t.uav in index]
    cells, true_cells = _cells(fixes, index), _cells(truths, index)
    slots = 1 + max(int(cells[0].max(initial=-1)), int(true_cells[0].max(initial=-1)))
    if slots * len(roster) > MAX_CELLS:
        raise RecordingError("recording", f"slot {slots - 1} is beyond what can be examined")
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
    silent = list(_silent_steps(recording, centre_m, executed))
    for step in silent:
        executed[step.slot, step.uav] = True
        centre_m[step.slot + 1, step.uav] = (step.command.target_x_m, step.command.target_y_m)
    _fill_forward(centre_m)
    true_from_m, true_to_m = _true_motion(truths, true_cells, centre_m)
    return Tracks(list(index), centre_m, true_from_m, true_to_m, heard, executed, energy_j, silent)


def _column(messages: Sequence[Any], name: str) -> Floats:
    return np.fromiter(map(attrgetter(name), messages), np.float64, len(messages))


def _cells(messages: Sequence[Any], index: dict[str, int]) -> tuple[Ints, Ints]:
    """Slot and UAV of every message; where several fall into one cell, numpy keeps the last."""
    uavs = (index[uav] for uav in map(attrgetter("uav"), messages))
    return _column(messages, "slot").astype(np.int64), np.fromiter(uavs, np.int64, len(messages))


def _points(messages: Sequence[Any], name: str) -> Floats:
    return np.stack([_column(messages, f"{name}_x_m"), _column(messages, f"{name}_y_m")], axis=-1)


def _fill_forward(centre_m: Floats) -> None:
    """Replace every NaN by the last point before it."""
    known = ~np.isnan(centre_m[..., 0])
    newest = np.maximum.accumulate(np.where(known, np.arange(len(centre_m))[:, None], 0))
    centre_m[:] = np.take_along_axis(centre_m, newest[..., None], axis=0)


def _true_motion(truths: list[Truth], cells: tuple[Ints, Ints], centre_m: Floats) -> tuple[Floats, Floats]:
    """True positions; where a slot has none, the disc's centre plus the UAV's first known offset."""
    starts_m, ends_m = centre_m[:-1], centre_m[1:]
    to_m = _points(truths, "to")
    offset_m = np.full(centre_m.shape[1:], np.nan)
    offset_m[cells[1][::-1]] = (to_m - ends_m[cells])[::-1]
    true_from_m, true_to_m = starts_m + offset_m, ends_m + offset_m
    true_from_m[cells] = _points(truths, "from")
    true_to_m[cells] = to_m
    return true_from_m, true_to_m


def _silent_steps(recording: Recording, centre_m: Floats, executed: Bools) -> Iterator[Step]:
    """Steps in slots without a (trustworthy) fix, for every UAV that has such slots."""
    unsaid = np.isnan(centre_m[1:, :, 0])
    if not unsaid.any():
        return
    index = roster_index(recording.mission.roster)
    commands: dict[tuple[int, int], list[Command]] = {}
    for command in recording.commands:
        if command.uav in index:
            commands.setdefault((command.slot, index[command.uav]), []).append(command)
    moved: Moved = {
        (t.slot, index[t.uav]): (t.from_x_m, t.from_y_m) != (t.to_x_m, t.to_y_m)
        for t in recording.truths
        if t.uav in index
    }
    for k in np.flatnonzero(unsaid.any(axis=0)):
        for first, after in _runs(unsaid[:, k]):
            yield from _explained(int(k), first, after, commands, moved, centre_m, executed)


def _runs(flags: Bools) -> Iterator[tuple[int, int]]:
    """First index of every run of true flags, and the index after it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _explained(
    k: int,
    first: int,
    after: int,
    commands: dict[tuple[int, int], list[Command]],
    moved: Moved,
    centre_m: Floats,
    executed: Bools,
) -> Iterator[Step]:
    """The commands of slots first..after-1 that UAV `k` must have flown to be where it is seen next.

    Walks through the slots with every point it can have reached; a recorded truth decides whether
    it moved in that slot, otherwise both are possible and staying is preferred.
    """
    earlier = centre_m[: first + 1, k]
    start = _point(earlier[np.flatnonzero(~np.isnan(earlier[:, 0]))[-1]])
    paths: dict[Point, tuple[Step, ...]] = {start: ()}
    for slot in range(first, after):
        paths = _advanced(paths, k, slot, commands.get((slot, k), []), moved.get((slot, k)))
    if after == len(executed):
        yield from next(iter(paths.values()))
        return
    seen = _point(centre_m[after + 1, k])
    for point, path in paths.items():
        flown = (c for c in commands.get((after, k), []) if (c.start_x_m, c.start_y_m) == point)
        ends = [(c.target_x_m, c.target_y_m) for c in flown] if executed[after, k] else [point]
        if seen in ends:
            yield from path
            return


def _advanced(
    paths: dict[Point, tuple[Step, ...]], k: int, slot: int, commands: list[Command], moved: bool | None
) -> dict[Point, tuple[Step, ...]]:
    reached = {} if moved else dict(paths)
    if moved is False:
        return reached
    for command in commands:
        end = (command.target_x_m, command.target_y_m)
        path = paths.get((command.start_x_m, command.start_y_m))
        if path is not None:
            reached.setdefault(end, (*path, Step(k, slot, command)))
    return reached or paths


def _point(xy_m: Floats) -> Point:
    return float(xy_m[0]), float(xy_m[1])
