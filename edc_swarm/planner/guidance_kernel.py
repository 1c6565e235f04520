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


class World(NamedTuple):
    """What a plan is judged against.

    track (N, W+1, 2) predicted positions in metres, one a slot; start_m (N, 2); goal_m (N, 2);
    r_m (N,); luck (N,) lateness drawn for right of way; gamma (W+1,) discount of a conflict;
    head (W+1, cells) and link (W+1, N) linked lists of the vehicles in each square cell and slot.
    """

    track: Floats
    start_m: Floats
    goal_m: Floats
    r_m: Floats
    luck: Floats
    gamma: Floats
    head: NDArray[np.int32]
    link: NDArray[np.int32]
    low_m: Floats
    cells: Ints
    cell_m: float
    u_max_m: float
    weight_time: float
    weight_distance: float
    delta_m: float
    touch: float
    depth: float
    patience: float
    cap: float


class Plans(NamedTuple):
    """Way points of every UAV: count (n,), slot (n, P) from now, point (n, P, 2)."""

    count: Ints
    slot: Ints
    point_m: Floats


class Scratch(NamedTuple):
    """Work space of the lattice search, kept from call to call; `stamp` says which are current."""

    stamp: NDArray[np.int64]
    cost: Floats
    price: Floats
    parent: NDArray[np.int8]
    closed: NDArray[np.int64]
    heap_cost: Floats
    heap_node: Ints
    epoch: Ints
    move: Ints
    move_length: Floats


@njit(cache=True)
def uniform(seed: int, a: int, b: int) -> float:
    """Number in [0, 1) from a hash of three integers (splitmix64 finaliser, thrice)."""
    z = np.uint64(seed)
    for value in (a, b, 0):
        z = (z ^ np.uint64(value)) + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True)
def cell_of(world: World, x: float, y: float) -> tuple[int, int]:
    """Cell of a point; points outside the grid count as in its border cells."""
    i = int(math.floor((x - world.low_m[0]) / world.cell_m))
    j = int(math.floor((y - world.low_m[1]) / world.cell_m))
    return min(max(i, 0), world.cells[0] - 1), min(max(j, 0), world.cells[1] - 1)


@njit(cache=True)
def enter(world: World, k: int) -> None:
    """Put vehicle k's track into the grid."""
    for t in range(world.track.shape[1]):
        i, j = cell_of(world, world.track[k, t, 0], world.track[k, t, 1])
        c = i * world.cells[1] + j
        world.link[t, k] = world.head[t, c]
        world.head[t, c] = k


@njit(cache=True)
def leave(world: World, k: int) -> None:
    """Take vehicle k's track out of the grid."""
    for t in range(world.track.shape[1]):
        i, j = cell_of(world, world.track[k, t, 0], world.track[k, t, 1])
        c = i * world.cells[1] + j
        if world.head[t, c] == k:
            world.head[t, c] = world.link[t, k]
            continue
        other = world.head[t, c]
        while world.link[t, other] != k:
            other = world.link[t, other]
        world.link[t, other] = world.link[t, k]


@njit(cache=True)
def conflict_at(world: World, k: int, t: int, x: float, y: float) -> float:
    """Price of vehicle k being at (x, y) in slot t."""
    price = 0.0
    i, j = cell_of(world, x, y)
    for a in range(max(i - 1, 0), min(i + 2, world.cells[0])):
        for b in range(max(j - 1, 0), min(j + 2, world.cells[1])):
            other = world.head[t, a * world.cells[1] + b]
            while other >= 0:
                if other != k:
                    dx = x - world.track[other, t, 0]
                    dy = y - world.track[other, t, 1]
                    radii = world.r_m[k] + world.r_m[other]
                    reach = radii + world.delta_m
                    squared = dx * dx + dy * dy
                    if squared < reach * reach:
                        distance = math.sqrt(squared)
                        sx = world.start_m[k, 0] - world.start_m[other, 0]
                        sy = world.start_m[k, 1] - world.start_m[other, 1]
                        apart = min(reach, 0.9995 * math.sqrt(sx * sx + sy * sy))
                        if distance < apart:
                            way = (world.luck[other] + world.patience) / (world.luck[k] + world.patience)
                            way = min(max(way, 1.0 / world.cap), world.cap)
                            price += way * (world.touch + world.depth * (apart - distance) / radii)
                other = world.link[t, other]
    return price * world.gamma[t]


@njit(cache=True)
def conflict(world: World, k: int, track: Floats) -> float:
    """Price of all conflicts of a track (W+1, 2) of vehicle k."""
    price = 0.0
    for t in range(1, track.shape[0]):
        price += conflict_at(world, k, t, track[t, 0], track[t, 1])
    return price


@njit(cache=True)
def first_conflict(world: World, k: int, track: Floats) -> int:
    """First slot in which the track of vehicle k is in conflict, W + 1 if there is none."""
    for t in range(1, track.shape[0]):
        if conflict_at(world, k, t, track[t, 0], track[t, 1]) > 0.0:
            return t
    return track.shape[0]


