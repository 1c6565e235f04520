"""EDC-UAV as software: a pure, deterministic library for centrally planned UAV swarms.

Nothing in this package opens a socket, starts a thread, reads a clock or draws from a global
random generator. `processes` puts the same classes on a real bus. Every package below says in its
`__init__` what it decides, what it may import and which file to open first. No `__init__` imports
anything, so a UAV process starts without numpy.

The public names, for notebooks and scripts (docs/python.md), are those of `processes.notebook.api`. Nothing else of
this package takes anything from `processes`. The names are imported when one is first used.

>>> import edc_swarm as es
>>> run = es.simulate(uavs=20, loss=0.1)  # doctest: +SKIP

Reference: S. Ouahouah, J. Prados-Garzon, T. Taleb, C. Benzaid, "Energy and Delay aware Physical
Collision Avoidance in Unmanned Aerial Vehicles", IEEE GLOBECOM 2018,
doi 10.1109/GLOCOM.2018.8647223 ("the paper" in every docstring).
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from processes.notebook.api import *  # noqa: F403
    from processes.notebook.api import __all__ as __all__
else:

    def __getattr__(name: str) -> object:
        """Return a public name, or the list of all; a package of this one is imported without the public names."""
        from importlib import import_module, util  # noqa: PLC0415  (only where a name is used)

        special = name.startswith("__") and name != "__all__"
        if not special and (name == "__all__" or util.find_spec(f"{__name__}.{name}") is None):
            api = import_module("processes.notebook.api")
            if name == "__all__" or name in api.__all__:
                return getattr(api, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        """Return the names that a notebook completes."""
        return sorted({*globals(), *__getattr__("__all__")})
