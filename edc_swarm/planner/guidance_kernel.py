"""Compiled part of the guidance: see `edc_swarm.planner.guidance` for the theory.

Everything here is plain loops over arrays, deterministic: no fast-math, no threads, random numbers
from a hash, effort counted in expansions.

Names: N vehicles (UAVs first, then obstacles that never move), W slots of look-ahead, M lattice
layers (two slots each), P way points a plan can have.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ARRIVED_M = 1e-9
OPEN, PRICED, CLOSED = 0, 1, 2
SIDESTEPS = 3
"""Opponents that one plan passes at most without a search."""
SLACK = 1.0
"""Slots by which way points off the lattice may be cheaper than on it."""


class Rules(NamedTuple):
    """Numbers that price a plan, and the grid's shape; see `edc_swarm.planner.guidance`."""

    u_max_m: float
    weight_time: float
    weight_distance: float
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


class World(NamedTuple):
    """What a plan is judged against.

    track (N, W+1, 2) predicted positions in metres, one a slot; start_m (N, 2); goal_m (N, 2);
    r_m (N,); luck (N,) lateness drawn for right of way; gamma (W+1,) discount of a conflict;
    head (W+1, cells) and link (W+1, 9 N) linked lists, for each slot and square cell, of the vehicles
    that can be touched from there (entry 9 l + i is vehicle l's i-th cell).

    Loops unpack the arrays they use first: reading them from the tuple each time costs more than
    all the arithmetic.
    """

    track: Floats
    start_m: Floats
    goal_m: Floats
    r_m: Floats
    luck: Floats
    gamma: Floats
    head: NDArray[np.int32]
    link: NDArray[np.int32]
    rules: Rules


class Plans(NamedTuple):
    """Way points of every UAV: size (n,), slot (n, P) from now, point (n, P, 2).

    `delay` (n,) counts the slots by which a plan had to be put off since it was made.
    """

    size: Ints
    delay: Ints
    slot: Ints
    point_m: Floats


class Scratch(NamedTuple):
    """Work space of the lattice search, kept from call to call.

    `stamp` of a node less the call's epoch is OPEN, PRICED (its own conflicts are in its cost) or
    CLOSED; anything less belongs to an earlier call.
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


@njit(cache=True)
def uniform(seed: int, a: int, b: int) -> float:
    """Number in [0, 1) from a hash of three integers (splitmix64 finaliser, thrice)."""
    z = np.uint64(0)
    for value in (seed, a, b):
        z = (z ^ np.uint64(value)) + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True)
def norm(x: float, y: float) -> float:
    """Length of a vector; several times faster than hypot, and nothing here is near overflow."""
    return math.sqrt(x * x + y * y)


@njit(cache=True)
def cell_of(rules: Rules, x: float, y: float) -> tuple[int, int]:
    """Cell of a point; points outside the grid count as in its border cells."""
    i = int((x - rules.low_x_m) * rules.per_cell)
    j = int((y - rules.low_y_m) * rules.per_cell)
    return min(max(i, 0), rules.rows - 1), min(max(j, 0), rules.columns - 1)


@njit(cache=True)
def enter(world: World, k: int) -> None:
    """Put vehicle k's track into the grid: into every cell that its reach touches in each slot."""
    rules, track, head, link = world.rules, world.track[k], world.head, world.link
    for t in range(track.shape[0]):
        i, j = cell_of(rules, track[t, 0], track[t, 1])
        entry = 9 * k
        for a in range(max(i - 1, 0), min(i + 2, rules.rows)):
            for b in range(max(j - 1, 0), min(j + 2, rules.columns)):
                c = a * rules.columns + b
                link[t, entry] = head[t, c]
                head[t, c] = entry
                entry += 1


