"""Guidance: which step each UAV would like to take, by space-time best response.

The slot QP makes any wishes safe; whether missions complete, and how far everyone flies, is decided
here. Each UAV has a *plan*, a few way points in space and time after which it flies straight to its
goal, and hence a *track*, its predicted position in each of the next W slots. Once a slot the UAVs
whose tracks conflict, the earliest conflict first, look for the track A that is cheapest against
the current tracks of all others:

    COST(A) = sum over slots not at the goal of wt  +  wd * length / u_max  +  CONF(A)
    CONF(A) = sum_l way_kl sum_t gamma^t (TOUCH + DEPTH (sep - d) / R)   where d < sep

in units of slots. d is what the slot QP will look at: however unevenly the steps of slot t are flown,
the difference of the two positions stays in a parallelogram, and d is its distance from the origin. So
a plan without conflicts is flown as it stands. (Distances at slot ends alone promise gaps that the QP
then refuses, for ever.) sep = R + delta, or 0.9995 of the present distance where that is less (already
too close: a conflict is then getting closer). A conflict has a finite price, so a plan always exists,
and far conflicts are discounted since they may dissolve.

`way` is the right of way: (luck_l + PATIENCE) / (luck_k + PATIENCE) within [1/CAP, CAP]. A UAV that has
lost time is dearer to others: luck = lateness * (0.5 + U(0, 1)), drawn anew every W slots. Without it
dense missions jam. The denser the swarm, the more those with the longest way go first as well, since
they decide when the mission ends: FAR_FIRST * coverage^2 * remaining slots is added, coverage being the
share of the swarm's rectangle that its discs cover (at most 0.4). In the slot to come nobody has less
than the right of way IMMINENT: a step into another's corner is not flown anyway, and whoever insists on
it is never seen to need room. Insisting pays now and then, since the QP grants a part of the step; but who
has stood still for STUCK slots plans no such step at all any more, so that the others see what it waits for.

The best response is found by A* over a lattice in space and time (nodes (layer, a, b), two slots a
layer, spacing 2 u_max / sqrt(20); moves: stay, 12 of about half and 32 of nearly full speed; distances
at slots only), then improved off the lattice at the full price: way points are dropped while the cost
does not rise ("string pulling"), drawn towards the straight connection by bisection, and nudged in space
and time while the cost falls. Only the slots that a change touches are flown and priced again. Before
searching, the UAV tries to pass each opponent in turn on one side; where that is free and nearly as
cheap as the straight line, no search is made. A plan that falls behind is put off, and dropped when that
happens too often: it does not work out. A plan whose conflicts have gone is kept and improved; it gives
way to the straight line as soon as that is free.

Random numbers are a hash of (seed, slot, UAV) and effort is counted in steps priced, so the same
requests give the same bytes on any head. A new head starts cold: all tracks are straight lines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, Indices, length_m
from edc_swarm.mission.configuration import ARRIVED_M
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner import ways
from edc_swarm.solver.slot_qp import DELTA_M, Obstacles

NEVER = -(10**9)
"""Slot in which a UAV was last planned for that never was."""
STILL_SHARE = 0.02
"""Who moves by less than this share of a full step has stood still."""
MAX_SIDE_CELLS = 160
"""Cells along one side of the grid at most."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """Constants of the guidance. Slots are the unit of time and of cost.

    Attributes
    ----------
    look_ahead
        W, slots that a track reaches ahead; even.
    touch, depth
        Price of a conflict, and of its full depth.
    gamma
        Discount of a conflict per slot.
    patience
        Slots of lateness that double the right of way; decay time at the goal.
    cap
        Largest right-of-way ratio.
    imminent
        Least right of way of all others in the slot to come.
    stuck
        Slots of standing still after which a UAV no longer insists in the slot to come.
    far_first
        Lateness that each slot of the remaining way counts as, per squared coverage.
    greed
        Factor on the A* heuristic: above 1 the search is faster and not quite optimal.
    expand
        Expansions of one search.
    budget, budget_per_uav
        Steps priced in one slot after which no further UAV makes a new plan.
    rounds
        Rounds of local search on way points.
    easy
        Slots of extra effort below which a plan that passes everyone on one side needs no search.
    delay
        Slots by which a plan may be put off before it is made anew.
    """

    look_ahead: int = 32
    touch: float = 1.0
    depth: float = 12.0
    gamma: float = 0.88
    patience: float = 20.0
    cap: float = 8.0
    imminent: float = 8.0
    stuck: int = 12
    far_first: float = 20.0
    greed: float = 1.6
    expand: int = 400
    budget: int = 90_000
    budget_per_uav: int = 900
    rounds: int = 3
    delay: int = 20
    easy: float = 1.0

    @property
    def layers(self) -> int:
        """Lattice layers, two slots each."""
        return self.look_ahead // 2

    @property
    def side(self) -> int:
        """Lattice points along one side: as far as full speed leads."""
        return 2 * math.ceil(self.layers * math.sqrt(20.0)) + 1

    def limits(self, uavs: int) -> kernel.Limits:
        """What one slot may cost with so many UAVs."""
        budget = self.budget + self.budget_per_uav * uavs
        return kernel.Limits(self.layers, self.side, self.greed, self.expand, budget, self.rounds, self.easy)


@dataclass(frozen=True, slots=True)
class Scene:
    """One slot as the guidance sees it.

    `uav` (n,) roster indices, `position_m` `goal_m` (n, 2), `r_m` (n,); `obstacles` stay where they are.
    """

    slot: int
    uav: Indices
    position_m: Floats
    goal_m: Floats
    r_m: Floats
    obstacles: Obstacles


class Guidance:
    """Preferred steps from slot to slot; remembers plans and lateness by roster index."""

    def __init__(self, u_max_m: float, weights: tuple[float, float], seed: int, tuning: Tuning) -> None:
        self._u_max_m = u_max_m
        self._weights = weights
        self._seed = seed
        self._tuning = tuning
        self._memory = _Memory.empty(0, max(tuning.layers, kernel.SIDESTEPS))
        self._scratch = _scratch(tuning)
        self._draft = _draft(tuning)

    def wishes(self, scene: Scene) -> Floats:
        """Preferred waypoints (n, 2), each within u_max of the UAV's position."""
        if not len(scene.uav):
            return np.empty((0, 2))
        walls = ways.walls_of(scene.position_m, scene.r_m, scene.obstacles)
        goal_m, way_m = ways.routed(scene.position_m, scene.goal_m, walls, scene.slot)
        self._remember(scene, way_m)
        plans = self._memory.plans_of(scene.uav)
        world = self._world(scene, goal_m, walls)
        kernel.populate(world, plans, self._tuning.delay)
        limits = self._tuning.limits(len(scene.uav))
        urgency = np.empty(len(scene.uav))
        kernel.urgencies(world, scene.uav, scene.slot, self._seed, urgency)
        kernel.sweep(world, plans, self._scratch, self._draft, limits, urgency, np.argsort(urgency, kind="stable"))
        self._memory.store(scene.uav, plans)
        return world.track[:, 1].copy()

    def _remember(self, scene: Scene, way_m: Floats) -> None:
        """Bring the memory to this slot: time passes, lateness grows, who was long unheard is forgotten."""
        memory = self._memory = self._memory.grown(int(scene.uav.max()) + 1)
        elapsed = scene.slot - memory.seen[scene.uav]
        known = (elapsed > 0) & (elapsed <= self._tuning.look_ahead)
        memory.still[scene.uav] = np.where(known & self._stood_still(scene), memory.still[scene.uav] + 1, 0)
        memory.late[scene.uav] = np.where(known, self._lateness(scene, way_m, elapsed), 0.0)
        memory.advance(scene.uav, known, elapsed)
        memory.seen[scene.uav] = scene.slot
        memory.position_m[scene.uav] = scene.position_m
        memory.distance_m[scene.uav] = way_m

    def _stood_still(self, scene: Scene) -> NDArray[np.bool_]:
        """Who is where it was when it was last planned for."""
        return length_m(scene.position_m - self._memory.position_m[scene.uav]) < STILL_SHARE * self._u_max_m

    def _lateness(self, scene: Scene, way_m: Floats, elapsed: Indices) -> Floats:
        """Slots lost against full speed; at the goal they are forgotten little by little."""
        late = self._memory.late[scene.uav]
        lost = elapsed - (self._memory.distance_m[scene.uav] - way_m) / self._u_max_m
        fading = late * (1 - 1 / self._tuning.patience)
        return np.maximum(np.where(way_m < ARRIVED_M, fading, late + lost), 0.0)

    def _luck(self, scene: Scene) -> Floats:
        """Right of way of all vehicles, in slots: lateness times chance, and the length of the way to go."""
        tuning, memory = self._tuning, self._memory
        window = scene.slot // tuning.look_ahead
        chance = [0.5 + kernel.uniform(self._seed, window, uav) for uav in scene.uav]
        way_slots = memory.distance_m[scene.uav] / self._u_max_m
        return memory.late[scene.uav] * chance + tuning.far_first * min(coverage(scene), 0.4) ** 2 * way_slots

    def _imminent(self, scene: Scene) -> Floats:
        """Least right of way of all others over each UAV in the slot to come."""
        still = self._memory.still[scene.uav]
        return np.where(still >= self._tuning.stuck, kernel.UNYIELDING, self._tuning.imminent)

    def _world(self, scene: Scene, goal_m: Floats, walls: kernel.Walls) -> kernel.World:
        tuning = self._tuning
        start_m, r_m = scene.position_m, scene.r_m
        low_m = start_m.min(axis=0)
        extent_m = start_m.max(axis=0) - low_m
        cell_m = max(2 * float(r_m.max()) + DELTA_M + self._u_max_m, float(extent_m.max()) / MAX_SIDE_CELLS)
        margin = 4
        cells = np.ceil(extent_m / cell_m).astype(np.int64) + 1 + 2 * margin
        slots = tuning.look_ahead + 1
        weight_time, weight_distance = self._weights
        return kernel.World(
            track=np.empty((len(r_m), slots, 2)),
            start_m=start_m,
            goal_m=goal_m,
            r_m=np.maximum(r_m, 1e-6),
            luck=self._luck(scene),
            imminent=self._imminent(scene),
            gamma=np.array([tuning.gamma**slot for slot in range(slots)]),
            head=np.empty((slots, int(cells.prod())), np.int32),
            link=np.empty((slots, len(r_m) << kernel.ENTRY_BITS), np.int32),
            walls=walls,
            rules=kernel.Rules(
                u_max_m=self._u_max_m,
                weight_time=weight_time,
                weight_distance=weight_distance,
                delta_m=DELTA_M,
                touch=tuning.touch,
                depth=tuning.depth,
                patience=tuning.patience,
                cap=tuning.cap,
                low_x_m=float(low_m[0]) - margin * cell_m,
                low_y_m=float(low_m[1]) - margin * cell_m,
                per_cell=1 / cell_m,
                rows=int(cells[0]),
                columns=int(cells[1]),
            ),
        )


