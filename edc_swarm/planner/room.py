"""Making room: UAVs that block each other between zones move aside, in an order in which each gets past the others.

Guidance looks 32 slots ahead and plans for one UAV at a time, so two UAVs that meet head-on in a lane wait for ever. A
UAV that comes no nearer to its goal for long, among others that come no nearer either, is *blocked*. It and the UAVs
about it, at most six, form a group. On a roadmap of places at which a UAV can wait (`roadmap`), A* over the places of
the whole group at once finds the moves, one UAV after another, that bring each of them to its goal, or past the others
to the edge of the roadmap (`room_kernel`). Within the roadmap the search is complete: it finds such moves if there are
any, unless its effort is spent first.

These moves are the group's *script*. A UAV need not wait for all earlier moves of others, only for those whose way
comes too near to its own next move. So the UAVs fly at once wherever they can, and do not block each other again. The
aim of guidance for each UAV is the farthest place of its script that it may fly to. Guidance and slot QP keep it apart
from all others on the way. A script ends when all its moves are flown, when a UAV of the group gets another goal or is
unheard, or when no move ends for long; then the next one has a larger group or another roadmap.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from edc_swarm.geometry import Floats, Indices, length_m, segment_distance_m
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.mission.zone import Zone
from edc_swarm.mission.zones import barriers
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner import room_kernel, ways
from edc_swarm.planner.charts import Charts
from edc_swarm.planner.roadmap import Box, Roadmap, roadmap
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M

BLOCKED_SLOTS = 24
"""Slots without progress after which a UAV is blocked."""
WAITING_SLOTS = 12
"""Slots without progress of all UAVs of a group; in a queue whose first one moves nobody is blocked."""
PAUSE_SLOTS = 8
"""Slots from a search that finds nothing to the next one for the same UAV."""
SCRIPT_SLOTS = 32
"""Slots in which no move of a script ends before it is given up."""
EXPANSIONS = 20_000
SEARCHES = 3
"""Limits on the expansions and on the searches in one slot; those left over follow in the next slots."""
MOST_MOVES = 1000
MOST_UAVS = 6
SPACINGS = (3.0, 6.0, 1.5)
"""Shares of the least distance of two UAVs that are the spacing of a roadmap, in the order in which they are tried."""
BEYOND = 8.0
"""Distance of the farthest UAVs of a group from those in contact, in radii."""
REACHED = 0.2
"""Distance from a place at which a UAV has reached it, in its longest steps."""
MAP_SPARE_M = 1e-3


@dataclass
class Script:
    """The moves of a group, in an order in which they can be flown one after another.

    `uav` (n,) and `goal_m` (n, 2) are the group's; UAV `uav[moved[q]]` flies move q from `from_m[q]` to `to_m[q]`,
    and only after the moves `after[q]`. `moves[k]` are the numbers of the moves of UAV k, of which it has flown
    `flown[k]`.
    """

    uav: Indices
    goal_m: Floats
    apart_m: Floats
    moved: Indices
    from_m: Floats
    to_m: Floats
    after: list[Indices]
    moves: list[Indices]
    flown: list[int]
    begun_slot: int

    @property
    def ended(self) -> bool:
        """True if all moves are flown."""
        return all(flown == len(moves) for flown, moves in zip(self.flown, self.moves, strict=True))

    def allowed(self, k: int) -> Indices:
        """Return the next moves of UAV k that it may fly now."""
        moves = self.moves[k]
        end = self.flown[k]
        while end < len(moves) and all(self._is_flown(q) for q in self.after[moves[end]]):
            end += 1
        return moves[self.flown[k] : end]

    def _is_flown(self, q: int) -> bool:
        k = self.moved[q]
        return bool(self.moves[k][: self.flown[k]].size and self.moves[k][self.flown[k] - 1] >= q)


@dataclass
class _Watch:
    """Progress of one UAV: its least way so far, since which slot, to which goal; and how often room was made."""

    way_m: float
    slot: int
    goal: tuple[float, float]
    tries: int = 0
    size: int = 1

    def waits(self, slot: int) -> bool:
        """Return True if the UAV is at its goal, or has come no nearer to it for a while."""
        return self.way_m < ARRIVED_M or slot - self.slot >= WAITING_SLOTS


@dataclass
class Room:
    """The scripts of a mission, and the progress of its UAVs by roster index."""

    charts: Charts
    u_max_m: Floats
    watches: dict[int, _Watch] = field(default_factory=dict)
    scripts: list[Script] = field(default_factory=list)

    def aims(
        self, slot: int, uav: Indices, position_m: Floats, goal_m: Floats, first_m: Floats, way_m: Floats, r_m: Floats,
        walls: kernel.Walls,
    ) -> Floats:  # fmt: skip
        """Return the points (n, 2) to fly to now: `first_m`, or for UAVs of a group those of their scripts.

        `goal_m` (n, 2) are goals and `way_m` (n,) the lengths of the ways to them; `first_m` has their first points.
        """
        self._watch(slot, uav, goal_m, way_m)
        index = {k: row for row, k in enumerate(uav.tolist())}
        self.scripts = [s for s in self.scripts if self._continues(s, slot, index, position_m, goal_m)]
        self._make_room(slot, uav, position_m, goal_m, r_m, walls)
        if not self.scripts:
            return first_m
        first_m = first_m.copy()
        for script in self.scripts:
            rows = np.array([index[k] for k in script.uav.tolist()])
            for k, row in enumerate(rows.tolist()):
                first_m[row] = self._aim(script, k, position_m[rows], float(r_m[row]))
        return first_m

    def _watch(self, slot: int, uav: Indices, goal_m: Floats, way_m: Floats) -> None:
        """Note who has come nearer to its goal."""
        for row, k in enumerate(uav.tolist()):
            goal, way = (float(goal_m[row, 0]), float(goal_m[row, 1])), float(way_m[row])
            known = self.watches.get(k)
            if known is None or known.goal != goal or way < ARRIVED_M:
                self.watches[k] = _Watch(way, slot, goal)
            elif way < known.way_m - self.u_max_m[k]:
                known.way_m, known.slot = way, slot

    def _continues(self, script: Script, slot: int, index: dict[int, int], position_m: Floats, goal_m: Floats) -> bool:
        """Note which moves of a script are flown; return False if the script is over."""
        if any(k not in index for k in script.uav.tolist()):
            return False
        rows = [index[k] for k in script.uav.tolist()]
        if (goal_m[rows] != script.goal_m).any():
            return False
        for k, row in enumerate(rows):
            allowed = script.allowed(k)
            reached = length_m(position_m[row] - script.to_m[allowed]) <= REACHED * self.u_max_m[script.uav[k]]
            if reached.any():
                script.flown[k] += int(np.flatnonzero(reached)[-1]) + 1
                script.begun_slot = slot
        over = script.ended or slot - script.begun_slot > SCRIPT_SLOTS
        if over:
            for k in script.uav.tolist():
                self.watches[k].slot = slot
        return not over

    def _make_room(
        self, slot: int, uav: Indices, position_m: Floats, goal_m: Floats, r_m: Floats, walls: kernel.Walls
    ) -> None:
        """Write scripts for UAVs that are blocked and in no group."""
        busy = {k for script in self.scripts for k in script.uav.tolist()}
        left, searches = EXPANSIONS, SEARCHES
        for row, k in enumerate(uav.tolist()):
            watch = self.watches[k]
            if k in busy or slot - watch.slot < BLOCKED_SLOTS:
                continue
            near = self._neighbours(row, uav, position_m, r_m, busy)
            if any(not self.watches[other].waits(slot) for other in uav[near].tolist()):
                continue
            group = [*near, *self._beyond(slot, near, uav, position_m, r_m, busy)][:MOST_UAVS]
            while searches > 0 and left > 0 and watch.size <= len(group):
                rows, spacing = np.array(group[: watch.size]), SPACINGS[watch.tries % len(SPACINGS)]
                script, spent = self._script(slot, rows, spacing, uav, position_m, goal_m, r_m, walls, left)
                left, searches, watch.size = left - spent, searches - 1, watch.size + 1
                if script is not None:
                    self.scripts.append(script)
                    busy |= set(script.uav.tolist())
                    break
            if k in busy or watch.size > len(group):
                watch.tries += 1
                watch.size = 1 + watch.tries // len(SPACINGS)
                watch.slot = slot - BLOCKED_SLOTS + PAUSE_SLOTS

    def _neighbours(self, row: int, uav: Indices, position_m: Floats, r_m: Floats, busy: set[int]) -> list[int]:
        """Return the rows of a blocked UAV and of those in contact with it, the nearest first, at most six."""
        away_m = length_m(position_m - position_m[row]) - r_m - r_m[row]
        order = np.argsort(away_m, kind="stable").tolist()
        free = [other for other in order if other != row and int(uav[other]) not in busy]
        near, found = [row], True
        while found and len(near) < MOST_UAVS:
            found = False
            for other in free:
                reach_m = r_m[near] + r_m[other] + self.u_max_m[uav[near]] + self.u_max_m[uav[other]]
                if other not in near and (length_m(position_m[near] - position_m[other]) < reach_m).any():
                    near.append(other)
                    found = True
                    break
        return near

    def _beyond(
        self, slot: int, near: list[int], uav: Indices, position_m: Floats, r_m: Floats, busy: set[int]
    ) -> list[int]:
        """Return the rows of the UAVs not far from these that wait too: one of them may stand where room is needed."""
        away_m = length_m(position_m[:, None] - position_m[near]).min(axis=1)
        order = [row for row in np.argsort(away_m, kind="stable").tolist() if away_m[row] < BEYOND * r_m[near].max()]
        free = [row for row in order if row not in near and int(uav[row]) not in busy]
        return [row for row in free if self.watches[int(uav[row])].waits(slot)]

    def _script(
        self, slot: int, rows: Indices, spacing: float, uav: Indices, position_m: Floats, goal_m: Floats, r_m: Floats,
        walls: kernel.Walls, limit: int,
    ) -> tuple[Script | None, int]:  # fmt: skip
        """Search moves for the UAVs of these rows; all others stand still."""
        start_m, radius_m = position_m[rows], r_m[rows]
        now_m = length_m(start_m[:, None] - start_m)
        apart_m = np.minimum(radius_m[:, None] + radius_m + DELTA_M + MAP_SPARE_M, 0.9995 * now_m)
        box = Box.about(start_m, 2 * float(radius_m.max()) / spacing)
        others = np.setdiff1d(np.flatnonzero(box.inside(position_m, -2 * float(r_m.max()))), rows)
        found = roadmap(
            self.charts, uav[rows], radius_m, start_m, goal_m[rows], _with(walls, rows, position_m, r_m, others), box
        )
        if not np.isfinite(found.left_m[np.arange(len(rows)), np.arange(len(rows))]).all():
            return None, 0
        moved, to, spent = _moves(found, apart_m, limit)
        if not len(moved):
            return None, spent
        return _script_of(slot, uav[rows], goal_m[rows], apart_m, found.node_m, moved, to), spent

    def _aim(self, script: Script, k: int, position_m: Floats, r_m: float) -> Floats:
        """Return the farthest place that UAV k of a script may fly to straight, else its next place, else its last."""
        allowed = script.allowed(k)
        if not len(allowed):
            place_m = script.to_m[script.moves[k]][: script.flown[k]]
            begin_m = script.from_m[script.moves[k]][:1]
            return np.asarray(np.concatenate([position_m[k : k + 1], begin_m, place_m])[-1])
        for q in allowed[:0:-1].tolist():
            to_m = script.to_m[q]
            if kernel.open_leg(self.charts.barred, r_m, DELTA_M, *position_m[k].tolist(), *to_m.tolist())[0] and all(
                self._clear(script, k, other, position_m, to_m) for other in range(len(script.uav)) if other != k
            ):
                return np.asarray(to_m)
        return np.asarray(script.to_m[allowed[0]])

    def _clear(self, script: Script, k: int, other: int, position_m: Floats, to_m: Floats) -> bool:
        """Return True if the straight way of UAV k to a place keeps clear of where another one is and may fly now."""
        way_m = np.concatenate([position_m[other : other + 1], script.to_m[script.allowed(other)]])
        ends_m = way_m[1:] if len(way_m) > 1 else way_m
        away_m = segment_distance_m(position_m[k], to_m, way_m[: len(ends_m)], ends_m)
        return bool((away_m >= script.apart_m[k, other] - DELTA_M).all())


def _with(walls: kernel.Walls, rows: Indices, position_m: Floats, r_m: Floats, others: Indices) -> kernel.Walls:
    """Return what does not move for UAVs of some rows: the hulls, and all `others`."""
    point_m = position_m[others]
    keep_m = r_m[rows][:, None] + r_m[others] + DELTA_M
    bar_m = np.minimum(keep_m, 0.9995 * length_m(position_m[rows][:, None] - point_m)) - kernel.ROUNDING_M
    return ways.walls_near(
        np.concatenate([walls.a_m, point_m]),
        np.concatenate([walls.b_m, point_m]),
        np.concatenate([walls.keep_m[rows], keep_m], axis=1),
        np.concatenate([walls.bar_m[rows], bar_m], axis=1),
    )


def _moves(found: Roadmap, apart_m: Floats, limit: int) -> tuple[Indices, Indices, int]:
    """Return UAV and node of each move, none if there is no such sequence, and the expansions."""
    table, heap = 1 << room_kernel.TABLE_BITS, 1 << (room_kernel.TABLE_BITS + 1)
    moved, to = np.empty(MOST_MOVES, np.int64), np.empty(MOST_MOVES, np.int64)
    steps, spent = room_kernel.rearrange(
        found.node_m, found.begin, found.leg, found.left_m, found.end, np.arange(len(apart_m)), apart_m,
        np.full(table, -1), np.empty(table), np.empty(table, np.int64), np.zeros(table, dtype=bool),
        np.empty(heap), np.empty(heap, np.int64), limit, moved, to,
    )  # fmt: skip
    return moved[: max(steps, 0)], to[: max(steps, 0)], spent


def _script_of(
    slot: int, uav: Indices, goal_m: Floats, apart_m: Floats, node_m: Floats, moved: Indices, to: Indices
) -> Script:
    """Return the script of these moves; a move follows the earlier ones of others that come too near to its way."""
    at, begin = list(range(len(uav))), []
    for k, node in zip(moved.tolist(), to.tolist(), strict=True):
        begin.append(at[k])
        at[k] = node
    from_m, to_m = node_m[begin], node_m[to]
    near = segment_distance_m(from_m[:, None], to_m[:, None], from_m, to_m) < apart_m[moved[:, None], moved]
    near &= moved[:, None] != moved
    after = [np.flatnonzero(near[q, :q]) for q in range(len(moved))]
    moves = [np.flatnonzero(moved == k) for k in range(len(uav))]
    return Script(uav, goal_m, apart_m, moved, from_m, to_m, after, moves, [0] * len(uav), slot)


def rehearse() -> None:
    """Compile or load all code of this module, and run it: two UAVs change places in a box."""
    box = Zone(name="box", kind="inclusion", polygon=[(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)])
    room = Room(Charts.of(Airspace.of(barriers([box]), 1.0, 1.0)), np.ones(2))
    start_m, r_m = np.array([(-3.0, 0.0), (3.0, 0.0)]), np.ones(2)
    walls = ways.walls_of(start_m, r_m, Obstacles.none())
    script, _ = room._script(0, np.arange(2), 3.0, np.arange(2), start_m, start_m[::-1], r_m, walls, EXPANSIONS)
    assert script is not None, "two UAVs with discs of 2 m cannot change places in a box of 18 m"


__all__ = ["Room", "Script", "rehearse"]
