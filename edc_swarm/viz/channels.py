"""The topics of the visualisation with their schemas.

A topic is `swarm/{mission}/viz/NAME` on the bus, and `/viz/NAME` in recordings, so that one layout fits every
mission.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import msgspec
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message as Protobuf
from msgspec import UNSET, Struct, UnsetType

from edc_swarm.protocol.keys import PREFIX, SCENES
from edc_swarm.recording.mcap_file import Channel
from edc_swarm.recording.schemas import json_schema

ROOT = "/viz/"
UAVS, TRAILS, COMMANDS, HULLS, AREA = "uavs", "trails", "commands", "hulls", "area"
LOCATION, LOG, STATUS = "location", "log", "status"


class Status(Struct, frozen=True, kw_only=True):
    """Values for plots, one set per report of a slot; each constant `*_limit_*` is plotted beside its value.

    An unknown value (the plan time in a simulation, the gap of a lone UAV) is absent.
    """

    slot: int
    term: int
    head: str
    status: str
    plan_ms: float | UnsetType = UNSET
    plan_limit_ms: float
    gap_m: float | UnsetType = UNSET
    planned_gap_m: float
    gap_limit_m: float
    heard: int
    unheard: int
    arrived: int
    least_energy_j: float | UnsetType = UNSET


_SCHEMAS: dict[str, type[Protobuf] | type[Struct]] = {
    **dict.fromkeys((UAVS, TRAILS, COMMANDS, HULLS, AREA), SceneUpdate),
    LOCATION: LocationFix,
    LOG: Log,
    STATUS: Status,
}

TOPICS = frozenset(_SCHEMAS)


def topic_of(key: str) -> str | None:
    """Return the topic of the visualisation for a key of the bus, None for all other keys."""
    parts = key.split("/", 3)
    if len(parts) == 4 and parts[0] == PREFIX and parts[2] == SCENES:
        return ROOT + parts[3]
    return None


@cache
def channel_of(topic: str) -> Channel | None:
    """Return a recording's description of a topic of the visualisation, None for an unknown topic."""
    schema = _SCHEMAS.get(topic.removeprefix(ROOT).partition("/")[0])
    if schema is None or not topic.startswith(ROOT):
        return None
    if issubclass(schema, Struct):
        data = msgspec.json.encode(json_schema(schema))
        return Channel(topic, "json", f"edc_swarm.{schema.__name__}", "jsonschema", data)
    return Channel(topic, "protobuf", schema.DESCRIPTOR.full_name, "protobuf", _descriptors(schema))


def _descriptors(schema: type[Protobuf]) -> bytes:
    """Return the schema and its dependencies as a FileDescriptorSet."""
    files: dict[str, Any] = {}
    _collect(schema.DESCRIPTOR.file, files)
    whole = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(whole.file.add())
    return whole.SerializeToString(deterministic=True)


def _collect(file: Any, files: dict[str, Any]) -> None:
    """Add the dependencies of a file to `files`, then the file (protobuf has no common type for file descriptors)."""
    for needed in file.dependencies:
        _collect(needed, files)
    files.setdefault(file.name, file)
