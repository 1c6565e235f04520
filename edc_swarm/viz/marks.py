"""Marks of UAVs that do not fly, and positions on the map."""

from __future__ import annotations

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity

from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.messages import Fix
from edc_swarm.viz.shapes import FRAME, GREY, Point, disc, entity, line, ring, stamp, text


def on_the_ground(entry: RosterEntry, centre: Point, now_ns: int) -> SceneEntity:
    """Return the mark of a UAV that has landed: where it is, without a disc that anybody keeps clear of."""
    made = entity(entry.uav, now_ns)
    made.cylinders.append(disc(centre, max(entry.body_m, 0.15), GREY, 0.9))
    made.texts.append(text((centre[0], centre[1] + 1.0), f"{entry.uav} landed", GREY))
    return made


def out_of_action(entry: RosterEntry, centre: Point, words: str, label_m: float, now_ns: int) -> SceneEntity:
    """Return the mark of a UAV that does not fly, but has its airspace: a grey, empty disc that is crossed out."""
    made = entity(entry.uav, now_ns)
    made.lines.append(ring(centre, entry.r_m, GREY, 2.0))
    d_m = 0.7 * entry.r_m
    for sign in (1.0, -1.0):
        ends = [(centre[0] - d_m, centre[1] - sign * d_m), (centre[0] + d_m, centre[1] + sign * d_m)]
        made.lines.append(line(ends, GREY, 2.0))
    made.texts.append(text((centre[0], centre[1] + 1.06 * entry.r_m + label_m / 2), words, GREY))
    return made


def location(fix: Fix, now_ns: int) -> bytes:
    """Return the GPS position as bytes. A uniform error in a disc of radius r has the variance r^2 / 4 per axis."""
    variance_m2 = fix.r_m**2 / 4
    return LocationFix(
        timestamp=stamp(now_ns),
        frame_id=FRAME,
        latitude=fix.lat_deg,
        longitude=fix.lon_deg,
        position_covariance=[variance_m2, 0, 0, 0, variance_m2, 0, 0, 0, 0],
        position_covariance_type=LocationFix.DIAGONAL_KNOWN,
    ).SerializeToString(deterministic=True)
