"""Missions from the names of options, and their simulation, for notebooks."""

from __future__ import annotations

import inspect
import warnings
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import msgspec
import numpy as np

from edc_swarm.analysis.timings import Timings, content_hash
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.stated import attribute_of, fields_by_option, named_as_options, with_stated
from edc_swarm.mission.validation import load_mission
from edc_swarm.protocol.messages import mission_message
from edc_swarm.simulation.take_off import ready_mission, warnings_of
from processes.experiments.recorded_simulation import RecordedSimulation
from processes.notebook.flight import TIMINGS, Flight
from processes.uav.planner_loader import warm_planner

_OPTIONS = {field: attribute_of(option) for field, option in fields_by_option().items() if "." in field}
"""The option of each field of a table or of the links, by which errors name it."""
_PARTS = {"planner", "elect", "gps_model", "link.model"}
"""Fields that may be a class of the user."""


def new_mission(source: Mission | str | Path | None = None, /, **options: Any) -> Mission:
    """Return a mission: a mission file or another mission, with options in place of its fields.

    Parameters
    ----------
    source
        A mission, or the path of a mission file (TOML). Without one: the default mission.
    **options
        Fields of a mission (docs/mission.md), or options of `edc-swarm sim` with underscores: `uavs`, `seed`, `area`,
        `loss`, `delay_ms`, `fault` (a list), ... A planner or another part of your own may be its class.

    Raises
    ------
    MissionError
        With the field, the value and what is allowed.
    """
    if not isinstance(source, Mission | str | Path | None):
        raise MissionError("source", source, "a Mission, or the path of a mission file")
    base = source if isinstance(source, Mission) else Mission() if source is None else load_mission(source)
    with named_as_options(_OPTIONS):
        return with_stated(base, {name: _named(name, value) for name, value in options.items()})


def _named(field: str, value: Any) -> Any:
    """Return a value as a mission states it: a class as `package.module:Class`, a number of NumPy as one of Python.

    In lists and tables too, since the model of a link stands in `link`. An object of the class is no part of a mission:
    each process makes its own.
    """
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {key: _named(f"{field}.{key}", each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_named(field, each) for each in value]
    if inspect.isclass(value):
        return f"{value.__module__}:{value.__qualname__}"
    if field in _PARTS and not isinstance(value, str):
        raise MissionError(field, value, "a name, a class, or package.module:Class; not an object of the class")
    return value


def simulate(source: Mission | str | Path | None = None, /, **options: Any) -> Flight:
    """Fly a mission in the simulator; parameters as of `new_mission`. The same mission gives the same messages.

    Raises
    ------
    MissionError
        With the field, the value and what is allowed.
    """
    flown = new_mission(source, **options)
    with named_as_options(_OPTIONS):
        flown = ready_mission(flown)
    for text in warnings_of(flown):
        warnings.warn(text, stacklevel=2)
    path = Path(mkdtemp(prefix="edc-swarm-")) / "flight.mcap"
    message = mission_message(flown)
    warm_planner(flown, helped=True)
    with path.open("wb") as stream:
        recorded = RecordedSimulation(message, stream, lambda _: None, viz=False)
        timings = recorded.finish(recorded.simulation.run())
    path.with_suffix(TIMINGS).write_bytes(msgspec.json.encode(Timings(content_hash(path), timings)))
    return Flight(path, own=True)
