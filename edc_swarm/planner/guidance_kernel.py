"""Compiled part of the guidance: see `edc_swarm.planner.guidance` for the theory.

All code here is plain loops over arrays and deterministic: no fast-math, no threads, random numbers
from a hash, effort counted in priced steps. It is one file since numba caches a compiled function by the file
that defines it, and would not notice a change to a callee in another file.

Names: n UAVs, m hulls that never move, W slots of look-ahead, M lattice layers (two slots each),
P way points a plan can have.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edc_swarm.planner.compiler import compiled, inner

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

AT_GOAL_M = 1e-9
ROUNDING_M = 1e-6
"""Tolerance of a plan's distances: local search ends exactly at the least distance."""
OPEN, PRICED, CLOSED = 0, 1, 2
UNYIELDING = 1e4
"""Right of way of all others in the next slot over a UAV that has stood still for long."""
ENTRY_BITS = 4
"""A vehicle has 2**ENTRY_BITS entries in each slot of the grid, of which it uses nine."""
EXPANSION = 8
"""Effort of one expansion of the lattice search, in priced steps of equal time."""
SIDESTEPS = 3
"""Most opponents that one plan passes without a search."""
SIDE = 1.002
"""First distance at which a plan passes an opponent, as a share of the least distance."""
SLACK = 1.0
"""Slots by which way points off the lattice may be cheaper than way points on it."""
GAIN = 1e-3
"""Least gain, in slots, of moving a way point."""
TIE = 1e-12
"""Tolerance for equal costs, which differ by the order of additions."""
HALVINGS = 4
"""Bisections of a move of a way point towards the straight connection."""
REPEATS = 4
"""Most moves of a way point in one direction."""

NONE: Any = np.int64(0)
ONCE: Any = np.int64(1)
DROPPED: Any = np.int64(-1)
MOVED: Any = np.int64(0)
INSERTED: Any = np.int64(1)
PRESENT: Any = np.bool_(True)
ABSENT: Any = np.bool_(False)
NOWHERE: Any = np.int64(-1)
"""Numpy's numbers, since numba compiles a function anew for every literal argument."""


class Rules(NamedTuple):
    """Numbers that price a plan, and the grid's shape; see `edc_swarm.planner.guidance`.

    `longest_m` is the longest step of any UAV: the middles of two steps in conflict are at most this farther apart
    than the UAVs themselves.
    """

    longest_m: float
    delta_m: float
    touch: float
    depth: float
    patience: float
    cap: float
    low_x_m: float
    low_y_m: float
    per_cell: float
    rows: int
    columns: int


class Walls(NamedTuple):
    """Hulls with each UAV's distances from them: the segments a_m-b_m (m, 2), (m, 2).

    `keep_m` (n, m) is the distance that each UAV's centre should keep: R + delta plus the hull's radius. `bar_m`
    (n, m) is the distance that it must keep: the same, or 0.9995 of the present distance if that is less.
    `begin` (n + 1,) and `which` list the hulls that each UAV can come near within the look-ahead, in ascending order:
    UAV k those in which[begin[k]:begin[k + 1]].
    """

    a_m: Floats
    b_m: Floats
    keep_m: Floats
    bar_m: Floats
    begin: Ints
    which: Ints


class Barred(NamedTuple):
    """Barriers of zones, and the index of `geometry.BarrierIndex`.

    A row of `edge` (m, 8) is (ax, ay, bx, by: the ends of the segment, sx, sy: the unit vector across it, zero for a
    point, its radius, and 1 where a UAV keeps its own radius in addition, else 0). It is one array, since every call
    passes each array on as eight numbers.
    """

    edge: Floats
    begin: Ints
    which: Ints
    low_x_m: float
    low_y_m: float
    per_cell: float
    rows: int
    columns: int


class World(NamedTuple):
    """Data for pricing a plan.

    track (n, W+1, 2) predicted positions in metres, one a slot; start_m (n, 2); goal_m (n, 2);
    r_m (n,); u_max_m (n,) longest step of each; weight (n, 2) prices of a slot and of a full step;
    luck (n,) lateness drawn for right of way; imminent (n,) least right of way
    of all others over each in the next slot; gamma (W+1,) discount of a conflict;
    head (W+1, cells) and link (W+1, 16 n) linked lists, for each slot and square cell, of the vehicles
    whose step of that slot has its middle in this cell or in one of the eight around it (entry 16 l + i
    is vehicle l's i-th cell). A cell is as wide as the middles of two steps in conflict can be apart.

    Loops unpack the arrays they use first: reading them from the tuple each time costs more than
    all the arithmetic.
    """

    track: Floats
    start_m: Floats
    goal_m: Floats
    r_m: Floats
    u_max_m: Floats
    weight: Floats
    luck: Floats
    imminent: Floats
    gamma: Floats
    head: NDArray[np.int32]
    link: NDArray[np.int32]
    walls: Walls
    barred: Barred
    rules: Rules


class Plans(NamedTuple):
    """Way points of every UAV: size (n,), slot (n, P) from now, point (n, P, 2).

    `delay` (n,) counts the slots of delay of a plan since the UAV made it.
    """

    size: Ints
    delay: Ints
    slot: Ints
    point_m: Floats


class Limits(NamedTuple):
    """Limits on the search for plans: the fields of `guidance.Tuning`, with the budget of this slot."""

    layers: int
    side: int
    greed: float
    expand: int
    budget: int
    rounds: int
    easy: float


class Draft(NamedTuple):
    """A plan under construction: way points, their track, and the cost of each of its slots.

    `slot` (P + 1,) and `point_m` (P + 1, 2) have room for one way point more than a plan. `track` (W+1, 2);
    `aim` (W+1,) is the way point that the step of slot t aims at; `effort` and `price` (W+2,) are the costs of
    the step itself and of its conflicts; the last entry is the straight rest beyond the
    look-ahead. The `new_` arrays belong to a trial change. `work` counts priced steps.
    """

    slot: Ints
    point_m: Floats
    track: Floats
    aim: Ints
    effort: Floats
    price: Floats
    new_track: Floats
    new_aim: Ints
    new_effort: Floats
    new_price: Floats
    work: Ints


class Scratch(NamedTuple):
    """Work space of the lattice search, kept from call to call.

    `stamp` of a node less the call's epoch is OPEN, PRICED (its own conflicts are in its cost) or
    CLOSED; anything less belongs to an earlier call. `guards` has room for all barriers of a cell.
    """

    stamp: NDArray[np.int64]
    cost: Floats
    price: Floats
    parent: NDArray[np.int8]
    heap_cost: Floats
    heap_node: Ints
    epoch: Ints
    move: Ints
    move_length: Floats
    guards: Floats


@compiled
def uniform(seed: int, a: int, b: int) -> float:
    """Return a number in [0, 1) from a hash of three integers (splitmix64 finaliser, thrice)."""
    z = np.uint64(0)
    for value in (seed, a, b):
        z = (z ^ np.uint64(value)) + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@inner
def norm(x: float, y: float) -> float:
    """Return the length of a vector; several times faster than hypot, and no length here is near overflow."""
    return math.sqrt(x * x + y * y)


@inner
def sum_of(values: Floats) -> float:
    """Return the sum, in the order of the entries; numba's own costs more to compile."""
    total = 0.0
    for value in values:
        total += value
    return total


