"""The catalogue of figures: the missions at each point, the plotted values, and the paper's claim.

Section IV of the paper: Fig. 4 collisions, Fig. 5 extra distance, Fig. 6 execution time, each over the
number of UAVs (10 000 m2, r 5 m), the area (50 UAVs, r 5 m), and Fig. 4c over the GPS error (50 UAVs,
40 000 m2). The energy figures are the project's own. Figures share runs: a run that two figures
need has one key and is executed once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from edc_swarm.errors import InputError
from edc_swarm.experiments.statistics import Kind
from edc_swarm.experiments.sweeps import Run
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.power_models import EnergyModel
from edc_swarm.simulation.closed_loop import AS_PRINTED

FLY, FLY_PLAN, FLY_LONG = "fly", "fly_plan", "fly_long"
TIME_PLANS, TIME_FORMS = "time_plans", "time_forms"

PRINTED_UAVS = 20
"""Greatest number of UAVs with which missions use the paper's model as printed, with all its variables."""
PRINTED_RUNS = 5
RUNS_PER_LARGE_PRINTED = 30
"""Runs per timed run of the printed form beyond `PRINTED_UAVS`, where one solution takes up to minutes."""

Result = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Axis:
    """The swept field of the mission, its values, its label, and the unit of its ticks."""

    field: str
    label: str
    values: tuple[float, ...]
    tick: float = 1.0


@dataclass(frozen=True, slots=True)
class Series:
    """One line of a figure: the runs of each point and seed, and their value."""

    name: str
    label: str
    runs: Callable[[Mission], tuple[Run, ...]]
    value: Callable[..., float]
    count: Callable[[Mission, int], int] = lambda _mission, runs: runs


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure: `base` is the mission at all points, except for the swept field; `kind` is that of the quantity."""

    name: str
    title: str
    base: Mission
    axis: Axis
    quantity: str
    label: str
    series: tuple[Series, ...]
    claim: str
    logarithmic: bool = False
    kind: Kind = "amount"

    def mission(self, x: float, seed: int) -> Mission:
        """Return the mission of one run at the point `x`."""
        value = int(x) if self.axis.field == "uavs" else float(x)
        return msgspec.structs.replace(self.base, **{self.axis.field: value}, seed=seed)

    def samples(self, series: Series, x: float, runs: int) -> Iterator[tuple[Run, ...]]:
        """Yield the runs of each value at one point of a line; seeds count from 0."""
        for seed in range(min(runs, series.count(self.mission(x, 0), runs))):
            yield series.runs(self.mission(x, seed))


def flown(planner: str, minimise: str = "distance") -> Callable[[Mission], Run]:
    """Return the run of a mission with this planner: `edc` in the simulator, the others by their plans alone."""
    measure = FLY if planner == "edc" else FLY_PLAN
    return lambda mission: Run(measure, msgspec.structs.replace(mission, planner=planner, minimise=minimise))


def _one(run: Callable[[Mission], Run]) -> Callable[[Mission], tuple[Run, ...]]:
    return lambda mission: (run(mission),)


def _paper(mission: Mission) -> tuple[Run, ...]:
    """Return the run of the paper's model: as printed if that is affordable, else without the dotted variables."""
    printed = mission.uavs <= PRINTED_UAVS and mission.seed < PRINTED_RUNS
    return (flown(AS_PRINTED if printed else "paper")(mission),)


def _timed(planner: str) -> Callable[[Mission], tuple[Run, ...]]:
    return lambda mission: (Run(TIME_PLANS, msgspec.structs.replace(mission, planner=planner), alone=True),)


def _printed(mission: Mission) -> tuple[Run, ...]:
    return (Run(TIME_FORMS, msgspec.structs.replace(mission, planner=AS_PRINTED), alone=True),)


def _printed_runs(mission: Mission, runs: int) -> int:
    return PRINTED_RUNS if mission.uavs <= PRINTED_UAVS else runs // RUNS_PER_LARGE_PRINTED


def _planners(value: Callable[[Result], float]) -> tuple[Series, ...]:
    return (
        Series("straight", "straight (avoidance off)", _one(flown("straight")), value),
        Series("paper", "paper (eq. 29-43)", _paper, value),
        Series("edc", "edc (this project)", _one(flown("edc")), value),
    )


def _value(result: Result, field: str) -> float:
    """Return a measured value, NaN where it is unknown."""
    return math.nan if result[field] is None else float(result[field])


def _collisions(result: Result) -> float:
    return _value(result, "potential_collisions")


def _extra_m(result: Result) -> float:
    return (_value(result, "path_m") - _value(result, "straight_m")) / int(result["uavs"])


def _each_kj(field: str) -> Callable[[Result], float]:
    return lambda result: _value(result, field) / int(result["uavs"]) / 1e3


def _change_pct(field: str) -> Callable[[Result, Result], float]:
    def change(by_distance: Result, by_energy: Result) -> float:
        before, after = by_distance[field], by_energy[field]
        return 100 * (after / before - 1) if before and after is not None else math.nan

    return change


def _both(mission: Mission) -> tuple[Run, ...]:
    return flown("edc")(mission), flown("edc", "energy")(mission)


