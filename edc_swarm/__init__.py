"""EDC-UAV as software: a pure, deterministic library for centrally planned UAV swarms.

Nothing in this package opens a socket, starts a thread, reads a clock or draws from a global
random generator. `processes` puts the same classes on a real bus. Every package below says in its
`__init__` what it decides, what it may import and which file to open first. No `__init__` imports
anything, so a UAV process starts without numpy.

The names of `__all__` are for notebooks and scripts (docs/python.md). Each is imported when it is first used. They come
from `processes.notebook`, the one place that this package takes anything from `processes`: it is the door of both.

>>> import edc_swarm as es
>>> run = es.simulate(uavs=20, loss=0.1)  # doctest: +SKIP

Reference: S. Ouahouah, J. Prados-Garzon, T. Taleb, C. Benzaid, "Energy and Delay aware Physical
Collision Avoidance in Unmanned Aerial Vehicles", IEEE GLOBECOM 2018,
doi 10.1109/GLOCOM.2018.8647223 ("the paper" in every docstring).
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from processes.notebook.api import (
        Flight,
        InputError,
        Mission,
        MissionError,
        RecordingError,
        SwarmError,
        Sweep,
        SweepError,
        load,
        new_mission,
        simulate,
        sweep,
    )
else:

    def __getattr__(name: str) -> object:
        """Return a public name from its module."""
        from importlib import import_module  # noqa: PLC0415  (only for who uses a name)

        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module("processes.notebook.api"), name)


__version__ = "0.1.0"

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