@inner
def cell_of(rules: Rules, x: float, y: float) -> tuple[int, int]:
    """Return the cell of a point; points outside the grid belong to its border cells."""
    i = int((x - rules.low_x_m) * rules.per_cell)
    j = int((y - rules.low_y_m) * rules.per_cell)
    return min(max(i, 0), rules.rows - 1), min(max(j, 0), rules.columns - 1)


@inner
def register(world: World, k: int, present: bool) -> None:
    """Add vehicle k's track to the grid, or remove it: nine cells about the middle of each step."""
    rules, track, head, link = world.rules, world.track[k], world.head, world.link
    for t in range(track.shape[0]):
        before = max(t - 1, 0)
        i, j = cell_of(rules, 0.5 * (track[before, 0] + track[t, 0]), 0.5 * (track[before, 1] + track[t, 1]))
        entry = k << ENTRY_BITS
        for a in range(max(i - 1, 0), min(i + 2, rules.rows)):
            for b in range(max(j - 1, 0), min(j + 2, rules.columns)):
                c = a * rules.columns + b
                if present:
                    link[t, entry] = head[t, c]
                    head[t, c] = entry
                elif head[t, c] == entry:
                    head[t, c] = link[t, entry]
                else:
                    other = head[t, c]
                    while link[t, other] != entry:
                        other = link[t, other]
                    link[t, other] = link[t, entry]
                entry += 1


@inner
def separation(rules: Rules, start_m: Floats, r_m: Floats, k: int, other: int) -> float:
    """Return the distance that two vehicles must keep: R + delta, or 0.9995 of the present one if that is less."""
    apart = 0.9995 * norm(start_m[k, 0] - start_m[other, 0], start_m[k, 1] - start_m[other, 1])
    return float(min(r_m[k] + r_m[other] + rules.delta_m, apart) - ROUNDING_M)


@inner
def toll(rules: Rules, luck: Floats, imminent: Floats, r_m: Floats, k: int, other: int, t: int, lack: float) -> float:
    """Return the undiscounted price for k of `lack` metres too little distance to another vehicle in slot t."""
    way = (luck[other] + rules.patience) / (luck[k] + rules.patience)
    way = min(max(way, 1.0 / rules.cap), rules.cap)
    if t == 1:
        way = max(way, imminent[k])
    return float(way * (rules.touch + rules.depth * lack / (r_m[k] + r_m[other])))


@inner
def to_segment(px: float, py: float, dx: float, dy: float) -> float:
    """Return the squared distance of the origin to the segment from p to p + d."""
    along = -(px * dx + py * dy)
    if along <= 0.0:
        return px * px + py * py
    square = dx * dx + dy * dy
    if along >= square:
        return (px + dx) * (px + dx) + (py + dy) * (py + dy)
    cross = px * dy - py * dx
    return cross * cross / square