@njit(cache=True)
def leave(world: World, k: int) -> None:
    """Take vehicle k's track out of the grid."""
    rules, track, head, link = world.rules, world.track[k], world.head, world.link
    for t in range(track.shape[0]):
        i, j = cell_of(rules, track[t, 0], track[t, 1])
        entry = 9 * k
        for a in range(max(i - 1, 0), min(i + 2, rules.rows)):
            for b in range(max(j - 1, 0), min(j + 2, rules.columns)):
                c = a * rules.columns + b
                if head[t, c] == entry:
                    head[t, c] = link[t, entry]
                else:
                    other = head[t, c]
                    while link[t, other] != entry:
                        other = link[t, other]
                    link[t, other] = link[t, entry]
                entry += 1


@njit(cache=True)
def conflict_at(
    rules: Rules, track: Floats, start_m: Floats, r_m: Floats, luck: Floats, gamma: Floats,
    head: NDArray[np.int32], link: NDArray[np.int32], k: int, t: int, x: float, y: float,
) -> float:  # fmt: skip
    """Price of vehicle k being at (x, y) in slot t; the arrays are those of `World`."""
    price = 0.0
    i, j = cell_of(rules, x, y)
    entry = head[t, i * rules.columns + j]
    while entry >= 0:
        other = entry // 9
        dx = x - track[other, t, 0]
        dy = y - track[other, t, 1]
        radii = r_m[k] + r_m[other]
        reach = radii + rules.delta_m
        squared = dx * dx + dy * dy
        if squared < reach * reach and other != k:
            distance = math.sqrt(squared)
            apart = 0.9995 * norm(start_m[k, 0] - start_m[other, 0], start_m[k, 1] - start_m[other, 1])
            apart = min(reach, apart)
            if distance < apart:
                way = (luck[other] + rules.patience) / (luck[k] + rules.patience)
                way = min(max(way, 1.0 / rules.cap), rules.cap)
                price += way * (rules.touch + rules.depth * (apart - distance) / radii)
        entry = link[t, entry]
    return float(price * gamma[t])


@njit(cache=True)
def conflict(world: World, k: int, track: Floats) -> float:
    """Price of all conflicts of a track (W+1, 2) of vehicle k."""
    rules, tracks, start_m, r_m, luck = world.rules, world.track, world.start_m, world.r_m, world.luck
    gamma, head, link = world.gamma, world.head, world.link
    price = 0.0
    for t in range(1, track.shape[0]):
        price += conflict_at(rules, tracks, start_m, r_m, luck, gamma, head, link, k, t, track[t, 0], track[t, 1])
    return price


@njit(cache=True)
def first_conflict(world: World, k: int, track: Floats) -> int:
    """First slot in which the track of vehicle k is in conflict, W + 1 if there is none."""
    rules, tracks, start_m, r_m, luck = world.rules, world.track, world.start_m, world.r_m, world.luck
    gamma, head, link = world.gamma, world.head, world.link
    for t in range(1, track.shape[0]):
        x, y = track[t, 0], track[t, 1]
        if conflict_at(rules, tracks, start_m, r_m, luck, gamma, head, link, k, t, x, y) > 0.0:
            return t
    return len(track)


@njit(cache=True)
def effort(world: World, k: int, track: Floats) -> float:
    """Time and distance of a track, the straight rest beyond the look-ahead included, in slots.

    A slot costs weight_time unless it is spent at the goal, and weight_distance for each full step
    flown; the step that arrives costs its share of a slot.
    """
    gx, gy = world.goal_m[k, 0], world.goal_m[k, 1]
    rules = world.rules
    last = track.shape[0] - 1
    time = 0.0
    path = 0.0
    for t in range(1, last + 1):
        step = norm(track[t, 0] - track[t - 1, 0], track[t, 1] - track[t - 1, 1])
        path += step
        there = abs(track[t, 0] - gx) < ARRIVED_M and abs(track[t, 1] - gy) < ARRIVED_M
        time += step / rules.u_max_m if there else 1.0
    rest = norm(track[last, 0] - gx, track[last, 1] - gy)
    time += rest / rules.u_max_m
    path += rest
    return rules.weight_time * time + rules.weight_distance * path / rules.u_max_m


