"""The settings of the recorder, for whoever starts one: they load no numpy."""

from __future__ import annotations

from msgspec import Struct

from edc_swarm.mission.roles import RECORDER


class RecorderSettings(Struct, frozen=True, kw_only=True):
    """Settings of the recorder. `parent` is 0 for a recorder that outlives the process that started it.

    `uavs`: whose messages it records, with those of the operator and of recorders; of everybody, if there are none.
    `certified`: the name in its certificate on a secured bus.
    """

    endpoint: str
    mission: str
    part: str
    out: str
    run: dict[str, str]
    certs: str = ""
    certified: str = RECORDER
    parent: int = 0
    clock_ahead_ns: int | None = None
    uavs: list[str] = []