@inner
def clearance(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the squared distance of the origin to the parallelogram {p + s a + t b, 0 <= s, t <= 1}."""
    det = ax * by - ay * bx
    if det != 0.0:
        s = (by * -px + bx * py) / det
        t = (ax * -py + ay * px) / det
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            return 0.0
    near = min(to_segment(px, py, ax, ay), to_segment(px, py, bx, by))
    return min(near, to_segment(px + bx, py + by, ax, ay), to_segment(px + ax, py + ay, bx, by))


@inner
def wall_conflict(rules: Rules, walls: Walls, k: int, x0: float, y0: float, x: float, y: float) -> float:
    """Return the price of the hulls near vehicle k's step from (x0, y0) to (x, y), by the exact distance.

    A hull never yields or moves: nearer than `bar_m` the price is the greatest, in any slot.
    A vehicle nearer than `keep_m` pays a moderate price for staying, so it leaves by its cheapest way.
    Callers call it only if there are hulls: to pass them as arguments costs a third of the time of all other work.
    """
    a, b, keep, bar, which = walls.a_m, walls.b_m, walls.keep_m, walls.bar_m, walls.which
    price = 0.0
    ax, ay = x - x0, y - y0
    for e in range(walls.begin[k], walls.begin[k + 1]):
        w = which[e]
        px, py = x0 - a[w, 0], y0 - a[w, 1]
        bx, by = a[w, 0] - b[w, 0], a[w, 1] - b[w, 1]
        far = keep[k, w] + norm(bx, by) + norm(ax, ay)
        if px * px + py * py < far * far:
            away = math.sqrt(clearance(px, py, ax, ay, bx, by))
            if away < bar[k, w]:
                price += UNYIELDING * (rules.touch + rules.depth * (bar[k, w] - away) / keep[k, w])
            elif away < keep[k, w] - ROUNDING_M:
                price += rules.cap * (rules.touch + rules.depth * (keep[k, w] - away) / keep[k, w])
    return price


@inner
def barred_cell(barred: Barred, x: float, y: float) -> int:
    """Return the cell of the barriers near a point; the cells at the border, and beyond it, have none."""
    i = min(max((x - barred.low_x_m) * barred.per_cell, 0.0), barred.rows - 1.0)
    j = min(max((y - barred.low_y_m) * barred.per_cell, 0.0), barred.columns - 1.0)
    return int(i) * barred.columns + int(j)


@inner
def to_barrier(barred: Barred, w: int, x0: float, y0: float, x: float, y: float) -> float:
    """Return the squared distance of the straight way from (x0, y0) to (x, y) from the segment of barrier w."""
    edge = barred.edge[w]
    return clearance(x0 - edge[0], y0 - edge[1], x - x0, y - y0, edge[0] - edge[2], edge[1] - edge[3])


@inner
def is_far(barred: Barred, w: int, x: float, y: float, far: float) -> bool:
    """Return True if a point is at least `far` from the segment of barrier w; it costs a fifth of `to_barrier`."""
    edge = barred.edge[w]
    return to_segment(x - edge[0], y - edge[1], edge[0] - edge[2], edge[1] - edge[3]) >= far * far


@inner
def is_beside(barred: Barred, w: int, x0: float, y0: float, x: float, y: float, far: float) -> bool:
    """Return True if a straight way is on one side of the line of barrier w, at least `far` away from it.

    Most ways near a barrier are, and it costs a third of `is_far`. A point has no line: False.
    """
    edge = barred.edge[w]
    here = (x0 - edge[0]) * edge[4] + (y0 - edge[1]) * edge[5]
    there = (x - edge[0]) * edge[4] + (y - edge[1]) * edge[5]
    return bool(min(here, there) >= far or max(here, there) <= -far)


@inner
def keep_of(barred: Barred, w: int, r_m: float, delta_m: float) -> float:
    """Return the distance that a UAV should keep from the segment of barrier w."""
    return float(barred.edge[w, 6] + barred.edge[w, 7] * r_m + delta_m)


@inner
def bar_of(barred: Barred, w: int, keep: float, x: float, y: float) -> float:
    """Return the distance that a UAV at (x, y) must keep: `keep`, or 0.9995 of the present one if that is less."""
    edge = barred.edge[w]
    away = math.sqrt(to_segment(x - edge[0], y - edge[1], edge[0] - edge[2], edge[1] - edge[3]))
    return float(min(keep, 0.9995 * away) - ROUNDING_M)


@inner
def barrier_conflict(
    barred: Barred, rules: Rules, r_m: float, sx: float, sy: float, x0: float, y0: float, x: float, y: float
) -> float:
    """Return the price of the barriers near the step from (x0, y0) to (x, y) of a vehicle that is now at (sx, sy).

    It prices as `wall_conflict` does. It takes no `World`, since to pass that costs more than most answers.
    """
    mx, my = 0.5 * (x0 + x), 0.5 * (y0 + y)
    cell = barred_cell(barred, mx, my)
    price = 0.0
    half = 0.5 * norm(x - x0, y - y0)
    for e in range(barred.begin[cell], barred.begin[cell + 1]):
        w = barred.which[e]
        keep = keep_of(barred, w, r_m, rules.delta_m)
        # Nearer than `keep` less the tolerance is a conflict: half of it is for the rounding of `is_beside`.
        if is_beside(barred, w, x0, y0, x, y, keep - 0.5 * ROUNDING_M) or is_far(barred, w, mx, my, keep + half):
            continue
        squared = to_barrier(barred, w, x0, y0, x, y)
        if squared < (keep - ROUNDING_M) * (keep - ROUNDING_M):
            away = math.sqrt(squared)
            bar = bar_of(barred, w, keep, sx, sy)
            if away < bar:
                price += UNYIELDING * (rules.touch + rules.depth * (bar - away) / keep)
            else:
                price += rules.cap * (rules.touch + rules.depth * (keep - away) / keep)
    return price


@inner
def near_barriers(
    barred: Barred, delta_m: float, r_m: float, far_m: float, sx: float, sy: float, x: float, y: float, guards: Floats
) -> int:
    """Write the barriers that a move of up to `far_m` from (x, y) can come too close to; return their number.

    A row of `guards` (c, 8) is (ax, ay, bx, by, the distance that a vehicle now at (sx, sy) must keep, the unit vector
    across the barrier to the side of (x, y), the distance of (x, y) from its line).
    """
    cell = barred_cell(barred, x, y)
    count = 0
    for e in range(barred.begin[cell], barred.begin[cell + 1]):
        w = barred.which[e]
        keep = keep_of(barred, w, r_m, delta_m)
        if not is_far(barred, w, x, y, keep + far_m):
            bar = bar_of(barred, w, keep, sx, sy)
            if bar > 0.0:
                edge = barred.edge[w]
                guards[count, 0], guards[count, 1] = edge[0], edge[1]
                guards[count, 2], guards[count, 3] = edge[2], edge[3]
                guards[count, 4] = bar
                nx, ny = edge[4], edge[5]
                beside = (x - edge[0]) * nx + (y - edge[1]) * ny
                if beside < 0.0:
                    nx, ny, beside = -nx, -ny, -beside
                guards[count, 5], guards[count, 6], guards[count, 7] = nx, ny, beside
                count += 1
    return count


@inner
def bars_move(guards: Floats, count: int, x0: float, y0: float, x: float, y: float) -> bool:
    """Return True if one of the first `count` rows of `guards` forbids the straight way from (x0, y0) to (x, y)."""
    mx, my = 0.5 * (x0 + x), 0.5 * (y0 + y)
    half = 0.5 * norm(x - x0, y - y0)
    for e in range(count):
        ax, ay, bar = guards[e, 0], guards[e, 1], guards[e, 4]
        dx, dy = ax - guards[e, 2], ay - guards[e, 3]
        beside = guards[e, 7]
        if min(beside, beside + (x - x0) * guards[e, 5] + (y - y0) * guards[e, 6]) >= bar + ROUNDING_M:
            continue
        far = bar + half + ROUNDING_M
        if to_segment(mx - ax, my - ay, dx, dy) >= far * far:
            continue
        if clearance(x0 - ax, y0 - ay, x - x0, y - y0, dx, dy) < bar * bar:
            return True
    return False


@inner
def still_conflict(world: World, k: int, x0: float, y0: float, x: float, y: float) -> float:
    """Return the price of all that never moves, hulls and barriers, on vehicle k's step."""
    price = 0.0
    if world.walls.a_m.shape[0] > 0:
        price = wall_conflict(world.rules, world.walls, k, x0, y0, x, y)
    if world.barred.edge.shape[0] > 0:
        sx, sy = world.start_m[k, 0], world.start_m[k, 1]
        price += barrier_conflict(world.barred, world.rules, world.r_m[k], sx, sy, x0, y0, x, y)
    return price


@compiled
def open_leg(barred: Barred, r_m: float, delta_m: float, x0: float, y0: float, x: float, y: float) -> tuple[bool, int]:
    """Return True if no barrier blocks the straight way of a UAV at (x0, y0) to (x, y), and the number of tests.

    It follows the way from cell to cell; a barrier near the way is near the cell of the way's nearest point.
    """
    tests = 0
    dx, dy = x - x0, y - y0
    first = min(max((x0 - barred.low_x_m) * barred.per_cell, 0.0), barred.rows - 1.0)
    last = min(max((x - barred.low_x_m) * barred.per_cell, 0.0), barred.rows - 1.0)
    i, end = int(first), int(last)
    step = 1 if end >= i else -1
    while True:
        south, north = min(y0, y), max(y0, y)
        if i != int(last) or i != int(first):
            # The part of the way in this row of cells; the outermost rows have no barriers.
            west = barred.low_x_m + (i - 1e-6) / barred.per_cell
            east = barred.low_x_m + (i + 1 + 1e-6) / barred.per_cell
            ya = y0 + dy * min(max((west - x0) / dx, 0.0), 1.0)
            yb = y0 + dy * min(max((east - x0) / dx, 0.0), 1.0)
            south, north = min(ya, yb), max(ya, yb)
        low = min(max((south - barred.low_y_m) * barred.per_cell - 1e-6, 0.0), barred.columns - 1.0)
        high = min(max((north - barred.low_y_m) * barred.per_cell + 1e-6, 0.0), barred.columns - 1.0)
        for j in range(int(low), int(high) + 1):
            cell = i * barred.columns + j
            for e in range(barred.begin[cell], barred.begin[cell + 1]):
                w = barred.which[e]
                keep = keep_of(barred, w, r_m, delta_m)
                squared = to_barrier(barred, w, x0, y0, x, y)
                tests += 1
                if squared < keep * keep:
                    bar = bar_of(barred, w, keep, x0, y0)
                    if bar > 0.0 and squared < bar * bar:
                        return False, tests
        if i == end:
            return True, tests
        i += step


@compiled
def clear_ways(
    walls: Walls, barred: Barred, delta_m: float, position_m: Floats, goal_m: Floats, r_m: Floats,
    clear: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write for each UAV if its straight way to its goal is clear of hulls and barriers."""
    for k in range(len(r_m)):
        x0, y0, x, y = position_m[k, 0], position_m[k, 1], goal_m[k, 0], goal_m[k, 1]
        clear[k] = open_way(walls, k, x0, y0, x, y)
        if clear[k] and barred.edge.shape[0] > 0:
            clear[k] = open_leg(barred, r_m[k], delta_m, x0, y0, x, y)[0]


@inner
def complete_row(
    barred: Barred, r_m: float, delta_m: float, node_m: Floats, leg_m: Floats, known: NDArray[np.bool_], n: int
) -> int:
    """Write the lengths of the open legs from node n to all others, infinite for the others; return the tests."""
    tests = 0
    for other in range(len(known)):
        if known[other]:
            leg_m[n, other] = leg_m[other, n]
        else:
            x0, y0, x, y = node_m[n, 0], node_m[n, 1], node_m[other, 0], node_m[other, 1]
            is_open, spent = open_leg(barred, r_m, delta_m, x0, y0, x, y)
            tests += spent + 1
            leg_m[n, other] = norm(x - x0, y - y0) if is_open else np.inf
    known[n] = True
    return tests


@compiled
def measure_ways(
    barred: Barred, r_m: float, delta_m: float, node_m: Floats, leg_m: Floats, known: NDArray[np.bool_],
    goal_m: Floats, cost: Floats, after: Ints, closed: NDArray[np.bool_], budget: int,
) -> tuple[bool, int]:  # fmt: skip
    """Write the length `cost` (c,) of the shortest way from each node to the goal, and the node `after` it (c,).

    Dijkstra's algorithm from the goal; `after` is -1 where the goal itself is next. It returns False, and the number of
    tests of a leg against a barrier, if the budget ends first. Rows of `leg_m` that are complete stay so.
    """
    tests = 0
    closed[:] = False
    after[:] = -1
    for n in range(len(known)):
        x0, y0 = node_m[n, 0], node_m[n, 1]
        is_open, spent = open_leg(barred, r_m, delta_m, x0, y0, goal_m[0], goal_m[1])
        tests += spent + 1
        cost[n] = norm(goal_m[0] - x0, goal_m[1] - y0) if is_open else np.inf
    while tests <= budget:
        node, least = NOWHERE, np.inf
        for n in range(len(known)):
            if not closed[n] and cost[n] < least:
                node, least = n, cost[n]
        if node < 0:
            return True, tests
        closed[node] = True
        if not known[node]:
            tests += complete_row(barred, r_m, delta_m, node_m, leg_m, known, node)
        for n in range(len(known)):
            far = least + leg_m[node, n]
            if not closed[n] and far < cost[n]:
                cost[n], after[n] = far, node
    return False, tests


@compiled
def next_node(
    barred: Barred, r_m: float, delta_m: float, node_m: Floats, cost: Floats, x: float, y: float,
    tried: NDArray[np.bool_], budget: int,
) -> tuple[int, float, int]:  # fmt: skip
    """Return the first node of the shortest way from (x, y) to the goal of `cost`, its length, and the tests.

    Of nodes that are equally good, the one nearest to the goal counts: a UAV at a node flies to the next one. The node
    is -1 if there is none, or if the budget ends first.
    """
    tests = 0
    tried[:] = False
    while tests <= budget:
        node, least, left = -1, np.inf, np.inf
        for n in range(len(cost)):
            if not tried[n] and cost[n] < np.inf:
                far = cost[n] + norm(node_m[n, 0] - x, node_m[n, 1] - y)
                if far < least - ROUNDING_M or (far < least + ROUNDING_M and cost[n] < left):
                    node, least, left = n, far, cost[n]
        if node < 0:
            return -1, 0.0, tests
        tried[node] = True
        is_open, spent = open_leg(barred, r_m, delta_m, x, y, node_m[node, 0], node_m[node, 1])
        tests += spent + 1
        if is_open:
            return node, least, tests
    return -1, 0.0, tests


@compiled
def open_way(walls: Walls, k: int, x0: float, y0: float, x: float, y: float) -> bool:
    """Return True if no hull blocks vehicle k's straight flight from (x0, y0) to (x, y)."""
    a, b, bar = walls.a_m, walls.b_m, walls.bar_m
    for w in range(a.shape[0]):
        px, py = x0 - a[w, 0], y0 - a[w, 1]
        if clearance(px, py, x - x0, y - y0, a[w, 0] - b[w, 0], a[w, 1] - b[w, 1]) < bar[k, w] * bar[k, w]:
            return False
    return True


@compiled
def open_legs(
    walls: Walls, barred: Barred, k: int, r_m: float, delta_m: float, node_m: Floats, first: Ints, second: Ints,
    is_open: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write for each pair of nodes if vehicle k's straight way between them is clear of hulls and barriers."""
    for i in range(len(first)):
        x0, y0, x, y = node_m[first[i], 0], node_m[first[i], 1], node_m[second[i], 0], node_m[second[i], 1]
        is_open[i] = open_way(walls, k, x0, y0, x, y) and open_leg(barred, r_m, delta_m, x0, y0, x, y)[0]


@compiled
def way_round(  # noqa: PLR0912 (one loop over arrays)
    walls: Walls, barred: Barred, r_m: float, delta_m: float, k: int, node_m: Floats, leg_m: Floats,
    known: NDArray[np.bool_], cost: Floats, parent: Ints, closed: NDArray[np.bool_], budget: int,
) -> tuple[int, float, int]:  # fmt: skip
    """Find vehicle k's shortest way from node 0 to node 1 over the other nodes, each leg an open way, by A*.

    The last nodes are those of `leg_m` and `known` (`complete_row`). Returns the first node of the way, its length, and
    the number of tests of one leg against one hull or barrier; the node is -1 if there is no way, or if the budget ends
    first. `cost`, `parent` and `closed` are work space.
    """
    base = len(cost) - len(known)
    cost[:] = np.inf
    closed[:] = False
    cost[0] = 0.0
    tests = 0
    while tests <= budget:
        node, least = -1, np.inf
        for n in range(len(cost)):
            if not closed[n] and cost[n] < np.inf:
                promised = cost[n] + norm(node_m[n, 0] - node_m[1, 0], node_m[n, 1] - node_m[1, 1])
                if promised < least:
                    node, least = n, promised
        if node < 0:
            break
        if node == 1:
            first = node
            while parent[first] != 0:
                first = parent[first]
            return first, cost[1], tests
        closed[node] = True
        x, y = node_m[node, 0], node_m[node, 1]
        for n in range(len(cost)):
            far = cost[node] + norm(node_m[n, 0] - x, node_m[n, 1] - y)
            if not closed[n] and far < cost[n]:
                if node >= base and n >= base and known[node - base]:
                    if leg_m[node - base, n - base] == np.inf:
                        continue
                elif barred.edge.shape[0] > 0:
                    is_open, spent = open_leg(barred, r_m, delta_m, x, y, node_m[n, 0], node_m[n, 1])
                    tests += spent + 1
                    if not is_open:
                        continue
                tests += walls.a_m.shape[0]
                if open_way(walls, k, x, y, node_m[n, 0], node_m[n, 1]):
                    cost[n], parent[n] = far, node
    return -1, 0.0, tests


@inner
def conflict_at(
    rules: Rules, track: Floats, start_m: Floats, r_m: Floats, luck: Floats, imminent: Floats, gamma: Floats,
    head: NDArray[np.int32], link: NDArray[np.int32], k: int, t: int, x: float, y: float,
) -> float:  # fmt: skip
    """Return the price of vehicle k at (x, y) in slot t; the arrays are those of `World`."""
    price = 0.0
    i, j = cell_of(rules, x, y)
    entry = head[t, i * rules.columns + j]
    while entry >= 0:
        other = entry >> ENTRY_BITS
        dx = x - track[other, t, 0]
        dy = y - track[other, t, 1]
        reach = r_m[k] + r_m[other] + rules.delta_m
        squared = dx * dx + dy * dy
        if squared < reach * reach and other != k:
            lack = separation(rules, start_m, r_m, k, other) - math.sqrt(squared)
            if lack > 0.0:
                price += toll(rules, luck, imminent, r_m, k, other, t, lack)
        entry = link[t, entry]
    return float(price * gamma[t])


@inner
def step_conflict(
    rules: Rules, track: Floats, start_m: Floats, r_m: Floats, luck: Floats, imminent: Floats, gamma: Floats,
    head: NDArray[np.int32], link: NDArray[np.int32], k: int, t: int, x0: float, y0: float, x: float, y: float,
) -> float:  # fmt: skip
    """Return the price of vehicle k's step from (x0, y0) in slot t - 1 to (x, y) in slot t.

    In every uneven execution of two steps the difference of the positions stays in a parallelogram: the
    slot QP grants both steps if and only if the parallelogram keeps its distance from the origin.
    """
    price = 0.0
    i, j = cell_of(rules, 0.5 * (x0 + x), 0.5 * (y0 + y))
    entry = head[t, i * rules.columns + j]
    ax, ay = x - x0, y - y0
    while entry >= 0:
        other = entry >> ENTRY_BITS
        ox, oy = track[other, t - 1, 0], track[other, t - 1, 1]
        bx, by = ox - track[other, t, 0], oy - track[other, t, 1]
        px, py = x0 - ox, y0 - oy
        mx, my = px + 0.5 * (ax + bx), py + 0.5 * (ay + by)
        far = r_m[k] + r_m[other] + rules.delta_m + rules.longest_m
        if mx * mx + my * my < far * far and other != k:
            lack = separation(rules, start_m, r_m, k, other) - math.sqrt(clearance(px, py, ax, ay, bx, by))
            if lack > 0.0:
                price += toll(rules, luck, imminent, r_m, k, other, t, lack)
        entry = link[t, entry]
    return float(price * gamma[t])


@inner
def first_conflict(world: World, k: int, track: Floats) -> int:
    """Return the first slot with a conflict of vehicle k's track, W + 1 if there is none."""
    rules, tracks, start_m, r_m, luck = world.rules, world.track, world.start_m, world.r_m, world.luck
    imminent, gamma, head, link = world.imminent, world.gamma, world.head, world.link
    walled = world.walls.a_m.shape[0] > 0 or world.barred.edge.shape[0] > 0
    for t in range(1, track.shape[0]):
        x0, y0, x, y = track[t - 1, 0], track[t - 1, 1], track[t, 0], track[t, 1]
        if step_conflict(rules, tracks, start_m, r_m, luck, imminent, gamma, head, link, k, t, x0, y0, x, y) > 0.0:
            return t
        if walled and still_conflict(world, k, x0, y0, x, y) > 0.0:
            return t
    return len(track)


@inner
def towards(x: float, y: float, tx: float, ty: float, slots: int, u_max: float) -> tuple[float, float, float, bool]:
    """Return the end of one slot's step towards (tx, ty) in `slots` slots, its length, and True if it arrives."""
    dx, dy = tx - x, ty - y
    distance = norm(dx, dy)
    step = min(distance / slots, u_max)
    if step >= distance:
        return tx, ty, distance, True
    if step > 0.0:
        x += dx * (step / distance)
        y += dy * (step / distance)
    return x, y, step, False


@inner
def fly(world: World, k: int, count: int, slot: Ints, point_m: Floats, track: Floats) -> None:
    """Compute the track of a plan: constant speed between way points, then straight to the goal at full speed.

    The vehicle flies at full speed to a way point that it cannot reach in time.
    """
    x, y = world.start_m[k, 0], world.start_m[k, 1]
    track[0, 0], track[0, 1] = x, y
    n = 0
    for t in range(1, track.shape[0]):
        tx, ty, slots = world.goal_m[k, 0], world.goal_m[k, 1], 1
        if n < count:
            tx, ty, slots = point_m[n, 0], point_m[n, 1], max(slot[n] - t + 1, 1)
        x, y, _, arrived = towards(x, y, tx, ty, slots, world.u_max_m[k])
        if arrived and n < count and slot[n] <= t:
            n += 1
        track[t, 0], track[t, 1] = x, y


@inner
def push(f: Floats, v: Ints, size: int, cost: float, node: int) -> int:
    """Add to the binary heap (f costs, v nodes), ordered by (cost, node); return the new size."""
    i = size
    while i > 0:
        up = (i - 1) // 2
        if f[up] < cost or (f[up] == cost and v[up] <= node):
            break
        f[i], v[i] = f[up], v[up]
        i = up
    f[i], v[i] = cost, node
    return size + 1


@inner
def pop(f: Floats, v: Ints, size: int) -> int:
    """Remove the least element, which the caller has read from place 0; return the new size."""
    size -= 1
    cost, node = f[size], v[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        right = child + 1
        if right < size and (f[right] < f[child] or (f[right] == f[child] and v[right] < v[child])):
            child = right
        if cost < f[child] or (cost == f[child] and node <= v[child]):
            break
        f[i], v[i] = f[child], v[child]
        i = child
    f[i], v[i] = cost, node
    return size


@inner
def search(  # noqa: PLR0912, PLR0915 (one loop: splitting it costs a third of the speed)
    world: World, scratch: Scratch, limits: Limits, k: int, bound: float, slot: Ints, point_m: Floats
) -> tuple[int, int, float]:
    """Search the space-time lattice about vehicle k by A*; price a node only when it leaves the heap first.

    Writes the way points of the path and returns their number, the number of expansions and the
    path's lattice cost. The search skips nodes that cannot lead to a path of at most `bound`. Nodes are
    (layer, a, b); the spacing makes the longest move two full steps.
    """
    layers, side, limit = limits.layers, limits.side, limits.expand
    rules, tracks, start_m, r_m, luck = world.rules, world.track, world.start_m, world.r_m, world.luck
    imminent, gamma, head, link = world.imminent, world.gamma, world.head, world.link
    stamp, cost, price, parent = scratch.stamp, scratch.cost, scratch.price, scratch.parent
    heap_cost, heap_node = scratch.heap_cost, scratch.heap_node
    move, move_length, guards = scratch.move, scratch.move_length, scratch.guards
    walls, barred = world.walls, world.barred
    walled, zoned = walls.a_m.shape[0] > 0, barred.edge.shape[0] > 0
    half = side // 2
    area = side * side
    last = tracks.shape[1] - 1
    sx, sy = start_m[k, 0], start_m[k, 1]
    spacing = 2.0 * world.u_max_m[k] / math.sqrt(20.0)
    ga = round(min(max((world.goal_m[k, 0] - sx) / spacing, -1e6), 1e6))
    gb = round(min(max((world.goal_m[k, 1] - sy) / spacing, -1e6), 1e6))
    unit = spacing / world.u_max_m[k]
    wt, wd = world.weight[k, 0], world.weight[k, 1]
    true_per_cell = (wt + wd) * unit
    per_cell = limits.greed * true_per_cell
    scratch.epoch[0] += CLOSED + 1
    epoch = scratch.epoch[0]
    node = half * side + half
    stamp[node] = epoch + PRICED
    cost[node] = 0.0
    parent[node] = -1
    size = push(heap_cost, heap_node, NONE, per_cell * norm(ga, gb), node)
    spent = 0
    while size > 0:
        node, promised = heap_node[0], heap_cost[0]
        size = pop(heap_cost, heap_node, size)
        state = stamp[node] - epoch
        if state == CLOSED:
            continue
        layer = node // area
        a = (node // side) % side - half
        b = node % side - half
        ahead = per_cell * norm(a - ga, b - gb)
        if promised != cost[node] + ahead:
            continue  # The heap has a newer entry of this node, with another cost.
        if state == OPEN:
            x, y = sx + a * spacing, sy + b * spacing
            here = 0.0
            if layer == 1 and imminent[k] >= UNYIELDING:
                # Only the start leads here, so both steps are known; their end may be free, but not the way.
                x0, y0 = sx, sy
                for t in (1, 2):
                    x1, y1 = sx + 0.5 * t * (x - sx), sy + 0.5 * t * (y - sy)
                    here += step_conflict(
                        rules, tracks, start_m, r_m, luck, imminent, gamma, head, link, k, t, x0, y0, x1, y1
                    )
                    if walled or zoned:
                        here += still_conflict(world, k, x0, y0, x1, y1)
                    x0, y0 = x1, y1
            else:
                # A layer is two slots: the three nearest slots stand for it.
                for t in range(2 * layer - 1, min(2 * layer + 1, last) + 1):
                    here += conflict_at(rules, tracks, start_m, r_m, luck, imminent, gamma, head, link, k, t, x, y)
                still = wall_conflict(rules, walls, k, x, y, x, y) if walled else 0.0
                if zoned:
                    still += barrier_conflict(barred, rules, r_m[k], sx, sy, x, y, x, y)
                here += (min(1, last - 2 * layer) + 2) * still
                here *= 2.0 / 3.0
            price[node] = here
            stamp[node] = epoch + PRICED
            if here > 0.0:
                cost[node] += price[node]
                size = push(heap_cost, heap_node, size, cost[node] + ahead, node)
                continue
        stamp[node] = epoch + CLOSED
        if layer == layers or spent >= limit:
            break
        spent += 1
        at_goal = a == ga and b == gb
        so_far = cost[node]
        px, py = sx + a * spacing, sy + b * spacing
        guarded = NONE
        if zoned:
            far = 2 * world.u_max_m[k]
            guarded = near_barriers(barred, rules.delta_m, r_m[k], far, sx, sy, px, py, guards)
        for m in range(len(move_length)):
            na = a + move[m, 0]
            nb = b + move[m, 1]
            if abs(na) > half or abs(nb) > half:
                continue
            after = (layer + 1) * area + (na + half) * side + nb + half
            state = stamp[after] - epoch
            if state == CLOSED:
                continue
            g = so_far + wd * move_length[m] * unit
            if na != ga or nb != gb:
                g += 2.0 * wt
            elif not at_goal:
                g += wt * move_length[m] * unit
            if state == PRICED:
                g += price[after]
            elif state < OPEN:
                stamp[after] = epoch
                cost[after] = np.inf
            if g < cost[after]:
                away = norm(na - ga, nb - gb)
                leads_on = g + true_per_cell * away <= bound
                if not leads_on and state != PRICED:
                    continue
                # Last, since it costs most.
                if guarded > 0 and m > 0 and bars_move(guards, guarded, px, py, sx + na * spacing, sy + nb * spacing):
                    continue
                cost[after] = g
                parent[after] = m
                if leads_on:
                    size = push(heap_cost, heap_node, size, g + per_cell * away, after)
    found = cost[node]
    count = node // area
    for n in range(count - 1, -1, -1):
        a = (node // side) % side - half
        b = node % side - half
        slot[n] = 2 * (n + 1)
        point_m[n, 0], point_m[n, 1] = sx + a * spacing, sy + b * spacing
        if a == ga and b == gb:
            point_m[n, 0], point_m[n, 1] = world.goal_m[k, 0], world.goal_m[k, 1]
        m = parent[node]
        node = (n * side + a - move[m, 0] + half) * side + b - move[m, 1] + half
    return count, spent, found


@inner
def refly(world: World, k: int, draft: Draft, count: int, n: int, shift: int) -> tuple[int, int, float]:
    """Fly the slots that a change at way point n affects, first <= t < end, and add up their cost without conflicts.

    The cost includes all slots before and after, unchanged. The new track ends where it meets the
    old one: at the same point, on the way to the same way point.
    """
    slot, point_m, track, aim = draft.slot, draft.point_m, draft.track, draft.aim
    effort, price = draft.effort, draft.price
    new_track, new_aim, new_effort = draft.new_track, draft.new_aim, draft.new_effort
    gx, gy = world.goal_m[k, 0], world.goal_m[k, 1]
    u_max, wt, wd = world.u_max_m[k], world.weight[k, 0], world.weight[k, 1]
    last = track.shape[0] - 1
    first, total = 1, 0.0
    while first <= last and aim[first] < n:
        total += effort[first] + price[first]
        first += 1
    x, y = track[first - 1, 0], track[first - 1, 1]
    i = n
    for t in range(first, last + 1):
        passed = i > n or shift < 0
        if passed and aim[t] + shift == i and x == track[t - 1, 0] and y == track[t - 1, 1]:
            for later in range(t, last + 2):
                total += effort[later] + price[later]
            return first, t, total
        tx, ty, slots = gx, gy, 1
        if i < count:
            tx, ty, slots = point_m[i, 0], point_m[i, 1], max(slot[i] - t + 1, 1)
        new_aim[t] = i
        x, y, step, arrived = towards(x, y, tx, ty, slots, u_max)
        if arrived and i < count and slot[i] <= t:
            i += 1
        there = abs(x - gx) < AT_GOAL_M and abs(y - gy) < AT_GOAL_M
        new_track[t, 0], new_track[t, 1] = x, y
        new_effort[t] = wt * (step / u_max if there else 1.0) + wd * step / u_max
        total += new_effort[t]
    new_effort[last + 1] = (wt + wd) * norm(x - gx, y - gy) / u_max
    return first, last + 1, total + new_effort[last + 1]


@inner
def reprice(world: World, k: int, draft: Draft, first: int, end: int, total: float, limit: float) -> float:
    """Add the conflicts of the newly flown slots to their cost; return infinity as soon as it exceeds `limit`."""
    rules, tracks, start_m, r_m, luck = world.rules, world.track, world.start_m, world.r_m, world.luck
    imminent, gamma, head, link = world.imminent, world.gamma, world.head, world.link
    track, price = draft.new_track, draft.new_price
    walls, barred, sx, sy = world.walls, world.barred, start_m[k, 0], start_m[k, 1]
    walled, zoned = walls.a_m.shape[0] > 0, barred.edge.shape[0] > 0
    x0, y0 = draft.track[first - 1, 0], draft.track[first - 1, 1]
    for t in range(first, end):
        if total > limit:
            break
        x, y = track[t, 0], track[t, 1]
        price[t] = step_conflict(rules, tracks, start_m, r_m, luck, imminent, gamma, head, link, k, t, x0, y0, x, y)
        still = wall_conflict(rules, walls, k, x0, y0, x, y) if walled else 0.0
        if zoned:
            still += barrier_conflict(barred, rules, r_m[k], sx, sy, x0, y0, x, y)
        price[t] += still
        total += price[t]
        draft.work[0] += 1
        x0, y0 = x, y
    return total if total <= limit else np.inf


@inner
def attempt(world: World, k: int, draft: Draft, count: int, n: int, shift: int, limit: float) -> float:
    """Return the cost of the draft with a change at way point n, or infinity if it exceeds `limit`.

    `shift` says if way point n was MOVED, INSERTED or DROPPED. Within the limit the draft
    takes the change; otherwise the caller restores its way points.
    """
    first, end, total = refly(world, k, draft, count, n, shift)
    total = reprice(world, k, draft, first, end, total, limit)
    if total == np.inf:
        return total
    for t in range(first, end):
        draft.track[t, 0], draft.track[t, 1] = draft.new_track[t, 0], draft.new_track[t, 1]
        draft.aim[t], draft.effort[t], draft.price[t] = draft.new_aim[t], draft.new_effort[t], draft.new_price[t]
    last = draft.track.shape[0] - 1
    for t in range(end, last + 1):
        draft.aim[t] += shift
    if end > last:
        draft.effort[last + 1] = draft.new_effort[last + 1]
    return total


@inner
def begin(world: World, k: int, draft: Draft, count: int) -> float:
    """Fly and price the whole draft; return its cost."""
    draft.aim[:] = 0
    draft.price[-1] = 0.0
    draft.track[0, 0], draft.track[0, 1] = world.start_m[k, 0], world.start_m[k, 1]
    return attempt(world, k, draft, count, NONE, MOVED, np.inf)


@inner
def drop(count: int, slot: Ints, point_m: Floats, n: int) -> None:
    """Remove way point n."""
    for i in range(n, count - 1):
        slot[i] = slot[i + 1]
        point_m[i, 0], point_m[i, 1] = point_m[i + 1, 0], point_m[i + 1, 1]


@inner
def insert(count: int, slot: Ints, point_m: Floats, n: int, s: int, x: float, y: float) -> None:
    """Add a way point before n, as number n."""
    for i in range(count, n, -1):
        slot[i] = slot[i - 1]
        point_m[i, 0], point_m[i, 1] = point_m[i - 1, 0], point_m[i - 1, 1]
    slot[n] = s
    point_m[n, 0], point_m[n, 1] = x, y


@inner
def pull(world: World, k: int, draft: Draft, count: int, cost: float) -> tuple[int, float]:
    """String pulling in space and time: drop each way point, last first, if the cost does not rise."""
    slot, point_m = draft.slot, draft.point_m
    for n in range(count - 1, -1, -1):
        s, x, y = slot[n], point_m[n, 0], point_m[n, 1]
        drop(count, slot, point_m, n)
        trial = attempt(world, k, draft, count - 1, n, DROPPED, cost + TIE)
        if trial < np.inf:
            cost = trial
            count -= 1
        else:
            insert(count - 1, slot, point_m, n, s, x, y)
    return count, cost


@inner
def chord(world: World, k: int, draft: Draft, count: int, n: int) -> tuple[float, float, float, float]:
    """Return the position of way point n without a detour, and the direction of flight there (a unit vector)."""
    slot, point_m = draft.slot, draft.point_m
    s, x, y = slot[n], point_m[n, 0], point_m[n, 1]
    s0, x0, y0 = 0, world.start_m[k, 0], world.start_m[k, 1]
    if n > 0:
        s0, x0, y0 = slot[n - 1], point_m[n - 1, 0], point_m[n - 1, 1]
    x1, y1 = world.goal_m[k, 0], world.goal_m[k, 1]
    span = norm(x1 - x, y1 - y) / world.u_max_m[k]
    if n + 1 < count:
        x1, y1, span = point_m[n + 1, 0], point_m[n + 1, 1], float(slot[n + 1] - s)
    share = (s - s0) / max(s - s0 + span, 1.0)
    dx, dy = x1 - x0, y1 - y0
    length = norm(dx, dy)
    if length < 1e-9:
        return x0, y0, 1.0, 0.0
    return x0 + share * dx, y0 + share * dy, dx / length, dy / length


@inner
def tighten(world: World, k: int, draft: Draft, count: int, n: int, cost: float) -> float:
    """Move way point n towards its chord, by bisection, as far as the cost does not rise."""
    point_m = draft.point_m
    cx, cy, _, _ = chord(world, k, draft, count, n)
    x, y = point_m[n, 0], point_m[n, 1]
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        point_m[n, 0], point_m[n, 1] = x + share * (cx - x), y + share * (cy - y)
        trial = attempt(world, k, draft, count, n, MOVED, cost - GAIN)
        if trial < np.inf:
            cost = trial
            low = share
        else:
            high = share
    point_m[n, 0], point_m[n, 1] = x + low * (cx - x), y + low * (cy - y)
    return cost


@inner
def nudge(world: World, k: int, draft: Draft, count: int, n: int, cost: float, step_m: float) -> float:
    """Move way point n along its chord, across it and in time, each while the cost falls."""
    slot, point_m = draft.slot, draft.point_m
    _, _, ux, uy = chord(world, k, draft, count, n)
    for d in range(6):
        for _ in range(REPEATS):
            s, x, y = slot[n], point_m[n, 0], point_m[n, 1]
            if d < 2:
                sign = step_m if d == 0 else -step_m
                point_m[n, 0], point_m[n, 1] = x - uy * sign, y + ux * sign
            elif d < 4:
                sign = step_m if d == 2 else -step_m
                point_m[n, 0], point_m[n, 1] = x + ux * sign, y + uy * sign
            else:
                slot[n] = s + (1 if d == 4 else -1)
                early = slot[n] < 1 or (n > 0 and slot[n] <= slot[n - 1])
                if early or (n + 1 < count and slot[n] >= slot[n + 1]):
                    slot[n] = s
                    break
            trial = attempt(world, k, draft, count, n, MOVED, cost - GAIN)
            if trial == np.inf:
                slot[n], point_m[n, 0], point_m[n, 1] = s, x, y
                break
            cost = trial
    return cost


@inner
def polish(
    world: World, k: int, draft: Draft, count: int, cost: float, rounds: int, step_m: float
) -> tuple[int, float]:
    """Improve the way points by local search: drop, tighten and nudge them while the cost falls."""
    for _ in range(rounds):
        before = cost
        count, cost = pull(world, k, draft, count, cost)
        for n in range(count):
            cost = tighten(world, k, draft, count, n, cost)
            cost = nudge(world, k, draft, count, n, cost, step_m)
        step_m *= 0.5
        if cost > before - 0.01:
            break
    return count, cost


@inner
def opponent(world: World, k: int, t: int, x: float, y: float) -> int:
    """Return the vehicle nearest to (x, y) in slot t that can be in conflict with k there, or -1."""
    rules, head, link, track = world.rules, world.head, world.link, world.track
    i, j = cell_of(rules, x, y)
    entry = head[t, i * rules.columns + j]
    nearest = -1
    least = np.inf
    while entry >= 0:
        other = entry >> ENTRY_BITS
        dx, dy = x - track[other, t, 0], y - track[other, t, 1]
        reach = world.r_m[k] + world.r_m[other] + rules.delta_m + (world.u_max_m[k] + world.u_max_m[other])
        squared = dx * dx + dy * dy
        if other != k and squared < reach * reach and squared < least:
            nearest, least = other, squared
        entry = link[t, entry]
    return nearest


@inner
def sidestep(world: World, k: int, turn: float, draft: Draft) -> tuple[int, float]:
    """Plan to pass each opponent in turn on one side (turn = 1 or -1); return the plan's way points and cost.

    While the track is in conflict, it adds a way point at the conflict's deepest slot, beside the
    opponent, across the relative motion, just out of reach.
    """
    count = 0
    slot, point_m, track, price = draft.slot, draft.point_m, draft.track, draft.price
    cost = begin(world, k, draft, NONE)
    for _ in range(SIDESTEPS):
        t = 1
        while t < track.shape[0] and price[t] == 0.0:
            t += 1
        if t >= track.shape[0]:
            break
        other = opponent(world, k, t, track[t, 0], track[t, 1])
        if other < 0:
            break
        reach = world.r_m[k] + world.r_m[other] + world.rules.delta_m
        least = norm(track[t, 0] - world.track[other, t, 0], track[t, 1] - world.track[other, t, 1])
        while t + 1 < track.shape[0]:
            x, y = track[t + 1, 0] - world.track[other, t + 1, 0], track[t + 1, 1] - world.track[other, t + 1, 1]
            if norm(x, y) >= least:
                break
            least = norm(x, y)
            t += 1
        vx = track[t, 0] - track[t - 1, 0] - world.track[other, t, 0] + world.track[other, t - 1, 0]
        vy = track[t, 1] - track[t - 1, 1] - world.track[other, t, 1] + world.track[other, t - 1, 1]
        speed = norm(vx, vy)
        if speed < 1e-9:
            break
        n = NONE
        while n < count and slot[n] < t:
            n += 1
        if n < count and slot[n] == t:
            break
        scale = turn * SIDE * reach / speed
        insert(count, slot, point_m, n, t, world.track[other, t, 0] - vy * scale, world.track[other, t, 1] + vx * scale)
        count += 1
        cost = attempt(world, k, draft, count, n, INSERTED, np.inf)
        cost = nudge(world, k, draft, count, n, cost, 0.4 * world.u_max_m[k])
    return count, cost


@inner
def load(plans: Plans, k: int, draft: Draft) -> int:
    """Copy vehicle k's plan into the draft; return its number of way points."""
    for n in range(plans.size[k]):
        draft.slot[n] = plans.slot[k, n]
        draft.point_m[n, 0], draft.point_m[n, 1] = plans.point_m[k, n, 0], plans.point_m[k, n, 1]
    return int(plans.size[k])


@inner
def install(world: World, plans: Plans, k: int, count: int, draft: Draft) -> None:
    """Make the draft vehicle k's plan and track."""
    plans.size[k] = count
    plans.delay[k] = 0
    for n in range(count):
        plans.slot[k, n] = draft.slot[n]
        plans.point_m[k, n, 0], plans.point_m[k, n, 1] = draft.point_m[n, 0], draft.point_m[n, 1]
    register(world, k, ABSENT)
    for t in range(draft.track.shape[0]):
        world.track[k, t, 0], world.track[k, t, 1] = draft.track[t, 0], draft.track[t, 1]
    register(world, k, PRESENT)


@inner
def replan(world: World, plans: Plans, scratch: Scratch, draft: Draft, limits: Limits, k: int) -> None:
    """Replace UAV k's plan by its best response to all other tracks."""
    step_m = 0.4 * world.u_max_m[k]
    straight = begin(world, k, draft, NONE)
    conflict = sum_of(draft.price)
    if conflict == 0.0:
        if plans.size[k] > 0:
            install(world, plans, k, NONE, draft)
        return
    cost, plain = straight, straight - conflict
    if plans.size[k] > 0:
        count = load(plans, k, draft)
        cost = begin(world, k, draft, count)
        if sum_of(draft.price) == 0.0:
            count, better = polish(world, k, draft, count, cost, ONCE, 0.5 * step_m)
            if better < cost:
                install(world, plans, k, count, draft)
            return
    if draft.work[0] >= limits.budget:
        return
    if plans.size[k] > 0 and straight <= cost:
        cost = begin(world, k, draft, NONE)
        install(world, plans, k, NONE, draft)
    free = False
    for turn in (1.0, -1.0):
        count, trial = sidestep(world, k, turn, draft)
        count, trial = polish(world, k, draft, count, trial, limits.rounds, step_m)
        if trial < cost:
            cost = trial
            free = sum_of(draft.price) == 0.0
            install(world, plans, k, count, draft)
    if free and cost < plain + limits.easy:
        return
    count, spent, _ = search(world, scratch, limits, k, cost + SLACK, draft.slot, draft.point_m)
    draft.work[0] += EXPANSION * spent
    trial = begin(world, k, draft, count)
    count, trial = polish(world, k, draft, count, trial, limits.rounds, step_m)
    if trial < cost:
        install(world, plans, k, count, draft)


@compiled
def urgencies(world: World, uav: Ints, slot_now: int, seed: int, urgency: Floats) -> None:
    """Write the first slot of conflict of each UAV, earliest most urgent; chance decides among equals."""
    for k in range(len(uav)):
        urgency[k] = first_conflict(world, k, world.track[k]) + 0.5 * uniform(seed, slot_now, uav[k])


@compiled
def sweep(
    world: World, plans: Plans, scratch: Scratch, draft: Draft, limits: Limits, urgency: Floats, order: Ints
) -> None:
    """Run one round of best responses in this order; `draft.work` counts the priced steps."""
    draft.work[0] = 0
    for k in order:
        if urgency[k] < world.track.shape[1] or plans.size[k] > 0:
            replan(world, plans, scratch, draft, limits, k)


@inner
def put_off(world: World, plans: Plans, k: int, most: int) -> None:
    """Drop the way points that are reached; delay a plan that the vehicle can no longer fly in time.

    A plan with more than `most` slots of delay in all is dropped.
    """
    u_max = world.u_max_m[k]
    while plans.size[k] > 0:
        x = plans.point_m[k, 0, 0] - world.start_m[k, 0]
        y = plans.point_m[k, 0, 1] - world.start_m[k, 1]
        need = math.ceil(norm(x, y) / u_max - 0.02)
        if need > 0 or plans.slot[k, 0] > 0:
            behind = max(need - plans.slot[k, 0], 0)
            for n in range(plans.size[k]):
                plans.slot[k, n] += behind
            plans.delay[k] += behind
            break
        drop(plans.size[k], plans.slot[k], plans.point_m[k], NONE)
        plans.size[k] -= 1
    if plans.delay[k] > most:
        plans.size[k] = 0
        plans.delay[k] = 0


@compiled
def populate(world: World, plans: Plans, most: int) -> None:
    """Fill the grid: every UAV flies its plan."""
    world.head[:] = -1
    for k in range(world.track.shape[0]):
        put_off(world, plans, k, most)
        fly(world, k, plans.size[k], plans.slot[k], plans.point_m[k], world.track[k])
        register(world, k, PRESENT)
