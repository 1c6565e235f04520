"""Compiled search for a sequence of moves that lets UAVs past each other: see `edc_swarm.planner.room`.

Like the guidance kernel it is plain loops over arrays, deterministic, and counts its effort.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edc_swarm.planner.compiler import compiled, inner
from edc_swarm.planner.guidance_kernel import Floats, Ints, pop, push

NODE_BITS = 10
"""A state has the node of each UAV in so many bits; at most six UAVs fit into 60 bits."""
TABLE_BITS = 18
GREED = 1.5
"""Factor on the ways that are left: the search is faster, and not quite optimal."""


@inner
def _slot_of(key: Ints, state: int) -> int:
    """Return the place of a state in the hash table, or the empty place where it belongs."""
    mixed = np.uint64(state) * np.uint64(0x9E3779B97F4A7C15)
    place = np.int64(mixed >> np.uint64(64 - TABLE_BITS))
    while key[place] != -1 and key[place] != state:
        place = (place + 1) & ((1 << TABLE_BITS) - 1)
    return int(place)


@inner
def _squared_m(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the squared distance of a point from the segment a-b."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = 0.0
    if square > 0.0:
        share = min(max(((px - ax) * dx + (py - ay) * dy) / square, 0.0), 1.0)
    x, y = px - ax - share * dx, py - ay - share * dy
    return x * x + y * y


@compiled
def rearrange(  # noqa: PLR0912, PLR0915 (one loop over arrays)
    node_m: Floats, begin: Ints, leg: Ints, left_m: Floats, end: NDArray[np.bool_], start: Ints, apart_m: Floats,
    key: Ints, cost: Floats, parent: Ints, closed: NDArray[np.bool_], heap_cost: Floats, heap_item: Ints,
    limit: int, moved: Ints, to: Ints,
) -> tuple[int, int]:  # fmt: skip
    """Search by A* the moves, one UAV after another, that bring all n UAVs to end nodes; return their number.

    `node_m` (c, 2); the legs of UAV k from node v are `leg[begin[k, v]:begin[k, v + 1]]`; `left_m` (n, c) are the
    lengths of the ways left, infinite where there is none; `end` (n, c) says where UAV k may end; `apart_m` (n, n) are
    least distances. A move is free if its segment keeps these distances from the nodes of all others. The result is in
    `moved` and `to`: UAV and node of each move. The first number is -1 if no sequence exists, -2 if `limit` expansions
    are spent. The second is the number of expansions. The other arrays are work space, and `key` is full of -1.
    """
    count, mask = len(start), (1 << NODE_BITS) - 1
    state, ahead = 0, 0.0
    for k in range(count):
        state |= start[k] << (NODE_BITS * k)
        ahead += left_m[k, start[k]]
    place = _slot_of(key, state)
    key[place], cost[place], parent[place] = state, 0.0, -1
    size = push(heap_cost, heap_item, 0, GREED * ahead, place)
    spent, used = 0, 1
    room = min(len(heap_cost) - 1, (1 << TABLE_BITS) * 3 // 4)
    while size > 0:
        place = heap_item[0]
        size = pop(heap_cost, heap_item, size)
        if closed[place]:
            continue
        closed[place] = True
        state = key[place]
        done, ahead = True, 0.0
        for k in range(count):
            v = (state >> (NODE_BITS * k)) & mask
            done = done and end[k, v]
            ahead += left_m[k, v]
        if done:
            steps, at = 0, place
            while parent[at] >= 0 and steps < len(moved):
                before = key[parent[at]]
                for k in range(count):
                    v = (key[at] >> (NODE_BITS * k)) & mask
                    if v != (before >> (NODE_BITS * k)) & mask:
                        moved[steps], to[steps] = k, v
                at = parent[at]
                steps += 1
            if parent[at] >= 0:
                return -2, spent
            for i in range(steps // 2):
                moved[i], moved[steps - 1 - i] = moved[steps - 1 - i], moved[i]
                to[i], to[steps - 1 - i] = to[steps - 1 - i], to[i]
            return steps, spent
        if spent >= limit:
            return -2, spent
        spent += 1
        for k in range(count):
            v = (state >> (NODE_BITS * k)) & mask
            ax, ay = node_m[v, 0], node_m[v, 1]
            for e in range(begin[k, v], begin[k, v + 1]):
                w = leg[e]
                if left_m[k, w] == np.inf:
                    continue
                bx, by = node_m[w, 0], node_m[w, 1]
                free = True
                for other in range(count):
                    if other != k:
                        o = (state >> (NODE_BITS * other)) & mask
                        least = apart_m[k, other]
                        if _squared_m(node_m[o, 0], node_m[o, 1], ax, ay, bx, by) < least * least:
                            free = False
                            break
                if not free:
                    continue
                shift = NODE_BITS * k
                child = (state & ~(mask << shift)) | (w << shift)
                there = _slot_of(key, child)
                far = cost[place] + np.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
                if key[there] == -1:
                    if used >= room or size >= room:
                        return -2, spent
                    used += 1
                    key[there] = child
                elif far >= cost[there] - 1e-9 or closed[there]:
                    continue
                if size >= room:
                    return -2, spent
                cost[there], parent[there] = far, place
                promised = far + GREED * (ahead - left_m[k, v] + left_m[k, w])
                size = push(heap_cost, heap_item, size, promised, there)
    return -1, spent
