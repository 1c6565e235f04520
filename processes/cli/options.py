"""Options that `run` and `sim` share: a mission from a file, defaults and the command line."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cyclopts import Parameter
from msgspec import to_builtins

from edc_swarm.emulation.energy import check_batteries, stranded
from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import Criterion, GpsModel, Minimise, Mission, load_mission, with_options
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.roster import complete_mission
from edc_swarm.planner.registry import check_planner
from processes.cli.whole import Whole
from processes.runtime.console import note

MISSION_HELP = "Mission file (TOML); without one, a random mission."

FIELDS = {
    "uavs": "uavs",
    "area": "area_m2",
    "gps_error": "r_m",
    "gps_model": "gps_model",
    "seed": "seed",
    "slot": "dt_s",
    "speed_max": "v_max_mps",
    "planner": "planner",
    "minimise": "minimise",
    "elect": "elect",
    "time_scale": "time_scale",
    "max_slots": "max_slots",
}
"""Field of the mission that an option sets."""
LINK_FIELDS = {name: f"link.{name}" for name in ("delay_ms", "jitter_ms", "loss")}
"""Field of every link of the mission that an option sets."""
MOST_LISTED = 5


@contextmanager
def named_as_options(options: Mapping[str, str]) -> Iterator[None]:
    """Let what is raised speak of options where the user has given options: `options` by the fields that they set.

    A field of a list, such as link[0].loss or delays_ms[2], belongs to the option for the whole of it.
    """
    try:
        yield
    except InputError as error:
        field = options.get(re.sub(r"\[\d+\]", "", error.field), error.field)
        allowed = re.sub(r"\w+_\w+", lambda name: options.get(name[0], name[0]), error.allowed)
        raise type(error)(field, error.value, allowed) from None


def _warn_of_batteries(mission: Mission) -> None:
    """Tell before take-off who cannot get home: it is a mission all the same."""
    needed_j = stranded(mission)
    if not needed_j:
        return
    battery_j = {entry.uav: entry.energy_j for entry in mission.roster}
    named = [f"{uav} ({battery_j[uav]:.4g} of {needed_j[uav]:.4g} J)" for uav in [*needed_j][:MOST_LISTED]]
    more = f" and {len(needed_j) - MOST_LISTED} more" if len(needed_j) > MOST_LISTED else ""
    note(f"warning: no battery for the straight flight to the target at full speed: {', '.join(named)}{more}")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MissionOptions:
    """What may be said on the command line about the mission; what is not said stays as in the file.

    Parameters
    ----------
    uavs
        Number of UAVs (10).
    area
        Area of the random mission in square metres (10000).
    gps_error
        GPS error radius in metres (5).
    gps_model
        GPS error model (bias).
    seed
        Seed of everything that is drawn at random (0).
    slot
        Length of a slot in seconds of the mission (0.5).
    speed_max
        Largest speed in metres per second (5).
    planner
        edc, straight, paper, or package.module:Class (edc).
    minimise
        What guidance minimises (distance).
    elect
        Criterion for the head (energy).
    fault
        Something to go wrong, such as "kill head @10"; may be given more than once.
    fault_help
        Print the fault vocabulary and exit.
    delay_ms
        One-way delay of every link in wall milliseconds (0).
    jitter_ms
        Jitter of every link: more delay, drawn for every message from 0 to so many wall milliseconds (0).
    loss
        Fraction, 0 to 1, of the messages that every link loses (0).
    time_scale
        Fly this many times as fast as the clock (1).
    max_slots
        Slots after which the mission is given up (as many as G7 needs for a verdict: after the last fault 20 times the
        longest straight flight, plus 200, and more where links lose messages for good).
    out
        The recording to write (a new name in recordings/).
    no_viz
        Leave out of the recording what Foxglove and Lichtblick show.
    json
        Print the metrics as JSON alone on standard output.
    force
        Overwrite an existing recording.
    """

    uavs: Whole | None = None
    area: float | None = None
    gps_error: float | None = None
    gps_model: GpsModel | None = None
    seed: Whole | None = None
    slot: float | None = None
    speed_max: float | None = None
    planner: str | None = None
    minimise: Minimise | None = None
    elect: Criterion | None = None
    fault: list[str] = field(default_factory=list)
    fault_help: bool = False
    delay_ms: float | None = None
    jitter_ms: float | None = None
    loss: float | None = None
    time_scale: float | None = None
    max_slots: Whole | None = None
    out: Path | None = None
    no_viz: bool = False
    json: bool = False
    force: bool = False

    def mission(self, file: Path | None) -> Mission:
        """The whole mission: file, then options, then what must be drawn or derived.

        Raises
        ------
        MissionError
            With the field, the value and what is allowed.
        """
        base = load_mission(file) if file is not None else Mission()
        with named_as_options(self._options()):
            mission = complete_mission(with_options(base, self._given(base)))
            parse_faults(mission)
            check_planner(mission)
            check_batteries(mission)
        _warn_of_batteries(mission)
        return mission

    def _options(self) -> dict[str, str]:
        """The option that was given for each field of the mission."""
        fields = {**FIELDS, **LINK_FIELDS}
        given = {field: option for option, field in fields.items() if getattr(self, option) is not None}
        if self.fault:
            given["fault"] = "fault"
        return {field: f"--{option.replace('_', '-')}" for field, option in given.items()}

    def _given(self, base: Mission) -> dict[str, Any]:
        options = {name: getattr(self, option) for option, name in FIELDS.items()}
        given = {name: value for name, value in options.items() if value is not None}
        if self.fault:
            given["fault"] = [*base.fault, *self.fault]
        link = {name: getattr(self, name) for name in LINK_FIELDS}
        if stated := {name: value for name, value in link.items() if value is not None}:
            given["link"] = [stated, *({**rule, **stated} for rule in to_builtins(base.link))]
        return given
