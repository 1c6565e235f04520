"""The public names of `import edc_swarm`, which `edc_swarm.__getattr__` takes from here when they are first used."""

from __future__ import annotations

from edc_swarm.errors import InputError, MissionError, RecordingError, SwarmError
from edc_swarm.mission.configuration import Mission
from processes.experiments.ledger import SweepError
from processes.notebook.flight import Flight, load
from processes.notebook.simulate import new_mission, simulate
from processes.notebook.sweep import Sweep, sweep

__all__ = [
    "Flight",
    "InputError",
    "Mission",
    "MissionError",
    "RecordingError",
    "SwarmError",
    "Sweep",
    "SweepError",
    "load",
    "new_mission",
    "simulate",
    "sweep",
]
