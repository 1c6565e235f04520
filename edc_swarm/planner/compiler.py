"""Where the machine code of the guidance comes from: from a library beside this file, else from numba.

The library is made together with a wheel or an image (`edc_swarm.planner.ahead_of_time`). Without it, or after a change
of the functions, numba compiles them (`edc_swarm.planner.just_in_time`). With it numba is never imported.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from edc_swarm.planner.machine_code import functions_of_library, library_path

Function = TypeVar("Function", bound=Callable[..., Any])

_READY: dict[str, Any] = functions_of_library(library_path())


def is_ready() -> bool:
    """Return True if nothing is left to compile."""
    return bool(_READY)


def compiled(function: Function) -> Function:
    """Return a function that Python calls as machine code."""
    if _READY:
        ready: Function = _READY[function.__name__]
        return ready
    from edc_swarm.planner import just_in_time  # noqa: PLC0415  (imports numba)

    return just_in_time.compiled(function)


def inner(function: Function) -> Function:
    """Return a function for calls from compiled functions; called from Python it does the same."""
    if _READY:
        return function
    from edc_swarm.planner import just_in_time  # noqa: PLC0415  (imports numba)

    return just_in_time.inner(function)