@njit(cache=True)
def cost_of(world: World, k: int, track: Floats, bound: float) -> float:
    """What is minimised: effort plus conflicts; or just any number above `bound` if it is above."""
    rules, tracks, start_m, r_m, luck = world.rules, world.track, world.start_m, world.r_m, world.luck
    gamma, head, link = world.gamma, world.head, world.link
    cost = effort(world, k, track)
    for t in range(1, track.shape[0]):
        if cost > bound:
            break
        x, y = track[t, 0], track[t, 1]
        cost += conflict_at(rules, tracks, start_m, r_m, luck, gamma, head, link, k, t, x, y)
    return cost


@njit(cache=True)
def fly(world: World, k: int, count: int, slot: Ints, point_m: Floats, track: Floats) -> None:
    """Track of a plan: constant speed between way points, then straight to the goal at full speed.

    A way point that cannot be reached in time is flown to at full speed all the same.
    """
    x, y = world.start_m[k, 0], world.start_m[k, 1]
    gx, gy = world.goal_m[k, 0], world.goal_m[k, 1]
    u_max = world.rules.u_max_m
    track[0, 0], track[0, 1] = x, y
    n = 0
    for t in range(1, track.shape[0]):
        if n < count:
            tx, ty = point_m[n, 0], point_m[n, 1]
            slots = max(slot[n] - t + 1, 1)
        else:
            tx, ty = gx, gy
            slots = 1
        dx, dy = tx - x, ty - y
        distance = norm(dx, dy)
        step = min(distance / slots, u_max)
        if step >= distance:
            x, y = tx, ty
            if n < count and slot[n] <= t:
                n += 1
        elif step > 0.0:
            x += dx * (step / distance)
            y += dy * (step / distance)
        track[t, 0], track[t, 1] = x, y


@njit(cache=True)
def push(f: Floats, v: Ints, size: int, cost: float, node: int) -> int:
    """Add to the binary heap (f costs, v nodes), ordered by (cost, node); returns the new size."""
    i = size
    while i > 0:
        up = (i - 1) // 2
        if f[up] < cost or (f[up] == cost and v[up] <= node):
            break
        f[i], v[i] = f[up], v[up]
        i = up
    f[i], v[i] = cost, node
    return size + 1


@njit(cache=True)
def pop(f: Floats, v: Ints, size: int) -> int:
    """Remove the least element, which the caller has read from place 0; returns the new size."""
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


