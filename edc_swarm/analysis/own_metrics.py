"""Metrics of the user: classes named `package.module:Class`, which measure a recording beside the project's metrics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import msgspec

from edc_swarm.errors import InputError, MissionError
from edc_swarm.mission.plug_ins import called, made
from edc_swarm.recording.model import Recording

MAX_BYTES = 1 << 20


class OwnMetric(Protocol):
    """A metric of the user, made as `Class()`."""

    def measure(self, recording: Recording) -> object:
        """Return numbers, texts, lists and tables of them, or None where the recording lacks what is measured."""


def own_metrics(recording: Recording, names: Sequence[str]) -> dict[str, object]:
    """Return what each metric of the user measures, by its name.

    Raises
    ------
    InputError
        There is no such class, it raises, or what it returns is no data of at most a megabyte.
    """
    found = dict[str, object]()
    for name in names:
        try:
            metric: OwnMetric = made("--metric", name, "measure")
            found[name] = called("--metric", name, lambda metric=metric: metric.measure(recording))  # type: ignore[misc]
            size = len(called("--metric", name, lambda name=name: msgspec.json.encode(found[name])))  # type: ignore[misc]
        except MissionError as error:
            raise InputError(error.field, error.value, error.allowed) from None
        if size > MAX_BYTES:
            raise InputError("--metric", name, f"a class that returns at most {MAX_BYTES} bytes of data, not {size}")
    return found
