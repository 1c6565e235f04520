"""Sweeps in a notebook: every combination of the values of some options, each with many seeds."""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice, pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np

from edc_swarm.analysis.frames import new_frame
from edc_swarm.errors import InputError
from edc_swarm.experiments.statistics import Kind, estimate
from edc_swarm.experiments.sweeps import Run, mission_toml
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declarations import UNITS
from edc_swarm.mission.stated import attribute_of, fields_by_option
from edc_swarm.simulation.take_off import ready_mission
from processes.experiments.ledger import Ledger, open_scheduler
from processes.experiments.ledger import sweep as execute
from processes.notebook.pictures import new_axes
from processes.notebook.simulate import new_mission

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_RUNS = 100_000
COUNTS = frozenset({"potential_collisions", "true_collisions"})
SIGNED = frozenset({"min_disc_gap_m"})
"""Metrics that may be negative."""
_UNITS = {suffix: symbol for suffix, (symbol, _) in UNITS.items()} | {"_pct": "%"}
_FIELDS = {attribute_of(option): field for field, option in fields_by_option().items()}
"""Field that an option sets, by the option's name in Python."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """The missions of a sweep and their metrics.

    Attributes
    ----------
    axes
        Values of each option that was varied, by its name.
    rows
        One for each mission: the values of the axes, `seed`, and every metric that is one number or flag.
    """

    axes: dict[str, list[Any]]
    rows: list[dict[str, Any]]

    def __repr__(self) -> str:
        """Return the number of missions, and what was varied."""
        varied = ", ".join(f"{name} ({len(values)} values)" for name, values in self.axes.items())
        return f"<Sweep of {len(self.rows)} missions: {varied or 'seeds alone'}>"

    @property
    def runs(self) -> Any:
        """A pandas frame with a row for each mission."""
        return new_frame(self.rows)

    def summary(self, metric: str, kind: Kind | None = None) -> Any:
        """Return a pandas frame with the mean of a metric and its 95 % interval for each point of the axes.

        `unknown` counts the missions whose recording does not tell the metric; they are in no mean. A flag is given in
        per cent of the missions.

        Parameters
        ----------
        metric
            Name of a column of `runs`.
        kind
            Kind of the quantity, which decides the interval (`edc_swarm.experiments.statistics.estimate`); by default
            "count" for collisions, "signed" for gaps, else "amount".

        Raises
        ------
        InputError
            There is no such metric.
        """
        return new_frame(self._points(metric, kind))

    def plot(self, metric: str, x: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw the mean of a metric against an axis (the first by default), with its 95 % interval; return the axes.

        Each combination of the other axes is a line.
        """
        x = x or next(iter(self.axes), "")
        if x not in self.axes:
            allowed = f"one of {', '.join(self.axes)}" if self.axes else "an option that the sweep was given as a list"
            raise InputError("x", x, allowed)
        others = [name for name in self.axes if name != x]
        points = self._points(metric, None)
        ax = new_axes(ax)
        for key in dict.fromkeys(tuple(point[name] for name in others) for point in points):
            line = [point for point in points if tuple(point[name] for name in others) == key]
            label = ", ".join(_with_unit(name, f" {value}") for name, value in zip(others, key, strict=True))
            shown = [point for point in line if point["mean"] is not None]
            means = np.array([point["mean"] for point in shown], float)
            ends = np.array([(point["low"], point["high"]) for point in shown], float).reshape(-1, 2)
            at = [point[x] for point in shown]
            ax.plot(at, means, marker="o", label=label or None)
            ax.fill_between(at, ends[:, 0], ends[:, 1], alpha=0.2)
        ax.set_xlabel(_with_unit(x))
        ax.set_ylabel(f"{metric} [% of missions]" if self._is_flag(metric) else _with_unit(metric))
        if all(map(_is_whole, self.axes[x])):
            ax.locator_params(axis="x", integer=True)
        if others:
            ax.legend()
        return ax

    def _is_flag(self, metric: str) -> bool:
        return any(isinstance(row.get(metric), bool) for row in self.rows)

    def _points(self, metric: str, kind: Kind | None) -> list[dict[str, Any]]:
        if all(metric not in row for row in self.rows):
            raise InputError("metric", metric, f"one of {', '.join(self.rows[0]) if self.rows else 'none'}")
        flag = self._is_flag(metric)
        kind = "share of runs" if flag else kind or _kind_of(metric)
        points = []
        for values in product(*self.axes.values()):
            point = dict(zip(self.axes, values, strict=True))
            found = [row.get(metric) for row in self.rows if all(row[name] == value for name, value in point.items())]
            known = [100.0 * value if flag else float(value) for value in found if value is not None]
            mean = estimate(known, kind) if known else None
            points.append(
                {
                    **point,
                    "runs": len(known),
                    "unknown": len(found) - len(known),
                    "mean": mean and mean.mean,
                    "low": mean and mean.low,
                    "high": mean and mean.high,
                }
            )
        return points