@njit(cache=True)
def effort(world: World, k: int, track: Floats) -> float:
    """Time and distance of a track, the straight rest beyond the look-ahead included, in slots.

    A slot costs weight_time unless it is spent at the goal, and weight_distance for each full step
    flown; the step that arrives costs its share of a slot.
    """
    gx, gy = world.goal_m[k, 0], world.goal_m[k, 1]
    last = track.shape[0] - 1
    time = 0.0
    path = 0.0
    for t in range(1, last + 1):
        step = math.hypot(track[t, 0] - track[t - 1, 0], track[t, 1] - track[t - 1, 1])
        path += step
        there = abs(track[t, 0] - gx) < ARRIVED_M and abs(track[t, 1] - gy) < ARRIVED_M
        time += step / world.u_max_m if there else 1.0
    rest = math.hypot(track[last, 0] - gx, track[last, 1] - gy)
    time += rest / world.u_max_m
    path += rest
    return world.weight_time * time + world.weight_distance * path / world.u_max_m


@njit(cache=True)
def cost_of(world: World, k: int, track: Floats) -> float:
    """What is minimised: effort plus conflicts."""
    return effort(world, k, track) + conflict(world, k, track)


@njit(cache=True)
def fly(world: World, k: int, count: int, slot: Ints, point_m: Floats, track: Floats) -> None:
    """Track of a plan: constant speed between way points, then straight to the goal at full speed.

    A way point that cannot be reached in time is flown to at full speed all the same.
    """
    x, y = world.start_m[k, 0], world.start_m[k, 1]
    track[0, 0], track[0, 1] = x, y
    n = 0
    for t in range(1, track.shape[0]):
        if n < count:
            tx, ty = point_m[n, 0], point_m[n, 1]
            slots = max(slot[n] - t + 1, 1)
        else:
            tx, ty = world.goal_m[k, 0], world.goal_m[k, 1]
            slots = 1
        dx, dy = tx - x, ty - y
        distance = math.hypot(dx, dy)
        step = min(distance / slots, world.u_max_m)
        if step >= distance:
            x, y = tx, ty
            if n < count and slot[n] <= t:
                n += 1
        elif step > 0.0:
            x += dx * (step / distance)
            y += dy * (step / distance)
        track[t, 0], track[t, 1] = x, y


@njit(cache=True)
def push(scratch: Scratch, size: int, cost: float, node: int) -> int:
    """Add to the binary heap, ordered by (cost, node); returns the new size."""
    f, v = scratch.heap_cost, scratch.heap_node
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
def pop(scratch: Scratch, size: int) -> int:
    """Remove the least element, which the caller has read from place 0; returns the new size."""
    f, v = scratch.heap_cost, scratch.heap_node
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
def node_price(world: World, k: int, layer: int, x: float, y: float) -> float:
    """Price of being at (x, y) about slot 2 layer: the three nearest slots stand for two."""
    price = 0.0
    last = world.track.shape[1] - 1
    for t in range(2 * layer - 1, min(2 * layer + 1, last) + 1):
        price += conflict_at(world, k, t, x, y)
    return price * (2.0 / 3.0)