@njit(cache=True)
def search(  # noqa: PLR0912, PLR0915 (one loop: splitting it costs a third of the speed)
    world: World, scratch: Scratch, k: int, layers: int, side: int, greed: float, limit: int,
    bound: float, slot: Ints, point_m: Floats,
) -> tuple[int, int, float]:  # fmt: skip
    """A* over the space-time lattice about vehicle k, pricing a node only when it is first taken.

    Writes the way points of the path found and returns their number, the expansions spent and the
    path's lattice cost. Nodes that cannot lead to a path of at most `bound` are not entered. Nodes are
    (layer, a, b); the spacing makes the longest move two full steps.
    """
    rules, tracks, start_m, r_m, luck = world.rules, world.track, world.start_m, world.r_m, world.luck
    gamma, head, link = world.gamma, world.head, world.link
    stamp, cost, price, parent = scratch.stamp, scratch.cost, scratch.price, scratch.parent
    heap_cost, heap_node = scratch.heap_cost, scratch.heap_node
    move, move_length = scratch.move, scratch.move_length
    half = side // 2
    area = side * side
    last = tracks.shape[1] - 1
    sx, sy = start_m[k, 0], start_m[k, 1]
    spacing = 2.0 * rules.u_max_m / math.sqrt(20.0)
    ga = round(min(max((world.goal_m[k, 0] - sx) / spacing, -1e6), 1e6))
    gb = round(min(max((world.goal_m[k, 1] - sy) / spacing, -1e6), 1e6))
    unit = spacing / rules.u_max_m
    wt, wd = rules.weight_time, rules.weight_distance
    true_per_cell = (wt + wd) * unit
    per_cell = greed * true_per_cell
    scratch.epoch[0] += CLOSED + 1
    epoch = scratch.epoch[0]
    node = half * side + half
    stamp[node] = epoch + PRICED
    cost[node] = 0.0
    parent[node] = -1
    size = push(heap_cost, heap_node, 0, per_cell * norm(ga, gb), node)
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
            continue  # Entered at another cost since: a newer entry is in the heap.
        if state == OPEN:
            x, y = sx + a * spacing, sy + b * spacing
            here = 0.0
            # A layer is two slots: the three nearest slots stand for it.
            for t in range(2 * layer - 1, min(2 * layer + 1, last) + 1):
                here += conflict_at(rules, tracks, start_m, r_m, luck, gamma, head, link, k, t, x, y)
            price[node] = here * (2.0 / 3.0)
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
                cost[after] = g
                parent[after] = m
                away = norm(na - ga, nb - gb)
                if g + true_per_cell * away <= bound:
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


@njit(cache=True)
def drop(count: int, slot: Ints, point_m: Floats, n: int) -> None:
    """Remove way point n."""
    for i in range(n, count - 1):
        slot[i] = slot[i + 1]
        point_m[i, 0], point_m[i, 1] = point_m[i + 1, 0], point_m[i + 1, 1]


@njit(cache=True)
def restore(count: int, slot: Ints, point_m: Floats, n: int, s: int, x: float, y: float) -> None:
    """Insert a way point before n (the inverse of `drop`)."""
    for i in range(count - 1, n, -1):
        slot[i] = slot[i - 1]
        point_m[i, 0], point_m[i, 1] = point_m[i - 1, 0], point_m[i - 1, 1]
    slot[n] = s
    point_m[n, 0], point_m[n, 1] = x, y


@njit(cache=True)
def pull(
    world: World, k: int, count: int, slot: Ints, point_m: Floats, track: Floats, cost: float
) -> tuple[int, float]:
    """String pulling in space and time: drop each way point, last first, if the cost does not rise."""
    for n in range(count - 1, -1, -1):
        s, x, y = slot[n], point_m[n, 0], point_m[n, 1]
        drop(count, slot, point_m, n)
        fly(world, k, count - 1, slot, point_m, track)
        trial = cost_of(world, k, track, cost)
        if trial <= cost:
            cost = trial
            count -= 1
        else:
            restore(count, slot, point_m, n, s, x, y)
    return count, cost


@njit(cache=True)
def nudge(
    world: World, k: int, count: int, slot: Ints, point_m: Floats, track: Floats, cost: float,
    rounds: int, reach_m: float,
) -> float:  # fmt: skip
    """Pattern search: move each way point a little in space or time while the cost falls."""
    step = reach_m
    for _ in range(rounds):
        better = False
        for n in range(count):
            for d in range(6):
                s, x, y = slot[n], point_m[n, 0], point_m[n, 1]
                if d < 4:
                    point_m[n, 0] = x + (step if d == 0 else -step if d == 1 else 0.0)
                    point_m[n, 1] = y + (step if d == 2 else -step if d == 3 else 0.0)
                else:
                    slot[n] = s + (1 if d == 4 else -1)
                    early = slot[n] < 1 or (n > 0 and slot[n] <= slot[n - 1])
                    if early or (n + 1 < count and slot[n] >= slot[n + 1]):
                        slot[n] = s
                        continue
                fly(world, k, count, slot, point_m, track)
                trial = cost_of(world, k, track, cost)
                if trial < cost - 1e-9:
                    cost = trial
                    better = True
                else:
                    slot[n], point_m[n, 0], point_m[n, 1] = s, x, y
        if not better:
            step *= 0.5
    return cost