def sweep(
    source: Mission | str | Path | None = None,
    /,
    *,
    seeds: SupportsIndex | Iterable[int] = 10,
    jobs: int | None = None,
    scheduler: str | None = None,
    folder: str | Path | None = None,
    **options: Any,
) -> Sweep:
    """Simulate every combination of the options that are given as lists, each with every seed.

    Parameters
    ----------
    source
        A mission, or the path of a mission file; its fields hold where no option is given.
    seeds
        The seeds, or their number. A seed or value that is given twice is refused: the same mission is no new evidence.
    jobs
        Number of worker processes (one for each processor; none with a class that a notebook defines).
    scheduler
        Address of a Dask scheduler (extra `cluster`) whose workers simulate instead.
    folder
        Folder for the results. A sweep that was stopped goes on from there; without one, results are kept nowhere.
    **options
        As of `new_mission`; a list, tuple, range or array of values is an axis. `fault` is a list by itself: a list of
        lists is an axis.

    Raises
    ------
    MissionError
        A mission is not valid: no mission is simulated.
    InputError
        The seeds, the jobs, or the values of an axis are not valid.
    SweepError
        A run failed; the folder keeps the results so far.
    """
    if "seed" in options:
        raise InputError("seed", options["seed"], "given as seeds")
    chosen = _seeds(seeds)
    axes = {name: _values(name, values) for name, values in options.items() if _is_axis(name, values)}
    fixed = {name: value for name, value in options.items() if name not in axes}
    count = math.prod(map(len, axes.values())) * len(chosen)
    if count > MAX_RUNS:
        raise InputError("seeds", seeds, f"at most {MAX_RUNS} missions in all, not {count}")
    places = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    with ExitStack() as stack:
        home = Path(folder or stack.enter_context(TemporaryDirectory(prefix="edc-swarm-")))
        wanted = [
            (
                {name: _shown(value) for name, value in place.items()} | {"seed": seed},
                _run(new_mission(source, **{**fixed, **place, "seed": seed}), home),
            )
            for place in places
            for seed in chosen
        ]
        if any(_is_of_notebook(run.mission) for _, run in wanted):
            if scheduler is not None or jobs not in (None, 1):
                allowed = "left out for a class of the notebook, which other processes cannot import (or in a module)"
                raise InputError("jobs" if scheduler is None else "scheduler", scheduler or jobs, allowed)
            jobs = 1
        executor = stack.enter_context(open_scheduler(scheduler, jobs))
        ledger = stack.enter_context(Ledger(home))
        _write_missions([run for _, run in wanted])
        results = execute([run for _, run in wanted], ledger, executor)
    rows = [place | _numbers(results[run.key]) for place, run in wanted]
    return Sweep({name: [_shown(value) for value in values] for name, values in axes.items()}, rows)


def _shown(value: Any) -> Any:
    """Return a class by the name by which missions record it, any other value as it is."""
    return f"{value.__module__}:{value.__qualname__}" if isinstance(value, type) else value


def _with_unit(name: str, value: str = "") -> str:
    """Return the name of an option or metric in words, with its unit: in brackets, or behind a value."""
    field = _FIELDS.get(name, name)
    suffix, unit = next(((suffix, unit) for suffix, unit in _UNITS.items() if field.endswith(suffix)), ("", ""))
    words = f"{name.removesuffix(suffix).replace('_', ' ').replace('uavs', 'UAVs')}{value}"
    return words if not unit else f"{words} {unit}" if value else f"{words} [{unit}]"


def _seeds(given: Any) -> list[int]:
    allowed = f"a number from 1 to {MAX_RUNS}, or different whole numbers"
    if _is_whole(given) and 1 <= given <= MAX_RUNS:
        return list(range(given))
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise InputError("seeds", given, allowed)
    found = _values("seeds", given)
    if not all(map(_is_whole, found)):
        raise InputError("seeds", given, allowed)
    return [int(seed) for seed in found]


def _is_whole(value: Any) -> bool:
    """Return True for an integer, of NumPy too."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _values(name: str, values: Iterable[Any]) -> list[Any]:
    """Return the values of an axis, which differ from each other."""
    found = list(islice(values, MAX_RUNS + 1))
    if not 1 <= len(found) <= MAX_RUNS:
        raise InputError(name, values, f"a list of 1 to {MAX_RUNS} values")
    twice = [value for value, other in pairwise(sorted(found, key=repr)) if value == other]
    if twice:
        raise InputError(name, twice[0], "in the list once")
    return found


def _kind_of(metric: str) -> Kind:
    return "count" if metric in COUNTS else "signed" if metric in SIGNED else "amount"


def _is_axis(name: str, value: Any) -> bool:
    if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__iter__"):
        return False
    if not isinstance(getattr(Mission(), name, None), list):
        return True
    return any(isinstance(each, list | tuple) for each in value)


def _is_of_notebook(mission: Mission) -> bool:
    """Return True if a part of the mission is a class of the notebook, or of another session without a file."""
    parts = [mission.planner, mission.elect, mission.gps_model, *(link.model for link in mission.link)]
    return not hasattr(sys.modules["__main__"], "__file__") and any(part.startswith("__main__:") for part in parts)


def _run(flown: Mission, home: Path) -> Run:
    """Return the run of a mission, after every check. Where options cannot express it, its command names a file."""
    ready_mission(flown)
    run = Run("fly", flown)
    try:
        _ = run.command
    except InputError:
        name = hashlib.sha256(mission_toml(flown).encode()).hexdigest()[:16]
        return Run("fly", flown, file=str(home / "missions" / f"{name}.toml"))
    return run


def _write_missions(runs: Iterable[Run]) -> None:
    for run in runs:
        if run.file:
            path = Path(run.file)
            path.parent.mkdir(exist_ok=True)
            path.write_text(mission_toml(run.mission), encoding="utf-8")


def _numbers(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return the metrics that are one number, flag or text, and those that are unknown."""
    return {
        name: value for name, value in metrics.items() if value is None or isinstance(value, bool | int | float | str)
    }
