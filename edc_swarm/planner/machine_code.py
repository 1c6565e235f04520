"""The library with the guidance's machine code, called without numba.

`edc_swarm.planner.ahead_of_time` makes it. Its functions have numba's calling convention: an address for the answer,
one for an exception, then the arguments, of which an array is seven values or more and a tuple its members. The
library says which arguments each function takes, and from which source files it was made.
"""

from __future__ import annotations

import ctypes
import hashlib
import operator
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

SOURCES = ("guidance_kernel.py", "room_kernel.py", "roundabout_kernel.py")
"""The files whose functions are in the library."""
PREFIX = "edc_"
"""What the names of the library's functions begin with."""
LABEL = "edc_label"
"""Name of the library's text about itself, which ends with a zero."""

Kind = Any
"""Type of a value: float64, int64, bool or none; a dictionary with `item` and `dimensions` of an array, whose items
follow each other in memory; the list of the types of a tuple's members."""

_CONVERSIONS: dict[str, Callable[[Any], Any]] = {"float64": float, "int64": operator.index}


class Described(msgspec.Struct, frozen=True):
    """Types of a function's arguments and of its answer."""

    takes: list[Kind]
    returns: Kind


class Label(msgspec.Struct, frozen=True):
    """What a library says about itself: the digest of `SOURCES`, and its functions by name."""

    sources: str
    functions: dict[str, Described]


def library_path(folder: Path = Path(__file__).parent) -> Path:
    """Return where the library for this kind of processor is, or would be."""
    return folder / f"kernels-{os.uname().machine}.so"


def digest_of_sources() -> str:
    """Return the digest of the files from which the library is made."""
    return hashlib.sha256(b"".join((Path(__file__).parent / name).read_bytes() for name in SOURCES)).hexdigest()


def functions_of_library(path: Path) -> dict[str, Callable[..., Any]]:
    """Return the functions by name: none if there is no such library, or if it was made from other sources."""
    try:
        library = ctypes.PyDLL(str(path))
        text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(library, LABEL)))
        label = msgspec.json.decode(text, type=Label)
    except (OSError, ValueError):  # No library, one without a label, or with one that is not ours.
        return {}
    if label.sources != digest_of_sources():
        return {}
    return {name: _function(library[PREFIX + name], described) for name, described in label.functions.items()}


def _function(entry: Any, described: Described) -> Callable[..., Any]:
    """Return the function at `entry` as one that takes and returns Python's values."""
    takes = [_unfolder(kind) for kind in described.takes]
    answer_type, is_tuple = _c_type(described.returns), isinstance(described.returns, list)
    entry.restype = ctypes.c_int32
    entry.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *(c for kind in described.takes for c in _c_arguments(kind))]

    def call(*args: Any) -> Any:
        passed: list[Any] = []
        for unfold, value in zip(takes, args, strict=True):
            unfold(value, passed)
        answer, trouble = answer_type(), ctypes.c_void_p()
        status = entry(ctypes.byref(answer), ctypes.byref(trouble), *passed)
        assert status == 0, "a compiled function raises nothing"
        return tuple(getattr(answer, name) for name, _ in answer_type._fields_) if is_tuple else answer.value

    return call


def _unfolder(kind: Kind) -> Callable[[Any, list[Any]], None]:
    """Return the function that appends what is passed for a value to a list."""
    if isinstance(kind, str):
        convert = _CONVERSIONS[kind]
        return lambda value, passed: passed.append(convert(value))
    if isinstance(kind, dict):
        from numpy import dtype  # noqa: PLC0415  (only a possible head needs it)

        item, dimensions = dtype(kind["item"]), kind["dimensions"]

        def unfold_array(value: Any, passed: list[Any]) -> None:
            assert value.dtype == item
            assert value.ndim == dimensions
            assert value.flags.c_contiguous
            address = value.__array_interface__["data"][0]
            passed += (None, None, value.size, value.itemsize, address, *value.shape, *value.strides)

        return unfold_array
    members = [_unfolder(member) for member in kind]

    def unfold_tuple(value: Any, passed: list[Any]) -> None:
        for unfold, member in zip(members, value, strict=True):
            unfold(member, passed)

    return unfold_tuple


def _c_arguments(kind: Kind) -> list[Any]:
    """Return the C types of what an unfolder appends."""
    if isinstance(kind, str):
        return [_c_type(kind)]
    if isinstance(kind, dict):
        fixed = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p]
        return fixed + [ctypes.c_int64] * (2 * kind["dimensions"])
    return [c_type for member in kind for c_type in _c_arguments(member)]


def _c_type(kind: Kind) -> Any:
    """Return the C type of an answer, or of a number."""
    if isinstance(kind, list):
        fields = [(f"member_{i}", _c_type(member)) for i, member in enumerate(kind)]
        return type("Answer", (ctypes.Structure,), {"_fields_": fields})
    assert isinstance(kind, str), "no function returns an array"
    return {"float64": ctypes.c_double, "int64": ctypes.c_int64, "bool": ctypes.c_bool, "none": ctypes.c_void_p}[kind]
