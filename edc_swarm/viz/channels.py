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
GOALS, LABELS, LINKS, VEHICLES = "goals", "labels", "links", "vehicles"
SCENES_OF_A_MISSION = (AREA, GOALS, TRAILS, LINKS, HULLS, COMMANDS, UAVS, VEHICLES, LABELS)
"""Layers of the scene, the lowest first; a viewer switches each on and off."""
LOCATION, LOG, STATUS, STORY = "location", "log", "status", "story"


class Status(Struct, frozen=True, kw_only=True):
    """Values for plots, one set per report of a slot.

    Of several clusters, `slot` and `status` are those of the report. The others are those of the newest reports of all:
    heads and terms in the order of the clusters, the longest plan, the least gap, all that are heard and unheard.

    An unknown value (the plan time in a simulation, the gap where no two UAVs are near) is absent. `plan_limit_near_ms`
    is the limit of the plan time, in slots in which the plan takes a large share of it: a plot of both stays readable.
    The batteries are those of all UAVs heard of, in per cent of the first charge. `oldest_fix_slots` is the age of the
    oldest fix that the head has of a UAV that is not out of action.
    """

    slot: int
    term: str
    head: str
    status: str
    plan_ms: float | UnsetType = UNSET
    plan_limit_ms: float
    plan_limit_near_ms: float | UnsetType = UNSET
    gap_m: float | UnsetType = UNSET
    planned_gap_m: float | UnsetType = UNSET
    gap_limit_m: float
    heard: int
    unheard: int
    arrived: int
    least_energy_j: float | UnsetType = UNSET
    least_battery_pct: float | UnsetType = UNSET
    mean_battery_pct: float | UnsetType = UNSET
    oldest_fix_slots: int | UnsetType = UNSET


class Told(Struct, frozen=True, kw_only=True):
    """A happening of the story, for the rows of a timeline."""

    slot: int
    kind: str
    level: str
    words: str


_SCHEMAS: dict[str, type[Protobuf] | type[Struct]] = {
    **dict.fromkeys(SCENES_OF_A_MISSION, SceneUpdate),
    LOCATION: LocationFix,
    LOG: Log,
    STATUS: Status,
    STORY: Told,
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
