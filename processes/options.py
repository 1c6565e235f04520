"""Options that `run` and `sim` share: a mission from a file, defaults and the command line."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cyclopts import Parameter
from msgspec import to_builtins

from edc_swarm.config import Criterion, GpsModel, Minimise, Mission, load_mission, with_options
from edc_swarm.faults import parse_faults
from edc_swarm.planner import check_planner
from edc_swarm.roster import complete_mission
from processes.whole import Whole

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
        mission = complete_mission(with_options(base, self._given(base)))
        parse_faults(mission)
        check_planner(mission)
        return mission

    def _given(self, base: Mission) -> dict[str, Any]:
        options = {name: getattr(self, option) for option, name in FIELDS.items()}
        given = {name: value for name, value in options.items() if value is not None}
        if self.fault:
            given["fault"] = [*base.fault, *self.fault]
        link = {name: getattr(self, name) for name in ("delay_ms", "jitter_ms", "loss")}
        if stated := {name: value for name, value in link.items() if value is not None}:
            given["link"] = [stated, *({**rule, **stated} for rule in to_builtins(base.link))]
        return given
