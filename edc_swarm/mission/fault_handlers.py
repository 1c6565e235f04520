"""Tables of the functions that carry out faults, by kind of fault; mypy checks each function against its kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from edc_swarm.mission.faults import Fault

F = TypeVar("F", bound=Fault)
On = TypeVar("On")


class FaultHandlers(Generic[On]):
    """Functions that carry out faults on something: a swarm, a machine, real processes."""

    def __init__(self) -> None:
        self._functions: dict[type[Fault], Callable[[On, Any], None]] = {}

    @property
    def kinds(self) -> frozenset[type[Fault]]:
        """The kinds of fault that have a function."""
        return frozenset(self._functions)

    def of(self, kind: type[F]) -> Callable[[Callable[[On, F], None]], Callable[[On, F], None]]:
        """Return a decorator that makes a function the handler of `kind`."""

        def enter(function: Callable[[On, F], None]) -> Callable[[On, F], None]:
            assert kind not in self._functions, f"two handlers of {kind.__name__}"
            self._functions[kind] = function
            return function

        return enter

    def carry_out(self, on: On, fault: Fault) -> None:
        """Carry out `fault` on `on`."""
        self._functions[type(fault)](on, fault)
