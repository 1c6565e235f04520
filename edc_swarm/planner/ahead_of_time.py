"""Machine code of the guidance, made before anything flies: what `edc_swarm.planner.machine_code` loads.

`object_code` first rehearses planning in plain Python and notes with which types the functions are called, then lets
numba compile them for any processor of this kind. It needs a process of its own, which has not imported the guidance.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core.compiler import Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import compiler, just_in_time
from edc_swarm.planner.machine_code import LABEL, PREFIX, SOURCES, Described, Kind, Label, digest_of_sources
from edc_swarm.planner.registry import warm_up

PROCESSOR = "generic"
"""LLVM's name of the processor: every one of this machine's kind has what this one has."""
MODULES = tuple(f"edc_swarm.planner.{name.removesuffix('.py')}" for name in SOURCES)
SYMBOLS = f"{{ global: {PREFIX}*; local: *; }};"
"""The linker's version script: all else in the library stays in it."""

_numba: Any = types
_types_of: Any = typeof
_Flags: Any = Flags
_compile: Any = compile_extra
_lock: Any = global_compiler_lock
_target: Any = cpu_target
_ir: Any = ir
"""Numba and llvmlite, which have no types."""


def object_code(mission: Mission) -> bytes:
    """Return an object file with all compiled functions, as a mission with zones calls them, and the label."""
    assert not any(name in sys.modules for name in MODULES), "a process of its own"
    called = _rehearsed(mission)
    modules = _imported(just_in_time.inner, just_in_time.inner)
    functions = {name: vars(module)[name].py_func for module in modules for name in called.keys() & vars(module).keys()}
    context = _target.target_context.with_aot_codegen("kernels", cpu_name=PROCESSOR)
    with _lock:
        library = context.codegen().create_library("kernels")
        described = {
            name: _compiled(context, library, functions[name], [_renewed(kind, modules) for kind in kinds])
            for name, kinds in called.items()
        }
        label = msgspec.json.encode(Label(digest_of_sources(), described)) + b"\0"
        module = library.create_ir_module("label")
        text = _ir.Constant(_ir.ArrayType(_ir.IntType(8), len(label)), bytearray(label))
        _ir.GlobalVariable(module, text.type, LABEL).initializer = text
        library.add_ir_module(module)
        code: bytes = library.emit_native_object()
    return code


def _imported(outer: Callable[..., Any], linked: Callable[..., Any]) -> list[ModuleType]:
    """Import the functions anew, with these decorators."""
    for name in MODULES:
        sys.modules.pop(name, None)
    kept = compiler.compiled, compiler.inner
    compiler.compiled, compiler.inner = outer, linked
    try:
        return [import_module(name) for name in MODULES]
    finally:
        compiler.compiled, compiler.inner = kept


def _rehearsed(mission: Mission) -> dict[str, list[Any]]:
    """Plan in plain Python; return the numba types of the arguments of each function that Python calls."""
    called: dict[str, list[Any]] = {}
    awaited = set()

    def noted(function: Callable[..., Any]) -> Callable[..., Any]:
        awaited.add(function.__name__)

        def call(*args: Any) -> Any:
            kinds = [_types_of(value) for value in args]
            assert called.setdefault(function.__name__, kinds) == kinds, "one signature for each function"
            return function(*args)

        return call

    _imported(noted, lambda function: function)
    with np.errstate(all="ignore"):
        warm_up(mission)
    assert awaited == called.keys(), "the rehearsal calls every function"
    return called


def _renewed(kind: Any, modules: list[ModuleType]) -> Any:
    """Return the type of a tuple with the class of the newly imported module; other types as they are."""
    if not isinstance(kind, _numba.NamedTuple):
        return kind
    members = [_renewed(member, modules) for member in kind.types]
    return _numba.NamedTuple(members, getattr(modules[0], kind.instance_class.__name__))


def _compiled(context: Any, library: Any, function: Callable[..., Any], takes: list[Any]) -> Described:
    """Compile a function into the library, and return its types."""
    flags = _Flags()
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    flags.error_model, flags.nrt = just_in_time.OPTIONS["error_model"], just_in_time.OPTIONS["_nrt"]
    made = _compile(_target.typing_context, context, function, tuple(takes), None, flags, locals={}, library=library)
    library.get_function(made.fndesc.llvm_func_name).name = PREFIX + function.__name__
    return Described([_kind(taken) for taken in takes], _kind(made.signature.return_type))


def _kind(numba_type: Any) -> Kind:
    """Return the kind of a numba type."""
    if isinstance(numba_type, _numba.Array):
        assert numba_type.layout == "C"
        return {"item": str(numba_type.dtype), "dimensions": numba_type.ndim}
    if isinstance(numba_type, _numba.BaseTuple):
        return [_kind(member) for member in numba_type]
    return str(numba_type)
