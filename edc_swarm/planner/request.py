"""Plan request as arrays, checked once for all planners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from edc_swarm.errors import InputError
from edc_swarm.geometry import Floats, Indices
from edc_swarm.planner.interface import ForeignUav, Hull, PlanRequest
from edc_swarm.solver.hull_rows import Obstacles


@dataclass(frozen=True, slots=True)
class ForeignArrays:
    """UAVs of other clusters as arrays: `uav` (m,), places and targets (m, 2), `rest_m` and `r_m` (m,); the hulls."""

    uav: Indices
    position_m: Floats
    previous_m: Floats
    target_m: Floats
    rest_m: Floats
    r_m: Floats
    hulls: Obstacles


@dataclass(frozen=True, slots=True)
class Arrays:
    """Fields of a `PlanRequest` as numpy arrays; `obstacles` has the hulls."""

    slot: int
    uav: Indices
    position_m: Floats
    target_m: Floats
    r_m: Floats
    previous_m: Floats | None
    obstacles: Obstacles
    rest_m: Floats
    foreign: ForeignArrays = field(default_factory=lambda: _foreign_arrays((), ()))


def checked_arrays(request: PlanRequest) -> Arrays:
    """Return the request as arrays.

    Raises
    ------
    InputError
        Lengths differ, a number is not finite, a radius is negative, or a UAV occurs twice.
    """
    uav = np.asarray(request.uav, dtype=np.int64).reshape(-1)
    count = len(uav)
    if len(np.unique(uav)) != count or (count and uav.min() < 0):
        raise InputError("request.uav", request.uav, "distinct roster indices")
    previous_m = request.previous_m
    return Arrays(
        request.slot,
        uav,
        _points("position_m", request.position_m, count),
        _points("target_m", request.target_m, count),
        _lengths("r_m", request.r_m, count),
        None if previous_m is None else _points("previous_m", previous_m, count),
        _obstacles("hulls", request.hulls),
        np.zeros(count) if request.rest_m is None else _lengths("rest_m", request.rest_m, count),
        _foreign_arrays(request.foreign, request.foreign_hulls),
    )


def _obstacles(name: str, given: Sequence[Hull]) -> Obstacles:
    hulls = np.array([(h.ax_m, h.ay_m, h.bx_m, h.by_m, h.radius_m, h.r_m) for h in given], dtype=np.float64).reshape(
        -1, 6
    )
    _check(name, hulls, len(hulls))
    _check(name, hulls[:, 4:], len(hulls), least=0.0)
    return Obstacles(hulls[:, 0:2], hulls[:, 2:4], hulls[:, 4], hulls[:, 5])


def _foreign_arrays(foreign: Sequence[ForeignUav], hulls: Sequence[Hull]) -> ForeignArrays:
    count = len(foreign)
    return ForeignArrays(
        np.array([other.uav for other in foreign], dtype=np.int64),
        _points("foreign", [other.position_m for other in foreign], count),
        _points("foreign", [other.previous_m for other in foreign], count),
        _points("foreign", [other.target_m for other in foreign], count),
        _lengths("foreign", [other.rest_m for other in foreign], count),
        _lengths("foreign", [other.r_m for other in foreign], count),
        _obstacles("foreign_hulls", hulls),
    )


def steps_of(u_max_m: Floats, uav: Indices) -> Floats:
    """Return the longest steps (n,) of the UAVs with these roster indices; `u_max_m` is (K,), or () for one for all."""
    return u_max_m[uav] if u_max_m.ndim else np.full(len(uav), u_max_m)


def _lengths(name: str, values: object, count: int) -> Floats:
    return _check(name, np.asarray(values, dtype=np.float64).reshape(-1), count, least=0.0)


def _points(name: str, values: object, count: int) -> Floats:
    return _check(name, np.array(values, dtype=np.float64).reshape(-1, 2), count)


def _check(name: str, values: Floats, count: int, least: float = -np.inf) -> Floats:
    if len(values) != count:
        raise InputError(f"request.{name}", f"{len(values)} rows", f"{count} rows, one per UAV")
    if not np.isfinite(values).all() or (values < least).any():
        bad = values[~np.isfinite(values) | (values < least)][0]
        raise InputError(f"request.{name}", float(bad), "finite" if least < 0 else f"finite and at least {least:g}")
    return values