def coverage(scene: Scene) -> float:
    """Share of the smallest rectangle around all discs, now and at their goals, that the discs cover."""
    points_m = np.concatenate([scene.position_m, scene.goal_m])
    sides_m = np.ptp(points_m, axis=0) + 2 * scene.r_m.max()
    return math.pi * float((scene.r_m**2).sum()) / max(float(sides_m.prod()), 1e-9)


@dataclass
class _Memory:
    """Plans and lateness of the whole roster, row = roster index; `seen` is when each was last planned for."""

    seen: Indices
    late: Floats
    distance_m: Floats
    still: Indices
    position_m: Floats
    plans: kernel.Plans

    @staticmethod
    def empty(size: int, points: int) -> _Memory:
        counts, slots = np.zeros((2, size), np.int64), np.zeros((size, points), np.int64)
        plans = kernel.Plans(counts[0], counts[1], slots, np.zeros((size, points, 2)))
        seen, still, position_m = np.full(size, NEVER), np.zeros(size, np.int64), np.zeros((size, 2))
        return _Memory(seen, np.zeros(size), np.zeros(size), still, position_m, plans)

    def grown(self, size: int) -> _Memory:
        """At least `size` rows."""
        have = len(self.late)
        if size <= have:
            return self
        more = _Memory.empty(size, self.plans.slot.shape[1])
        more.seen[:have], more.late[:have], more.distance_m[:have] = self.seen, self.late, self.distance_m
        more.still[:have], more.position_m[:have] = self.still, self.position_m
        for mine, theirs in zip(self.plans, more.plans, strict=True):
            theirs[:have] = mine
        return more

    def advance(self, uav: Indices, known: NDArray[np.bool_], elapsed: Indices) -> None:
        """Move way points `elapsed` slots nearer; forget the plans of UAVs that are not known."""
        self.plans.size[uav[~known]] = 0
        self.plans.slot[uav] -= np.where(known, elapsed, 0)[:, None]

    def plans_of(self, uav: Indices) -> kernel.Plans:
        """Copies of the rows of these UAVs."""
        plans = self.plans
        return kernel.Plans(plans.size[uav], plans.delay[uav], plans.slot[uav], plans.point_m[uav])

    def store(self, uav: Indices, plans: kernel.Plans) -> None:
        """Put the rows back."""
        for mine, theirs in zip(self.plans, plans, strict=True):
            mine[uav] = theirs


