"""Plug-ins of a mission: classes of the user, named `package.module:Class`, in place of a part of this project.

A mission only names them; a class is imported where its part is first made. An error of a plug-in ends the run with one
line, since an experiment without one of its parts is another experiment; a planner alone is guarded in flight
(`planner.guarded`).
"""

from __future__ import annotations

import importlib
import math
import re
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission

CRITERIA = ("energy", "response-time")
"""Criteria of the election that are built in."""
GPS_MODELS = ("none", "bias", "white", "gauss-markov")
"""Models of the GPS error that are built in."""
_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")
T = TypeVar("T")


def check_names(mission: Mission) -> None:
    """Raise `MissionError` unless each part is built in or has the name of a class; nothing is imported."""
    parts = [("elect", mission.elect, CRITERIA), ("gps_model", mission.gps_model, GPS_MODELS)]
    parts += [(f"link[{index}].model", link.model, ("",)) for index, link in enumerate(mission.link)]
    for field, name, built_in in parts:
        if name not in built_in and not _NAME.fullmatch(name):
            raise MissionError(field, name, _allowed(built_in))


def plug_ins_of(mission: Mission) -> list[str]:
    """Return the names of the classes that are not built in, the planner not included, each once."""
    named = [mission.elect, mission.gps_model, *(link.model for link in mission.link)]
    return list(dict.fromkeys(name for name in named if ":" in name))


def made(field: str, name: str, method: str, *arguments: object) -> Any:
    """Return an object of the class `name`, made of `arguments`; it has the method that its part needs.

    Raises
    ------
    MissionError
        About `field`: there is no such class, it cannot be made, or it lacks the method.
    """
    if not _NAME.fullmatch(name):
        raise MissionError(field, name, _allowed(()))
    module, _, attribute = name.partition(":")
    factory = called(field, name, lambda: getattr(importlib.import_module(module), attribute))
    found = called(field, name, lambda: factory(*arguments))
    if not callable(getattr(found, method, None)):
        raise MissionError(field, name, f"a class with the method {method}")
    return found


def called(field: str, name: str, function: Callable[[], T]) -> T:
    """Return what a call into the plug-in `name` returns.

    Raises
    ------
    MissionError
        The call raised anything; the error has its type, its text and the line of the plug-in's file.
    """
    try:
        return function()
    except Exception as error:  # noqa: BLE001  (user code may raise anything)
        frames = traceback.extract_tb(error.__traceback__)
        ours = {__file__, importlib.__file__}
        theirs = [f for f in frames if f.filename not in ours and not f.filename.startswith("<frozen")]
        own = [f"{Path(f.filename).name}, line {f.lineno}" for f in theirs][-1:]
        why = f"{type(error).__name__}: {error}"[:300].replace("\n", " ")
        raise MissionError(
            field, name, f"a class that can be imported, made and called ({', '.join([why, *own])})"
        ) from None


def number(field: str, name: str, value: object) -> float:
    """Return a number that a plug-in returned; raise `MissionError` for anything else."""
    if isinstance(value, (int, float)) and math.isfinite(value):
        return float(value)
    raise MissionError(field, name, f"a class that returns finite numbers, not {value!r:.60}")


def _allowed(built_in: Sequence[str]) -> str:
    known = [name for name in built_in if name]
    return f"one of {', '.join(known)}, or package.module:Class" if known else "package.module:Class"