@njit(cache=True)
def opponent(world: World, k: int, t: int, x: float, y: float) -> int:
    """The vehicle nearest to (x, y) in slot t among those in conflict with k there, or -1."""
    rules, head, link, track = world.rules, world.head, world.link, world.track
    i, j = cell_of(rules, x, y)
    entry = head[t, i * rules.columns + j]
    nearest = -1
    least = 1.0e300
    while entry >= 0:
        other = entry // 9
        dx, dy = x - track[other, t, 0], y - track[other, t, 1]
        reach = world.r_m[k] + world.r_m[other] + rules.delta_m
        squared = dx * dx + dy * dy
        if other != k and squared < reach * reach and squared < least:
            nearest, least = other, squared
        entry = link[t, entry]
    return nearest


@njit(cache=True)
def sidestep(
    world: World, k: int, turn: float, slot: Ints, point_m: Floats, track: Floats, most: int, rounds: int
) -> tuple[int, float]:
    """Pass each opponent in turn on one side (turn = 1 or -1); way points and cost of the plan.

    While the track is in conflict, a way point is added at the conflict's deepest slot, beside the
    opponent, across the relative motion, just out of reach.
    """
    count = 0
    u_max = world.rules.u_max_m
    fly(world, k, 0, slot, point_m, track)
    cost = cost_of(world, k, track, np.inf)
    for _ in range(most):
        t = first_conflict(world, k, track)
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
        place = 0
        while place < count and slot[place] < t:
            place += 1
        if place < count and slot[place] == t:
            break
        scale = turn * 1.002 * reach / speed
        restore(
            count + 1, slot, point_m, place, t,
            world.track[other, t, 0] - vy * scale, world.track[other, t, 1] + vx * scale,
        )  # fmt: skip
        count += 1
        fly(world, k, count, slot, point_m, track)
        cost = cost_of(world, k, track, np.inf)
        cost = nudge(world, k, count, slot, point_m, track, cost, rounds, 0.4 * u_max)
        fly(world, k, count, slot, point_m, track)
    return count, cost


@njit(cache=True)
def install(world: World, plans: Plans, k: int, count: int, slot: Ints, point_m: Floats) -> None:
    """Make a plan vehicle k's own: way points, track and grid."""
    plans.size[k] = count
    plans.delay[k] = 0
    for n in range(count):
        plans.slot[k, n] = slot[n]
        plans.point_m[k, n, 0], plans.point_m[k, n, 1] = point_m[n, 0], point_m[n, 1]
    leave(world, k)
    fly(world, k, count, slot, point_m, world.track[k])
    enter(world, k)


