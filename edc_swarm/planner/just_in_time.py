"""Compilation of the guidance: which functions become machine code of their own, and where the code is kept.

Numba turns every function into a library of its own, optimises it with all that it calls, and emits machine code with
a wrapper for calls from Python. But all functions except a few are called by compiled code alone, into which they are
linked. `inner` functions are only translated; `compiled` ones are optimised and emitted with all that is linked into
them. That takes a third off the first start. No optimisation changes a result, since there is no fast-math.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from numba import njit
from numba._dynfunc import make_function
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering

from edc_swarm.planner.machine_code import digest_of_sources

OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
"""No reference counting, which took a third of the time, since no function makes an array. Divisions follow IEEE 754,
so no check for zero slows the loops down; no loop divides by zero."""

SOURCES_DIGEST = digest_of_sources()
"""Digest of all sources that are compiled, taken once for all functions."""

Function = TypeVar("Function", bound=Callable[..., Any])

_DiskCache: Any = FunctionCache
_Library: Any = JITCodeLibrary
_Compiler: Any = CompilerBase
_Lowering: Any = NativeLowering
_Passes: Any = DefaultPassBuilder
_register: Any = register_pass
"""Numba's classes, which have no types."""


class _Cache(_DiskCache):  # type: ignore[misc]
    """Numba's cache on disk; a failure of it, such as a full disk or a torn file, only costs time.

    Numba compiles again what is in a changed file, but a function may have `inner` ones of another file linked into it.
    So code is kept for all sources as they are together.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file._source_stamp = (self._cache_file._source_stamp, SOURCES_DIGEST)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a compiled function; return None if there is none, or if its file cannot be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001  (unpickling a torn file may raise anything)
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled function, if possible."""
        with suppress(OSError):
            super().save_overload(sig, data)


class _LinkedLibrary(_Library):  # type: ignore[misc]
    """A library that is linked into others and never executed."""

    def _optimize_final_module(self) -> None:
        """Leave it to the callers, which optimise what they link."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


@_register(mutates_CFG=True, analysis_only=False)
class _LinkedLowering(_Lowering):  # type: ignore[misc]
    """Numba's last pass for a function that only compiled code calls: no wrapper, no machine code."""

    _name = "linked_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower the function into a library, and register that for its callers."""
        state.library = _LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        flags = state.flags
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        super().run_pass(state)
        lowered = state.cr

        name = lowered.fndesc.qualname.rpartition(".")[2]
        # Numba knows a compiled function by an object of this type; nobody calls this one, which has no address.
        known_by = make_function(lowered.fndesc.lookup_module(), name, "", 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(known_by, lowered.fndesc, [state.library])
        state.cr = lowered._replace(cfunc=known_by)
        return True


class _LinkedCompiler(_Compiler):  # type: ignore[misc]
    """Numba's compiler with that last pass."""

    def define_pipelines(self) -> list[Any]:
        """Return the usual passes with the last one replaced."""
        passes = _Passes.define_nopython_pipeline(self.state)
        passes.passes = [
            (_LinkedLowering, said) if kind is NativeLowering else (kind, said) for kind, said in passes.passes
        ]
        passes._finalized = False
        passes.finalize()
        return [passes]


class _Inner:
    """A function that is linked into its callers; Python's calls compile it once more, with a wrapper."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        self._dispatcher: Any = njit(pipeline_class=_LinkedCompiler, **OPTIONS)(function)
        self._numba_type_ = self._dispatcher._numba_type_
        self._whole: Callable[..., Any] | None = None

    def __call__(self, *args: Any) -> Any:
        """Call the function from Python, as tests do."""
        self._whole = self._whole or compiled(self.py_func)
        return self._whole(*args)


def compiled(function: Function) -> Function:
    """Compile a function that Python calls. Its code is kept on disk, or in memory if no folder can be written."""
    dispatcher: Any = njit(**OPTIONS)(function)
    with suppress(RuntimeError):  # No folder can be written.
        dispatcher._cache = _Cache(function)
    compiled_function: Function = dispatcher
    return compiled_function


def is_kept(function: Callable[..., Any]) -> bool:
    """Return True if the code of a `compiled` function is kept on disk."""
    dispatcher: Any = function
    return isinstance(dispatcher._cache, _Cache)


def inner(function: Function) -> Function:
    """Compile a function for calls from compiled functions, which keep its code."""
    linked: Any = _Inner(function)
    inner_function: Function = linked
    return inner_function
