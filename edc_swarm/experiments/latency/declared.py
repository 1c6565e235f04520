"""Declarations of latency sweeps: every combination of network qualities and swarms, with several missions each.

A sweep file is TOML. Its keys are the fields of `LatencySweep`, its table `mission` has the content of a mission
file, and its table `link` the remaining fields of the swept link (see `edc_swarm.mission.configuration.Link`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct

from edc_swarm.emulation.energy import check_batteries
from edc_swarm.errors import MissionError
from edc_swarm.experiments.latency.arithmetic import only_holds
from edc_swarm.experiments.sweeps import Run
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.field_types import MAX_UAVS, MOST_SLOTS
from edc_swarm.mission.link import Link
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import (
    convert,
    mission_from_dict,
    refuse_idle,
    refuse_non_finite,
    refuse_unknown,
    with_options,
)
from edc_swarm.planner.registry import check_planner

Engine = Literal["sim", "processes"]
MEASURE: dict[Engine, str] = {"sim": "fly_latency", "processes": "fly_processes"}
VERB: dict[Engine, str] = {"sim": "sim", "processes": "run"}
MAX_RUNS = 100_000
MOST_VALUES = 100

Value = TypeVar("Value")
Values = Annotated[list[Value], Meta(min_length=1, max_length=MOST_VALUES)]
Milliseconds = Annotated[float, Meta(ge=0, le=60_000)]
Loss = Annotated[float, Meta(ge=0, le=1)]
Slot = Annotated[float, Meta(ge=0.02, le=60)]
Uavs = Annotated[int, Meta(ge=2, le=MAX_UAVS)]


class LatencySweep(Struct, frozen=True, kw_only=True):
    """A sweep: every combination of its lists, with `repeats` missions (seeds 0, 1, ...) of each.

    `hold_slots` is the length of a mission in a cell in which, by the slot arithmetic, the UAVs can only hold; in all
    other cells it is `max_slots` (0: the mission's own limit). `link` is the swept link and `mission` the rest of the
    mission. A link of the mission itself takes precedence where it matches.
    """

    engine: Engine = "sim"
    delays_ms: Values[Milliseconds]
    jitters_ms: Values[Milliseconds]
    losses: Values[Loss]
    slots_s: Values[Slot]
    uavs: Values[Uavs]
    repeats: Annotated[int, Meta(ge=1, le=1000)]
    hold_slots: Annotated[int, Meta(ge=10, le=MOST_SLOTS)]
    max_slots: Annotated[int, Meta(ge=0, le=MOST_SLOTS)] = 0
    link: Link = Link()
    mission: Mission = Mission()

    @property
    def cells(self) -> list[Cell]:
        """Return every combination, in the order of the lists."""
        axes = (self.uavs, self.slots_s, self.jitters_ms, self.losses, self.delays_ms)
        return [Cell(*values) for values in product(*axes)]


DEFAULTS: dict[Engine, dict[str, Any]] = {
    "sim": {
        "delays_ms": [0, 50, 100, 150, 200, 300, 400],
        "jitters_ms": [0, 50, 200],
        "losses": [0, 0.1, 0.3, 0.5],
        "slots_s": [0.5],
        "uavs": [10, 30],
        "repeats": 3,
        "hold_slots": 100,
    },
    "processes": {
        "delays_ms": [0, 100, 200, 300],
        "jitters_ms": [0, 50],
        "losses": [0, 0.3],
        "slots_s": [0.5],
        "uavs": [10],
        "repeats": 3,
        "hold_slots": 40,
    },
}
"""Default sweep of each engine: a full grid in the simulator, a sparse one with real processes."""


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """One point of the grid."""

    uavs: int
    slot_s: float
    jitter_ms: float
    loss: float
    delay_ms: float


def sweep_of(raw: Mapping[str, Any]) -> LatencySweep:
    """Return plain data as a validated sweep; missing fields come from the engine's `DEFAULTS`.

    Raises
    ------
    InputError
        A field is invalid; the error has the field, the value and the allowed values.
    """
    refuse_unknown(raw, LatencySweep)
    refuse_non_finite(raw)
    engine = raw.get("engine", "sim")
    sweep = convert({**DEFAULTS["processes" if engine == "processes" else "sim"], **raw}, LatencySweep)
    if isinstance(mission := raw.get("mission"), Mapping):
        refuse_idle(mission.get("vehicle"))
        sweep = msgspec.structs.replace(sweep, mission=mission_from_dict(mission))
    _check(sweep)
    return sweep


def _check(sweep: LatencySweep) -> None:
    for name in ("delays_ms", "jitters_ms", "losses", "slots_s", "uavs"):
        values = getattr(sweep, name)
        if len(set(values)) < len(values):
            raise MissionError(name, values, "a list without repetitions")
    if (runs := len(sweep.cells) * sweep.repeats) > MAX_RUNS:
        raise MissionError("repeats", sweep.repeats, f"so few that all cells need at most {MAX_RUNS} runs, not {runs}")
    for cell in sweep.cells[:: len(sweep.losses) * len(sweep.delays_ms) * len(sweep.jitters_ms)]:
        mission = complete_mission(mission_of(sweep, cell, 0))
        parse_faults(mission)
        check_batteries(mission)
    check_planner(sweep.mission)


def mission_of(sweep: LatencySweep, cell: Cell, seed: int) -> Mission:
    """Return the mission of one run."""
    swept = msgspec.structs.replace(sweep.link, delay_ms=cell.delay_ms, jitter_ms=cell.jitter_ms, loss=cell.loss)
    fields = {"uavs": cell.uavs, "dt_s": cell.slot_s, "seed": seed, "link": [swept, *sweep.mission.link]}
    mission = msgspec.structs.replace(sweep.mission, **fields)
    limit = sweep.hold_slots if only_holds(mission) else sweep.max_slots
    return with_options(mission, {"max_slots": limit or mission.max_slots})


def run_name(mission: Mission) -> str:
    """Return the name of the files of one run of a sweep."""
    link = mission.link[0]
    return (
        f"k{mission.uavs}-slot{1e3 * mission.dt_s:g}-delay{link.delay_ms:g}-jitter{link.jitter_ms:g}"
        f"-loss{100 * link.loss:g}-seed{mission.seed}"
    )


def runs_of(sweep: LatencySweep, engine: Engine) -> dict[Cell, list[Run]]:
    """Return the runs of every cell with `engine`."""
    return {
        cell: [Run(MEASURE[engine], mission_of(sweep, cell, seed), verb=VERB[engine]) for seed in range(sweep.repeats)]
        for cell in sweep.cells
    }


def in_turn(runs: Mapping[Cell, Sequence[Run]]) -> list[Run]:
    """Return all runs, seed by seed, so that a stopped sweep covers the whole grid."""
    return [run for turn in zip(*runs.values(), strict=True) for run in turn]