@njit(cache=True)
def replan(
    world: World, plans: Plans, scratch: Scratch, k: int, layers: int, side: int, greed: float,
    limit: int, budget: int, rounds: int, easy: float, slot: Ints, point_m: Floats, track: Floats,
) -> int:  # fmt: skip
    """Best response of UAV k to all other tracks; returns the expansions spent."""
    fly(world, k, 0, slot, point_m, track)
    straight_conflict = conflict(world, k, track)
    if straight_conflict == 0.0:
        if plans.size[k] > 0:
            install(world, plans, k, 0, slot, point_m)
        return 0
    straight_cost = straight_conflict + effort(world, k, track)
    count = plans.size[k]
    for n in range(count):
        slot[n] = plans.slot[k, n]
        point_m[n, 0], point_m[n, 1] = plans.point_m[k, n, 0], plans.point_m[k, n, 1]
    now_conflict = conflict(world, k, world.track[k])
    cost = now_conflict + effort(world, k, world.track[k])
    if now_conflict == 0.0:
        count, pulled = pull(world, k, count, slot, point_m, track, cost)
        pulled = nudge(world, k, count, slot, point_m, track, pulled, 1, 0.2 * world.rules.u_max_m)
        if pulled < cost - 1e-9:
            install(world, plans, k, count, slot, point_m)
        return 0
    if budget <= 0:
        return 0
    if straight_cost <= cost:
        cost = straight_cost
        install(world, plans, k, 0, slot, point_m)
    plain = straight_cost - straight_conflict
    for turn in (1.0, -1.0):
        count, trial = sidestep(world, k, turn, slot, point_m, track, SIDESTEPS, rounds)
        if trial < cost:
            cost = trial
            install(world, plans, k, count, slot, point_m)
    if cost < plain + easy and conflict(world, k, world.track[k]) == 0.0:
        return 0
    count, spent, _ = search(world, scratch, k, layers, side, greed, limit, cost + SLACK, slot, point_m)
    fly(world, k, count, slot, point_m, track)
    trial = cost_of(world, k, track, np.inf)
    count, trial = pull(world, k, count, slot, point_m, track, trial)
    trial = nudge(world, k, count, slot, point_m, track, trial, rounds, 0.4 * world.rules.u_max_m)
    count, trial = pull(world, k, count, slot, point_m, track, trial)
    if trial < cost:
        install(world, plans, k, count, slot, point_m)
    return spent


@njit(cache=True)
def sweep(
    world: World, plans: Plans, scratch: Scratch, uav: Ints, slot_now: int, seed: int, layers: int,
    side: int, greed: float, limit: int, budget: int, rounds: int, easy: float,
) -> int:  # fmt: skip
    """One round of best responses, earliest conflict first; returns the expansions spent."""
    n = len(uav)
    steps = world.track.shape[1]
    key = np.empty(n)
    for k in range(n):
        key[k] = first_conflict(world, k, world.track[k]) + 0.5 * uniform(seed, slot_now, uav[k])
    slot = np.empty(plans.slot.shape[1], np.int64)
    point_m = np.empty((plans.slot.shape[1], 2))
    track = np.empty((steps, 2))
    spent = 0
    for k in np.argsort(key):
        if key[k] >= steps and plans.size[k] == 0:
            continue
        spent += replan(
            world, plans, scratch, k, layers, side, greed, limit, budget - spent, rounds, easy, slot, point_m,
            track,
        )  # fmt: skip
    return spent


@njit(cache=True)
def put_off(world: World, plans: Plans, k: int, most: int) -> None:
    """Drop way points that are reached; put a plan off that can no longer be flown in time.

    A plan that was put off by more than `most` slots in all does not work out: it is dropped.
    """
    u_max = world.rules.u_max_m
    while plans.size[k] > 0:
        x = plans.point_m[k, 0, 0] - world.start_m[k, 0]
        y = plans.point_m[k, 0, 1] - world.start_m[k, 1]
        need = math.ceil(norm(x, y) / u_max - 0.02)
        if need > 0 or plans.slot[k, 0] > 0:
            behind = max(need - plans.slot[k, 0], 0)
            plans.slot[k] += behind
            plans.delay[k] += behind
            break
        drop(plans.size[k], plans.slot[k], plans.point_m[k], 0)
        plans.size[k] -= 1
    if plans.delay[k] > most:
        plans.size[k] = 0
        plans.delay[k] = 0


@njit(cache=True)
def populate(world: World, plans: Plans, most: int) -> None:
    """Fill the grid: UAVs fly their plans, everyone else stays where it is."""
    world.head[:] = -1
    for k in range(world.track.shape[0]):
        if k < len(plans.size):
            put_off(world, plans, k, most)
            fly(world, k, plans.size[k], plans.slot[k], plans.point_m[k], world.track[k])
        else:
            for t in range(world.track.shape[1]):
                world.track[k, t, 0], world.track[k, t, 1] = world.start_m[k, 0], world.start_m[k, 1]
        enter(world, k)
