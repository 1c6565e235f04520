"""Planners behind one small interface.

This package decides the next waypoint of each UAV. It imports `solver`, `emulation.energy`, `mission`,
`geometry` and `errors`; it never sees a message. Open `interface` first; a planner of your own implements
`interface.Planner`.

The names of `__all__` are what a planner of your own needs (docs/planner.md). Each is imported when it is first used,
so that importing this package imports no other module.

>>> from edc_swarm.planner import Plan, make_planner
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from edc_swarm.planner.interface import Hull, Plan, Planner, PlannerFactory, PlanRequest, Stopwatch
    from edc_swarm.planner.registry import make_planner
    from edc_swarm.planner.safe import SafeSteps, airspace_of
else:

    def __getattr__(name: str) -> object:
        """Return a public name from its module."""
        from importlib import import_module  # noqa: PLC0415  (only where a name is used)

        modules = {"SafeSteps": "safe", "airspace_of": "safe", "make_planner": "registry"}
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{modules.get(name, 'interface')}"), name)


__all__ = [
    "Hull",
    "Plan",
    "PlanRequest",
    "Planner",
    "PlannerFactory",
    "SafeSteps",
    "Stopwatch",
    "airspace_of",
    "make_planner",
]