@njit(cache=True)
def search(
    world: World, scratch: Scratch, k: int, layers: int, side: int, greed: float, limit: int,
    slot: Ints, point_m: Floats,
) -> tuple[int, int, float]:  # fmt: skip
    """A* over the space-time lattice about vehicle k.

    Writes the way points of the path found and returns their number, the expansions spent and the
    path's lattice cost. Nodes are (layer, a, b); the spacing makes the longest move two full steps.
    """
    half = side // 2
    sx, sy = world.start_m[k, 0], world.start_m[k, 1]
    spacing = 2.0 * world.u_max_m / math.sqrt(20.0)
    ga = int(round(min(max((world.goal_m[k, 0] - sx) / spacing, -1e6), 1e6)))
    gb = int(round(min(max((world.goal_m[k, 1] - sy) / spacing, -1e6), 1e6)))
    unit = spacing / world.u_max_m
    wt, wd = world.weight_time, world.weight_distance
    per_cell = greed * (wt + wd) * unit
    scratch.epoch[0] += 1
    epoch = scratch.epoch[0]
    node = half * side + half
    scratch.stamp[node] = epoch
    scratch.cost[node] = 0.0
    scratch.price[node] = 0.0
    scratch.parent[node] = -1
    size = push(scratch, 0, per_cell * math.hypot(ga, gb), node)
    spent = 0
    area = side * side
    moves = scratch.move.shape[0]
    while size > 0:
        node = scratch.heap_node[0]
        size = pop(scratch, size)
        if scratch.closed[node] == epoch:
            continue
        scratch.closed[node] = epoch
        layer = node // area
        if layer == layers or spent >= limit:
            break
        spent += 1
        a = (node // side) % side - half
        b = node % side - half
        at_goal = a == ga and b == gb
        for m in range(moves):
            na = a + scratch.move[m, 0]
            nb = b + scratch.move[m, 1]
            if abs(na) > half or abs(nb) > half:
                continue
            nxt = (layer + 1) * area + (na + half) * side + nb + half
            if scratch.closed[nxt] == epoch:
                continue
            length = scratch.move_length[m] * unit
            if na == ga and nb == gb:
                edge = 0.0 if at_goal else (wt + wd) * length
            else:
                edge = 2.0 * wt + wd * length
            if scratch.stamp[nxt] != epoch:
                scratch.stamp[nxt] = epoch
                scratch.price[nxt] = node_price(world, k, layer + 1, sx + na * spacing, sy + nb * spacing)
                scratch.cost[nxt] = np.inf
            g = scratch.cost[node] + edge + scratch.price[nxt]
            if g < scratch.cost[nxt]:
                scratch.cost[nxt] = g
                scratch.parent[nxt] = m
                size = push(scratch, size, g + per_cell * math.hypot(na - ga, nb - gb), nxt)
    found = scratch.cost[node]
    count = node // area
    for n in range(count - 1, -1, -1):
        a = (node // side) % side - half
        b = node % side - half
        slot[n] = 2 * (n + 1)
        point_m[n, 0], point_m[n, 1] = sx + a * spacing, sy + b * spacing
        if a == ga and b == gb:
            point_m[n, 0], point_m[n, 1] = world.goal_m[k, 0], world.goal_m[k, 1]
        m = scratch.parent[node]
        node = (n * side + a - scratch.move[m, 0] + half) * side + b - scratch.move[m, 1] + half
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
        trial = cost_of(world, k, track)
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
                trial = cost_of(world, k, track)
                if trial < cost - 1e-9:
                    cost = trial
                    better = True
                else:
                    slot[n], point_m[n, 0], point_m[n, 1] = s, x, y
        if not better:
            step *= 0.5
    return cost


@njit(cache=True)
def install(world: World, plans: Plans, k: int, count: int, slot: Ints, point_m: Floats) -> None:
    """Make a plan vehicle k's own: way points, track and grid."""
    plans.count[k] = count
    for n in range(count):
        plans.slot[k, n] = slot[n]
        plans.point_m[k, n, 0], plans.point_m[k, n, 1] = point_m[n, 0], point_m[n, 1]
    leave(world, k)
    fly(world, k, count, slot, point_m, world.track[k])
    enter(world, k)


@njit(cache=True)
def replan(
    world: World, plans: Plans, scratch: Scratch, k: int, layers: int, side: int, greed: float,
    limit: int, budget: int, rounds: int, slot: Ints, point_m: Floats, track: Floats,
) -> int:  # fmt: skip
    """Best response of UAV k to all other tracks; returns the expansions spent."""
    fly(world, k, 0, slot, point_m, track)
    straight_conflict = conflict(world, k, track)
    if straight_conflict == 0.0:
        if plans.count[k] > 0:
            install(world, plans, k, 0, slot, point_m)
        return 0
    straight_cost = straight_conflict + effort(world, k, track)
    count = plans.count[k]
    for n in range(count):
        slot[n] = plans.slot[k, n]
        point_m[n, 0], point_m[n, 1] = plans.point_m[k, n, 0], plans.point_m[k, n, 1]
    now_conflict = conflict(world, k, world.track[k])
    cost = now_conflict + effort(world, k, world.track[k])
    if now_conflict == 0.0:
        count, pulled = pull(world, k, count, slot, point_m, track, cost)
        pulled = nudge(world, k, count, slot, point_m, track, pulled, rounds, 0.2 * world.u_max_m)
        if pulled < cost - 1e-9:
            install(world, plans, k, count, slot, point_m)
        return 0
    if budget <= 0:
        return 0
    if straight_cost <= cost:
        cost = straight_cost
        install(world, plans, k, 0, slot, point_m)
    count, spent, _ = search(world, scratch, k, layers, side, greed, limit, slot, point_m)
    fly(world, k, count, slot, point_m, track)
    trial = cost_of(world, k, track)
    count, trial = pull(world, k, count, slot, point_m, track, trial)
    trial = nudge(world, k, count, slot, point_m, track, trial, rounds + 3, 0.4 * world.u_max_m)
    count, trial = pull(world, k, count, slot, point_m, track, trial)
    if trial < cost:
        install(world, plans, k, count, slot, point_m)
    return spent


@njit(cache=True)
def sweep(
    world: World, plans: Plans, scratch: Scratch, uav: Ints, slot_now: int, seed: int, layers: int,
    side: int, greed: float, limit: int, budget: int, rounds: int,
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
        if key[k] >= steps and plans.count[k] == 0:
            continue
        spent += replan(
            world, plans, scratch, k, layers, side, greed, limit, budget - spent, rounds, slot, point_m,
            track,
        )  # fmt: skip
    return spent


@njit(cache=True)
def populate(world: World, plans: Plans) -> None:
    """Fill the grid: UAVs fly their plans, everyone else stays where it is."""
    world.head[:] = -1
    for k in range(world.track.shape[0]):
        if k < len(plans.count):
            fly(world, k, plans.count[k], plans.slot[k], plans.point_m[k], world.track[k])
        else:
            for t in range(world.track.shape[1]):
                world.track[k, t, 0], world.track[k, t, 1] = world.start_m[k, 0], world.start_m[k, 1]
        enter(world, k)