UAVS = Axis("uavs", "Number of UAVs", (10, 20, 30, 40, 50))
AREA = Axis("area_m2", "Area [1000 m²]", (10_000, 20_000, 40_000, 60_000, 90_000), tick=1000.0)
RADIUS = Axis("r_m", "GPS error radius r [m]", (1, 2, 4, 6, 8, 10))
BY_UAVS = Mission()
BY_AREA = Mission(uavs=50)
BY_RADIUS = Mission(uavs=50, area_m2=40_000.0)

COLLISIONS = ("potential collisions", "Potential collisions per mission [pairs]", _planners(_collisions))
EXTRA = ("extra distance per UAV [m]", "Extra distance per UAV [m]", _planners(_extra_m))
TIMES = (
    "execution time [s]",
    "Execution time per mission [s]",
    (
        Series("straight", "straight, all slots", _timed("straight"), lambda r: r["total_s"]),
        Series("paper", "paper as printed, one solution", _printed, lambda r: r["printed_s"], _printed_runs),
        Series("edc", "edc, all slots", _timed("edc"), lambda r: r["total_s"]),
        Series("edc-slot", "edc, longest slot", _timed("edc"), lambda r: r["max_s"]),
    ),
)
ENERGY = (
    "energy per UAV [kJ]",
    "Propulsion energy per UAV [kJ]",
    (
        Series("bound", "straight line at full speed (bound)", _one(flown("edc")), _each_kj("energy_straight_j")),
        *_planners(_each_kj("energy_propulsion_j"))[1:],
    ),
)
COMPUTE = (
    "head's computing energy [J]",
    "Computing energy [J per mission]",
    (Series("edc", "edc (this project)", _timed("edc"), lambda r: r["compute_j"]),),
)
SAVINGS = (
    "change [%]",
    'Change by minimise = "energy" [%]',
    (
        Series("energy", "propulsion energy", _both, _change_pct("energy_propulsion_j")),
        Series("distance", "distance flown", _both, _change_pct("path_m")),
        Series("time", "time until all have arrived", _both, _change_pct("makespan_s")),
    ),
)

FIGURES = (
    Figure("4a", "Collisions by number of UAVs", BY_UAVS, UAVS, *COLLISIONS, kind="count",
           claim="The number of collisions depends quadratically on the density of UAVs (here: on their number)."),
    Figure("4b", "Collisions by area", BY_AREA, AREA, *COLLISIONS, kind="count",
           claim="A larger area reduces collisions; they depend quadratically on the density of UAVs."),
    Figure("4c", "Collisions by GPS error", BY_RADIUS, RADIUS, *COLLISIONS, kind="count",
           claim="The number of collisions depends linearly on the UAVs' GPS error."),
    Figure("5a", "Extra distance by number of UAVs", BY_UAVS, UAVS, *EXTRA,
           claim="The more UAVs in the cluster, the less extra distance is covered."),
    Figure("5b", "Extra distance by area", BY_AREA, AREA, *EXTRA,
           claim="The wider the area, the more extra distance is travelled."),
    Figure("6a", "Execution time by number of UAVs", BY_UAVS, UAVS, *TIMES, logarithmic=True,
           claim="Execution time grows with the number of UAVs."),
    Figure("6b", "Execution time by area", BY_AREA, AREA, *TIMES, logarithmic=True,
           claim="Execution time grows with the area."),
    Figure("energy-plan", "Propulsion energy beside the straight-line bound", BY_UAVS, UAVS, *ENERGY,
           claim="The longer the extra distance travelled, the higher the energy consumption."),
    Figure("energy-head", "Computing energy of the head", BY_UAVS, UAVS, *COMPUTE,
           claim="What the head's computing adds to the energy bill of the swarm."),
    Figure("energy-minimise", "What minimising energy saves, and what it costs", BY_UAVS, UAVS, *SAVINGS, kind="signed",
           claim="Whether energy is saved when it, not the distance, is minimised."),
)  # fmt: skip

LONG = "energy-long"
LONG_FILE = "scenarios/long-energy.toml"
LONG_MISSION = Mission(
    name="long-energy",
    seed=1,
    uavs=12,
    area_m2=16_000_000.0,
    dt_s=1.0,
    handover_margin=0.005,
    energy=EnergyModel(radio_j_per_message=1.0, initial_min_j=140_000.0, initial_max_j=141_000.0),
)
"""The mission of `LONG_FILE`. Its batteries are nearly equal and its radio takes energy, so heads change."""
LONG_RUN = Run(FLY_LONG, LONG_MISSION, file=LONG_FILE)
NAMES = (*(figure.name for figure in FIGURES), LONG)


def chosen(only: Sequence[str]) -> list[str]:
    """Return the names of the figures to make: the given ones, or all.

    Raises
    ------
    InputError
        A given name is not a figure.
    """
    for name in only:
        if name not in NAMES:
            raise InputError("--only", name, f"one of {', '.join(NAMES)}")
    return [name for name in NAMES if name in only or not only]


def figures_of(names: Sequence[str]) -> list[Figure]:
    """Return the declared figures among `names`."""
    return [figure for figure in FIGURES if figure.name in names]


def runs_of(names: Sequence[str], runs: int) -> list[Run]:
    """Return every run that the figures need, once; seed by seed, so that progress is even."""
    found: dict[str, Run] = {}
    for figure in figures_of(names):
        for series in figure.series:
            for x in figure.axis.values:
                for sample in figure.samples(series, x, runs):
                    found.update({run.key: run for run in sample})
    if LONG in names:
        found[LONG_RUN.key] = LONG_RUN
    return sorted(found.values(), key=lambda run: run.mission.seed)
