"""Guidance: the preferred step of each UAV, by space-time best response.

The slot QP makes any preferred steps safe; guidance decides whether missions complete, and how far UAVs fly. Each
UAV has a *plan*, a few way points in space and time and then a straight flight to its
goal, and hence a *track*, its predicted position in each of the next W slots. Once a slot, or in up to
`responses` rounds while conflicts are left, the UAVs whose tracks conflict, the earliest conflict first, search
the track A that is cheapest against the current tracks of all others:

    COST(A) = sum over slots not at the goal of wt  +  wd * length / u_k,max  +  CONF(A)
    CONF(A) = sum_l way_kl sum_t gamma^t (TOUCH + DEPTH (sep - d) / R)   where d < sep

in units of slots. d is the distance that the slot QP checks: in every uneven execution of the steps of slot t
the difference of the two positions stays in a parallelogram, and d is its distance from the origin. So
the UAV flies a plan without conflicts unchanged. (Distances at slot ends alone promise gaps that the QP
rejects in every slot.) sep = R + delta, or 0.9995 of the present distance where that is less (already
too close: a conflict is then getting closer). A conflict has a finite price, so a plan always exists,
and far conflicts are discounted since they may dissolve.

`way` is the right of way: (luck_l + PATIENCE) / (luck_k + PATIENCE) within [1/CAP, CAP]. A conflict with a
late UAV costs others more: luck = lateness * (0.5 + U(0, 1)), drawn anew every W slots. Without it
dense missions jam. In a dense swarm the UAVs with the longest way go first too, since
they decide when the mission ends: FAR_FIRST * coverage^2 * remaining slots is added, coverage being the
share of the swarm's rectangle that its discs cover (at most 0.4). In the next slot every UAV has at
least the right of way IMMINENT: the QP rejects a step into another UAV's box, and the track of a UAV that insists on
such a step does not show that it needs room. To insist sometimes pays, since the QP grants a part of the step; but
a UAV that has stood still for STUCK slots plans no such step, so its track shows the others where it needs room.

A* finds the best response over a lattice in space and time (nodes (layer, a, b), two slots a
layer, spacing 2 u_k,max / sqrt(20); moves: stay, 12 of about half and 32 of nearly full speed; distances
at slots only). Local search then improves it off the lattice at the full price: it drops way points while the cost
does not rise ("string pulling"), moves them towards the straight connection by bisection, and moves them in space
and time while the cost falls. It flies and prices again only the slots that a change affects. Before
a search the UAV tries to pass each opponent in turn on one side; if that is free and nearly as
cheap as the straight line, it does not search. A UAV delays a plan that falls behind, and drops a plan
delayed too often. It keeps and improves a plan whose conflicts are gone, and replaces it by
the straight line as soon as that is free.

Random numbers are a hash of (seed, slot, UAV) and guidance counts effort in priced steps, so the same
requests give the same bytes on any head. A new head starts cold: all tracks are straight lines, or a roundabout where
most of them would meet (`edc_swarm.planner.roundabout`). In flight its first plan has a part of the budget alone
(`Tuning.first_share`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.geometry import Floats, Indices, length_m
from edc_swarm.mission.roster_entry import ARRIVED_M
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner import roundabout, ways
from edc_swarm.planner.answers import answers
from edc_swarm.planner.charts import Charts
from edc_swarm.planner.room import Room
from edc_swarm.solver.barrier_rows import Airspace
from edc_swarm.solver.hull_rows import Obstacles
from edc_swarm.solver.normals import DELTA_M

NEVER = -(10**9)
"""Slot of the last plan for a UAV that has none."""
STILL_SHARE = 0.02
"""Share of a full step below which a UAV has stood still."""
MAX_SIDE_CELLS = 160
"""Most cells along one side of the grid."""


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
        Least right of way of all others in the next slot.
    stuck
        Slots of standing still after which a UAV no longer insists in the next slot.
    far_first
        Lateness for each slot of the remaining way, per squared coverage.
    greed
        Factor on the A* heuristic: above 1 the search is faster and not quite optimal.
    expand
        Expansions of one search.
    budget, budget_per_uav
        Priced steps in one slot after which no further UAV makes a new plan.
    rounds
        Rounds of local search on way points.
    easy
        Slots of extra effort below which a plan that passes all opponents on one side needs no search.
    delay
        Slots by which a UAV may delay a plan before it makes a new one.
    responses
        Most rounds of best responses in a slot, each with the whole budget.
    first_share
        Share of the budget for the first plan of a planner that takes over in flight.
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
    responses: int = 1
    first_share: float = 0.25

    @property
    def layers(self) -> int:
        """Lattice layers, two slots each."""
        return self.look_ahead // 2

    @property
    def side(self) -> int:
        """Lattice points along one side: the reach at full speed."""
        return 2 * math.ceil(self.layers * math.sqrt(20.0)) + 1

    def limits(self, uavs: int, share: float = 1.0) -> kernel.Limits:
        """Return the limits on the effort of one slot with this number of UAVs, for a share of the budget."""
        budget = round(share * (self.budget + self.budget_per_uav * uavs))
        return kernel.Limits(self.layers, self.side, self.greed, self.expand, budget, self.rounds, self.easy)


@dataclass(frozen=True, slots=True)
class Scene:
    """One slot as input of the guidance.

    `uav` (n,) roster indices, `position_m` `goal_m` (n, 2), `r_m` (n,); the hulls in `obstacles` do not move;
    `rest_m` (n,) lengths of the ways beyond the goals. The last `foreign` of the n are UAVs of other clusters.
    """

    slot: int
    uav: Indices
    position_m: Floats
    goal_m: Floats
    r_m: Floats
    obstacles: Obstacles
    rest_m: Floats | float = 0.0
    foreign: int = 0


class Guidance:
    """Preferred steps from slot to slot; remembers plans and lateness by roster index."""

    def __init__(
        self, u_max_m: Floats, weights: Floats, seed: int, tuning: Tuning, airspace: Airspace | None = None
    ) -> None:
        """Take the longest steps (K,) and the prices (wt, wd) (K, 2) of the UAVs of the roster."""
        self._u_max_m = u_max_m
        self._charts = Charts.of(airspace or Airspace.unbounded())
        self._room = Room(self._charts, u_max_m)
        self._weights = weights
        self._seed = seed
        self._tuning = tuning
        self._memory = _Memory.empty(0, max(tuning.layers, kernel.SIDESTEPS))
        self._scratch = _scratch(tuning, self._charts.barred)
        self._draft = _draft(tuning)

    @property
    def priced_steps(self) -> int:
        """Steps that the last plan has priced, in its last round: its effort, which no clock measures."""
        return int(self._draft.work[0])

    def wishes(self, scene: Scene, *, in_flight: bool = False) -> Floats:
        """Return the preferred waypoints (n, 2), each within the UAV's longest step.

        A plan that begins `in_flight` is that of a new head, which has less of its slot left than those that follow: it
        has `first_share` of the budget, for the earliest conflicts. The others wait for the next slot.
        """
        if not len(scene.uav):
            return np.empty((0, 2))
        reach_m = self._u_max_m[scene.uav] * (self._tuning.look_ahead + 1)
        walls = ways.walls_of(scene.position_m, scene.r_m, scene.obstacles, reach_m)
        goal_m, way_m = ways.routed(
            scene.position_m, scene.goal_m, walls, scene.slot, scene.uav, scene.r_m, self._charts
        )
        cold = not self._remember(scene, way_m + scene.rest_m)
        takes_over = cold and in_flight
        if len(self._charts.barred.edge):
            goal_m = self._room.aims(
                scene.slot, scene.uav, scene.position_m, scene.goal_m, goal_m, way_m, scene.r_m, walls
            )
        plans = self._memory.plans_of(scene.uav)
        world = self._world(scene, goal_m, walls)
        if cold:
            roundabout.begin(world, plans)
        kernel.populate(world, plans, self._tuning.delay)
        answering = answers(world, plans, scene.foreign)
        limits = self._tuning.limits(int(answering.sum()), self._tuning.first_share if takes_over else 1.0)
        urgency = np.empty(len(scene.uav))
        for response in range(1 if takes_over else self._tuning.responses):
            kernel.urgencies(world, scene.uav, scene.slot, self._seed, urgency)
            if response and urgency.min() > self._tuning.look_ahead:
                break
            order = np.argsort(urgency, kind="stable")
            kernel.sweep(world, plans, self._scratch, self._draft, limits, urgency, order[answering[order]])
        self._memory.store(scene.uav, plans)
        return world.track[:, 1].copy()

    def rehearse(self) -> None:
        """Compile or load the search for plans: run it for nobody, on data of the types that it has in flight."""
        place_m, uav = np.zeros((1, 2)), np.zeros(1, np.int64)
        scene = Scene(0, uav, place_m, place_m, np.ones(1), Obstacles.none())
        walls = ways.walls_of(place_m, scene.r_m, scene.obstacles)
        self._remember(scene, np.zeros(1))
        world, plans = self._world(scene, place_m, walls), self._memory.plans_of(uav)
        kernel.sweep(
            world, plans, self._scratch, self._draft, self._tuning.limits(1), np.zeros(1), np.empty(0, np.int64)
        )

    def _remember(self, scene: Scene, way_m: Floats) -> bool:
        """Advance the memory to this slot: lateness grows, and UAVs unheard for long are forgotten.

        Returns True if it knew any of the UAVs.
        """
        memory = self._memory = self._memory.grown(int(scene.uav.max()) + 1)
        elapsed = scene.slot - memory.seen[scene.uav]
        known = (elapsed > 0) & (elapsed <= self._tuning.look_ahead)
        memory.still[scene.uav] = np.where(known & self._stood_still(scene), memory.still[scene.uav] + 1, 0)
        memory.late[scene.uav] = np.where(known, self._lateness(scene, way_m, elapsed), 0.0)
        memory.advance(scene.uav, known, elapsed)
        memory.seen[scene.uav] = scene.slot
        memory.position_m[scene.uav] = scene.position_m
        memory.distance_m[scene.uav] = way_m
        return bool(known.any())

    def _stood_still(self, scene: Scene) -> NDArray[np.bool_]:
        """Return a mask of the UAVs that have not moved since their last plan."""
        return length_m(scene.position_m - self._memory.position_m[scene.uav]) < STILL_SHARE * self._u_max_m[scene.uav]

    def _lateness(self, scene: Scene, way_m: Floats, elapsed: Indices) -> Floats:
        """Return the slots lost against full speed; at the goal they decay slowly."""
        late = self._memory.late[scene.uav]
        lost = elapsed - (self._memory.distance_m[scene.uav] - way_m) / self._u_max_m[scene.uav]
        fading = late * (1 - 1 / self._tuning.patience)
        return np.maximum(np.where(way_m < ARRIVED_M, fading, late + lost), 0.0)

    def _luck(self, scene: Scene) -> Floats:
        """Return the right of way of all UAVs, in slots: lateness times chance, plus the length of the way."""
        tuning, memory = self._tuning, self._memory
        window = scene.slot // tuning.look_ahead
        chance = [0.5 + kernel.uniform(self._seed, window, uav) for uav in scene.uav]
        way_slots = memory.distance_m[scene.uav] / self._u_max_m[scene.uav]
        return memory.late[scene.uav] * chance + tuning.far_first * min(coverage(scene), 0.4) ** 2 * way_slots

    def _imminent(self, scene: Scene) -> Floats:
        """Return the least right of way of all others over each UAV in the next slot."""
        still = self._memory.still[scene.uav]
        return np.where(still >= self._tuning.stuck, kernel.UNYIELDING, self._tuning.imminent)

    def _world(self, scene: Scene, goal_m: Floats, walls: kernel.Walls) -> kernel.World:
        tuning = self._tuning
        start_m, r_m, u_max_m = scene.position_m, scene.r_m, self._u_max_m[scene.uav]
        low_m = start_m.min(axis=0)
        extent_m = start_m.max(axis=0) - low_m
        cell_m = max(2 * float(r_m.max()) + DELTA_M + float(u_max_m.max()), float(extent_m.max()) / MAX_SIDE_CELLS)
        margin = 4
        cells = np.ceil(extent_m / cell_m).astype(np.int64) + 1 + 2 * margin
        slots = tuning.look_ahead + 1
        return kernel.World(
            track=np.empty((len(r_m), slots, 2)),
            start_m=start_m,
            goal_m=goal_m,
            r_m=np.maximum(r_m, 1e-6),
            u_max_m=u_max_m,
            weight=self._weights[scene.uav],
            luck=self._luck(scene),
            imminent=self._imminent(scene),
            gamma=np.array([tuning.gamma**slot for slot in range(slots)]),
            head=np.empty((slots, int(cells.prod())), np.int32),
            link=np.empty((slots, len(r_m) << kernel.ENTRY_BITS), np.int32),
            walls=walls,
            barred=self._charts.barred,
            rules=kernel.Rules(
                longest_m=float(u_max_m.max()),
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
    """Return the share that the discs cover of the smallest rectangle around them, now and at their goals."""
    points_m = np.concatenate([scene.position_m, scene.goal_m])
    sides_m = np.ptp(points_m, axis=0) + 2 * scene.r_m.max()
    return math.pi * float((scene.r_m**2).sum()) / max(float(sides_m.prod()), 1e-9)


@dataclass
class _Memory:
    """Plans and lateness of the whole roster, row = roster index; `seen` is the slot of each UAV's last plan."""

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
        """Return a memory with at least `size` rows."""
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
        """Move way points `elapsed` slots nearer; drop the plans of UAVs that are not known."""
        self.plans.size[uav[~known]] = 0
        self.plans.slot[uav] -= np.where(known, elapsed, 0)[:, None]

    def plans_of(self, uav: Indices) -> kernel.Plans:
        """Return copies of the rows of these UAVs."""
        plans = self.plans
        return kernel.Plans(plans.size[uav], plans.delay[uav], plans.slot[uav], plans.point_m[uav])

    def store(self, uav: Indices, plans: kernel.Plans) -> None:
        """Write the rows of these UAVs."""
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


def _scratch(tuning: Tuning, barred: kernel.Barred) -> kernel.Scratch:
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
        guards=np.zeros((int(np.diff(barred.begin).max(initial=0)), 8)),
    )