def _draft(tuning: Tuning) -> kernel.Draft:
    points, slots = max(tuning.layers, kernel.SIDESTEPS) + 1, tuning.look_ahead + 1
    return kernel.Draft(
        slot=np.zeros(points, np.int64),
        point_m=np.zeros((points, 2)),
        track=np.zeros((slots, 2)),
        aim=np.zeros(slots, np.int64),
        effort=np.zeros(slots + 1),
        price=np.zeros(slots + 1),
        new_track=np.zeros((slots, 2)),
        new_aim=np.zeros(slots, np.int64),
        new_effort=np.zeros(slots + 1),
        new_price=np.zeros(slots + 1),
        work=np.zeros(1, np.int64),
    )


def _scratch(tuning: Tuning) -> kernel.Scratch:
    nodes = (tuning.layers + 1) * tuning.side**2
    moves = np.array(
        [(0, 0)]
        + [(a, b) for a in range(-4, 5) for b in range(-4, 5) if a * a + b * b in (4, 5) or 13 <= a * a + b * b <= 20]
    )
    heap = (tuning.expand + 1) * len(moves) + 1
    return kernel.Scratch(
        stamp=np.zeros(nodes, np.int64),
        cost=np.zeros(nodes),
        price=np.zeros(nodes),
        parent=np.zeros(nodes, np.int8),
        heap_cost=np.zeros(heap),
        heap_node=np.zeros(heap, np.int64),
        epoch=np.zeros(1, np.int64),
        move=moves,
        move_length=np.hypot(moves[:, 0], moves[:, 1]),
    )
