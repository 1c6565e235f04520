"""The shapes of scenes. All lie parallel to the ground, in layers a little above one another."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Iterable, Sequence

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from edc_swarm.mission.clusters import CLUSTER_COLOURS
from edc_swarm.mission.configuration import NS_PER_S

Point = tuple[float, float]
Rgb = tuple[float, float, float]

FRAME = "map"
"""The only coordinate frame, so that viewers need no transforms."""
VERTICES = 24
LABEL_PX = 13
WHITE, RED, AMBER, GREY = (1.0, 1.0, 1.0), (1.0, 0.15, 0.15), (1.0, 0.75, 0.2), (0.6, 0.63, 0.68)
GREEN, CYAN, PURPLE, BLUE = (0.35, 0.8, 0.5), (0.3, 0.82, 0.93), (0.78, 0.6, 0.98), (0.31, 0.6, 0.89)
_UPRIGHT = Quaternion(w=1.0)
_UNIT_RING = [(math.cos(math.tau * i / VERTICES), math.sin(math.tau * i / VERTICES)) for i in range(VERTICES)]


def colour_of(index: int) -> Rgb:
    """Return the colour of a UAV: neighbours in the roster differ much in hue, and none has the red of an overlap."""
    hue = 0.08 + 0.84 * ((index * 0.618034) % 1.0)
    return colorsys.hls_to_rgb(hue, 0.62, 0.75)


def cluster_colour(number: int) -> Rgb:
    """Return the colour of a cluster, by its place among the names of all: that of the report page."""
    red, green, blue = bytes.fromhex(CLUSTER_COLOURS[number % len(CLUSTER_COLOURS)][1:])
    return red / 255, green / 255, blue / 255


def scene(entities: Iterable[SceneEntity], time_ns: int) -> bytes:
    """Return a snapshot that replaces everything on its topic, since a viewer that seeks loads only the last one."""
    gone = SceneEntityDeletion(timestamp=stamp(time_ns), type=SceneEntityDeletion.ALL)
    return SceneUpdate(deletions=[gone], entities=entities).SerializeToString(deterministic=True)


def entity(name: str, time_ns: int) -> SceneEntity:
    """Return an empty entity."""
    return SceneEntity(timestamp=stamp(time_ns), frame_id=FRAME, id=name)


def stamp(time_ns: int) -> Timestamp:
    """Return a protobuf time."""
    return Timestamp(seconds=time_ns // NS_PER_S, nanos=time_ns % NS_PER_S)


def disc(centre: Point, radius_m: float, colour: Rgb, alpha: float, z_m: float = 0.0) -> CylinderPrimitive:
    """Return a filled circle."""
    return CylinderPrimitive(
        pose=_pose(centre, z_m),
        size=Vector3(x=2 * radius_m, y=2 * radius_m, z=0.01),
        bottom_scale=1.0,
        top_scale=1.0,
        color=_colour(colour, alpha),
    )


def ring(centre: Point, radius_m: float, colour: Rgb, thickness_px: float, z_m: float = 0.1) -> LinePrimitive:
    """Return the outline of a circle; its points do not depend on its place, so that they compress well."""
    return LinePrimitive(
        type=LinePrimitive.LINE_LOOP,
        pose=_pose(centre, z_m),
        thickness=thickness_px,
        scale_invariant=True,
        points=[Point3(x=radius_m * x, y=radius_m * y) for x, y in _UNIT_RING],
        color=_colour(colour, 1.0),
    )


def line(
    points: Sequence[Point],
    colour: Rgb,
    thickness_px: float,
    *,
    alphas: Sequence[float] = (),
    alpha: float = 1.0,
    closed: bool = False,
) -> LinePrimitive:
    """Return a line through `points`, with the opacity `alphas` at each of them if given."""
    return LinePrimitive(
        type=LinePrimitive.LINE_LOOP if closed else LinePrimitive.LINE_STRIP,
        pose=_pose((0.0, 0.0), 0.05),
        thickness=thickness_px,
        scale_invariant=True,
        points=[Point3(x=x, y=y) for x, y in points],
        color=_colour(colour, alpha),
        colors=[_colour(colour, each) for each in alphas],
    )


def segments(ends: Sequence[tuple[Point, Point, Rgb]], thickness_px: float, alpha: float) -> LinePrimitive:
    """Return separate lines (from, to, colour)."""
    return LinePrimitive(
        type=LinePrimitive.LINE_LIST,
        pose=_pose((0.0, 0.0), 0.02),
        thickness=thickness_px,
        scale_invariant=True,
        points=[Point3(x=x, y=y) for a, b, _ in ends for x, y in (a, b)],
        colors=[_colour(colour, alpha) for _, _, colour in ends for _ in range(2)],
    )


def arms(centre: Point, heading_rad: float, radius_m: float, colour: Rgb) -> LinePrimitive:
    """Return the arms of a vehicle with four rotors, and its nose; as thick as they are, so only near they show."""
    d_m = radius_m / math.sqrt(2)
    points = [(d_m, d_m), (-d_m, -d_m), (d_m, -d_m), (-d_m, d_m), (0.0, 0.0), (radius_m, 0.0)]
    return LinePrimitive(
        type=LinePrimitive.LINE_LIST,
        pose=Pose(
            position=Vector3(x=centre[0], y=centre[1], z=0.12),
            orientation=Quaternion(z=math.sin(heading_rad / 2), w=math.cos(heading_rad / 2)),
        ),
        thickness=0.14 * radius_m,
        points=[Point3(x=x, y=y) for x, y in points],
        color=_colour(colour, 1.0),
    )


def triangles(corners: Sequence[Point], colour: Rgb, alpha: float) -> TriangleListPrimitive:
    """Return filled triangles, three corners for each."""
    return TriangleListPrimitive(
        pose=_pose((0.0, 0.0), 0.0), points=[Point3(x=x, y=y) for x, y in corners], color=_colour(colour, alpha)
    )


def text(centre: Point, words: str, colour: Rgb) -> TextPrimitive:
    """Return a label that faces the viewer and has the same height at every zoom."""
    return TextPrimitive(
        pose=_pose(centre, 0.2),
        billboard=True,
        font_size=LABEL_PX,
        scale_invariant=True,
        color=_colour(colour, 1.0),
        text=words,
    )


def stadium(a: Point, b: Point, radius_m: float) -> list[Point]:
    """Return the outline of the capsule: all points within `radius_m` of the segment a-b."""
    along = math.atan2(b[1] - a[1], b[0] - a[0])
    half = [math.pi * (i / (VERTICES // 2) - 0.5) for i in range(VERTICES // 2 + 1)]
    ends = [(b, along + angle) for angle in half] + [(a, along + math.pi + angle) for angle in half]
    return [(x + radius_m * math.cos(angle), y + radius_m * math.sin(angle)) for (x, y), angle in ends]


def _pose(centre: Point, z_m: float) -> Pose:
    return Pose(position=Vector3(x=centre[0], y=centre[1], z=z_m), orientation=_UPRIGHT)


def _colour(rgb: Rgb, alpha: float) -> Color:
    return Color(r=rgb[0], g=rgb[1], b=rgb[2], a=alpha)
