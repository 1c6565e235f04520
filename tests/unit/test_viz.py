"""The scenes for viewers agree with the messages, in the form that viewers accept."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from typing import Any

import msgspec
import pytest
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec import UNSET

from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.mission.polygons import polygon_fault
from edc_swarm.mission.routes import Course
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.viz.channels import SCENES_OF_A_MISSION, Status, Told, channel_of, topic_of
from edc_swarm.viz.gaps import gaps
from edc_swarm.viz.layers import MANY_UAVS
from edc_swarm.viz.layout import BUSY, MAP_PX, TILE_MPP, layout
from edc_swarm.viz.scenery import CLUSTER_RING, Scenery, Shown, extent_m
from edc_swarm.viz.shapes import AMBER, BLUE, GREEN, RED, VERTICES, cluster_colour, colour_of, stadium
from edc_swarm.viz.zones import triangulated
from tests.unit.synthetic import EPOCH_NS, OFFSET_M, SLOT_NS, at, change, flight, mission_of, parallel


def shown(messages: list[Message], until_ns: int | None = None) -> list[Shown]:
    """Return all that is shown of a mission up to a time."""
    scenery, said = Scenery(), []
    for message in sorted(messages, key=lambda message: message.sent_ns):
        if until_ns is not None and message.sent_ns > until_ns:
            break
        said += scenery.advance(message.sent_ns)
        scenery.hear(message, message.sent_ns)
    return said + (scenery.advance(until_ns) if until_ns is not None else [])


def scene(messages: list[Message], name: str, slot: float) -> dict[str, Any]:
    """Return the entities of the last scene on a topic, by id, at a time in slots."""
    said = [each for each in shown(messages, EPOCH_NS + round(slot * SLOT_NS)) if each.topic == f"/viz/{name}"]
    return {entity.id: entity for entity in SceneUpdate.FromString(said[-1].payload).entities}


@pytest.fixture
def messages() -> list[Message]:
    """Return a mission, published at its epoch, of three UAVs that fly north side by side, with head u0."""
    said = flight(parallel())
    return [msgspec.structs.replace(said[0], sent_ns=EPOCH_NS), *[m for m in said[1:] if m.sent_ns]]


def test_the_same_messages_give_the_same_bytes(messages: list[Message]) -> None:
    """Scenes depend only on the messages and the given times."""
    assert shown(messages) == shown(messages)


def test_what_comes_late_takes_nothing_back(messages: list[Message]) -> None:
    """Fetched messages stand late in a record, and newer ones stay visible."""
    messages = [msgspec.structs.replace(m, speed_mps=1.0) if isinstance(m, Command) else m for m in messages]
    late = [m for m in messages if isinstance(m, Fix | Truth | Command | Report) and m.slot == 2]
    assert {type(message) for message in late} == {Fix, Truth, Command, Report}
    until_ns, scenes = EPOCH_NS + round(4.9 * SLOT_NS), []
    for more in ([], late):
        scenery = Scenery()
        for message in [m for m in messages if m.sent_ns <= until_ns] + more:
            scenery.hear(message, message.sent_ns)
        scenery.advance(until_ns)
        scenes.append(scenery.advance(until_ns + SLOT_NS))
    assert scenes[0] == scenes[1] != []


def test_each_topic_has_its_rate(messages: list[Message]) -> None:
    """Discs have two scenes per second, trails and the map one, static objects one per minute."""
    scenery = Scenery()
    assert scenery.next_ns is None
    for message in messages[:7]:
        scenery.hear(message, EPOCH_NS)
    assert scenery.next_ns == EPOCH_NS
    said = [each for tick in range(122) for each in scenery.advance(EPOCH_NS + tick * SLOT_NS)]
    counts = Counter(each.topic.removeprefix("/viz/") for each in said)
    assert {name: counts[name] for name in ("uavs", "labels", "trails", "goals", "location/u1", "area")} == {
        "uavs": 122,
        "labels": 122,
        "trails": 61,
        "goals": 61,
        "location/u1": 61,
        "area": 2,
    }


def test_the_time_of_a_long_silence_is_not_shown(messages: list[Message]) -> None:
    """After a long silence there is one scene, not hundreds of the time between."""
    scenery = Scenery()
    scenery.hear(messages[0], EPOCH_NS)
    scenery.advance(EPOCH_NS)
    for silence_ns, pictures in ((60 * NS_PER_S, 120), (61 * NS_PER_S, 1)):
        begun_ns = scenery.next_ns
        assert begun_ns is not None
        said = scenery.advance(begun_ns + silence_ns - 1)
        assert sum(each.topic == "/viz/uavs" for each in said) == pictures


def test_a_uav_without_memory_is_shown_where_its_disc_is(messages: list[Message]) -> None:
    """The fix of a UAV without memory does not move its disc."""
    change(messages, {"uav": "u1", "slot": 4}, Fix, voter=False, executing=False, waypoint_x_m=90.0)
    assert scene(messages, "uavs", 4.9)["u1"].cylinders[0].pose.position.x == 12.0


def test_every_scene_is_a_full_snapshot(messages: list[Message]) -> None:
    """A viewer that seeks loads only the last message, so each scene replaces all earlier ones."""
    channels = [(each, channel_of(each.topic)) for each in shown(messages)]
    scenes = [each for each, channel in channels if channel and channel.schema_name == "foxglove.SceneUpdate"]
    assert {each.topic for each in scenes} == {f"/viz/{name}" for name in SCENES_OF_A_MISSION}
    for each in scenes:
        update = SceneUpdate.FromString(each.payload)
        assert [deletion.type for deletion in update.deletions] == [1]
        assert all(entity.frame_id == "map" for entity in update.entities)


def test_discs_are_where_the_fixes_say(messages: list[Message]) -> None:
    """At a tick in mid-slot a disc is half-way along its executed step, the body at its offset in it."""
    change(messages, {"slot": 4}, Fix, waypoint_y_m=8.0, from_y_m=6.0)
    change(messages, {"slot": 4}, Truth, to_x_m=14.5)
    messages[0] = msgspec.structs.replace(messages[0], sent_ns=EPOCH_NS + SLOT_NS // 2)
    drawn = scene(messages, "uavs", 4.5)["u1"]
    (disc,), (outline, *_) = drawn.cylinders, drawn.lines
    body, *rotors = scene(messages, "vehicles", 4.5)["u1"].cylinders
    assert [math.hypot(p.x, p.y) for p in outline.points] == pytest.approx([5.0] * len(outline.points))
    assert outline.type == LinePrimitive.LINE_LOOP
    assert (outline.color.r, outline.color.g, outline.color.b) == pytest.approx(BLUE)
    assert (disc.pose.position.x, disc.pose.position.y, disc.size.x) == (12.0, 7.0, 10.0)
    where = 13.5, 7.0 + OFFSET_M[1]
    assert (body.pose.position.x, body.pose.position.y) == pytest.approx(where)
    for rotor in rotors:
        from_body_m = math.dist((rotor.pose.position.x, rotor.pose.position.y), where)
        assert from_body_m + rotor.size.x / 2 == pytest.approx(body.size.x / 2)
    assert len(rotors) == 4


def test_the_head_is_marked_and_standbys_are_numbered(messages: list[Message]) -> None:
    """The head has a second ring and an H inside the disc, where no label of another UAV is."""
    change(messages, {}, Report, standby=["u2", "u1"])
    entities = scene(messages, "uavs", 3)
    assert {name: [each.text for each in entity.texts] for name, entity in entities.items()} == {
        "u0": ["H"],
        "u1": ["s2"],
        "u2": ["s1"],
    }
    assert len(entities["u0"].lines) == len(entities["u1"].lines) + 1
    disc, role = entities["u0"].cylinders[0], entities["u0"].texts[0].pose.position
    assert math.dist((role.x, role.y), (disc.pose.position.x, disc.pose.position.y)) < disc.size.x / 4


def test_each_cluster_has_its_colour_and_its_head(messages: list[Message]) -> None:
    """A ring inside each disc has the colour of the cluster; each cluster has a head, standbys and links of its own."""
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    plain = scene(messages, "uavs", 3)
    names = {"u0": "a", "u1": "b", "u2": "b"}
    roster = [msgspec.structs.replace(entry, cluster=names[entry.uav]) for entry in mission.roster]
    messages[0] = msgspec.structs.replace(mission, roster=roster, clusters=2)
    reports = [message for message in messages if isinstance(message, Report)]
    for report in reports:
        messages.remove(report)
        for head, mates, term in (("u0", ["u0"], 2), ("u1", ["u1", "u2"], 1)):
            fields = {"head": head, "heard": mates, "grants": mates, "unheard": [], "term": term}
            fields |= {"plan_ms": 10.0 * term, "min_gap_m": float(term)}
            messages.append(msgspec.structs.replace(report, **fields, quorum=len(mates), standby=mates[1:]))
    entities = scene(messages, "uavs", 3)
    inner = {
        name: [line.color for line in entity.lines if line.points[0].x == pytest.approx(CLUSTER_RING * 5.0)]
        for name, entity in entities.items()
    }
    for name, number in (("u0", 0), ("u1", 1), ("u2", 1)):
        assert [(colour.r, colour.g, colour.b) for colour in inner[name]] == [pytest.approx(cluster_colour(number))]
    assert [len(entity.lines) for entity in plain.values()] == [2, 1, 1], "one cluster needs no colour"
    assert {name: [each.text for each in entity.texts] for name, entity in entities.items()} == {
        "u0": ["H"],
        "u1": ["H"],
        "u2": ["s1"],
    }
    assert [(line.points[0].x, line.points[1].x) for line in scene(messages, "links", 3)["links"].lines] == [
        (12.0, 24.0)
    ]
    said = [each.payload for each in shown(messages) if each.topic == "/viz/status"]
    statuses = [msgspec.json.decode(payload, type=Status) for payload in said]
    told = statuses[-1]
    assert (told.head, told.term, told.heard) == ("u0, u1", "2, 1", 3), "a row of the timeline says all heads"
    assert (told.plan_ms, told.planned_gap_m) == (20.0, 1.0), "the longest plan and the least gap"
    assert {each.oldest_fix_slots for each in statuses} == {0}, "a report of one slot later makes no fix of others old"


def test_labels_are_legible_at_every_zoom_and_clear_their_disc(messages: list[Message]) -> None:
    """Their height is in pixels; with the whole area in a view of 600 pixels they stand above the disc."""
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    (left_m, low_m), (right_m, high_m) = extent_m(mission)
    pixel_m = max(right_m - left_m, high_m - low_m) / 600
    (label,), (disc,) = scene(messages, "labels", 3)["u1"].texts, scene(messages, "uavs", 3)["u1"].cylinders
    assert label.text == "u1"
    assert label.scale_invariant
    assert label.billboard
    assert label.pose.position.y - label.font_size * pixel_m / 2 > disc.pose.position.y + disc.size.y / 2


def test_overlapping_discs_are_red(messages: list[Message]) -> None:
    """Only overlapping discs are red."""
    change(messages, {"uav": "u1", "slot": 3}, Fix, waypoint_x_m=5.0, from_x_m=5.0)
    colours = {n: (e.cylinders[0].color.r, e.cylinders[0].color.g) for n, e in scene(messages, "uavs", 4).items()}
    assert colours["u0"] == colours["u1"] == RED[:2]
    assert colours["u2"] == colour_of(2)[:2]


def test_hulls_of_the_unheard_are_outlined_with_their_radius(messages: list[Message]) -> None:
    """Every vertex is at the hull's radius plus the GPS error from the segment."""
    hull = {"hull_ax_m": [0.0], "hull_ay_m": [0.0], "hull_bx_m": [4.0], "hull_by_m": [0.0], "hull_r_m": [2.5]}
    change(messages, {"slot": 3}, Report, hull_uav=["u2"], unheard=["u2"], **hull)
    (outline,) = scene(messages, "hulls", 4)["u2"].lines
    for point in outline.points:
        beyond_m = max(0.0, -point.x, point.x - 4.0)
        assert math.hypot(beyond_m, point.y) == pytest.approx(7.5)
    assert scene(messages, "hulls", 3) == {}


def test_an_outline_goes_once_round_its_segment() -> None:
    """The outline of a segment in any direction reaches its radius beyond both ends and on both sides, in order."""
    points = stadium((1.0, 2.0), (4.0, 6.0), 2.5)
    along = [((x - 1) * 3 + (y - 2) * 4) / 5 for x, y in points]
    across = [((y - 2) * 3 - (x - 1) * 4) / 5 for x, y in points]
    assert [max(along), min(along), max(across), min(across)] == pytest.approx([7.5, -2.5, 2.5, -2.5])
    pairs = zip(points, [*points[1:], points[0]], strict=True)
    area_m2 = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairs) / 2
    assert area_m2 == pytest.approx(5 * 5 + 2.5**2 * VERTICES / 2 * math.sin(2 * math.pi / VERTICES))


def test_trails_fade_and_commands_are_drawn(messages: list[Message]) -> None:
    """A trail has one colour per point, opaque at its new end; a command is its step."""
    (trail,) = scene(messages, "trails", 6)["u1"].lines
    alphas = [colour.a for colour in trail.colors]
    assert len(trail.points) == len(alphas) > 2
    assert trail.type == LinePrimitive.LINE_STRIP
    assert alphas == pytest.approx([0.8 * (1 - age_s / 15) for age_s in (3, 2, 1, 0)])
    change(messages, {}, Command, speed_mps=4.0)
    (step,) = scene(messages, "commands", 3)["u1"].lines
    assert [(p.x, p.y) for p in step.points] == [at(parallel()[1], 2), at(parallel()[1], 3)]
    assert scene(messages, "commands", 10) == {}


def test_the_same_status_at_the_same_instant_is_shown_once(messages: list[Message]) -> None:
    """Two reports that change nothing between them, as of two clusters, leave no message twice in the recording."""
    reports = [message for message in messages if isinstance(message, Report)]
    statuses = [
        [each for each in shown(all_of) if each.topic == "/viz/status"] for all_of in (messages, messages + reports)
    ]
    assert statuses[0]
    assert statuses[1] == statuses[0]


def test_the_status_is_that_of_the_last_plan(messages: list[Message]) -> None:
    """The status has the values of the last plan and of all fixes."""
    kept = [m for m in messages if not (isinstance(m, Fix) and m.uav == "u2")]
    said = [each for each in shown(kept, EPOCH_NS + 9 * SLOT_NS) if each.topic == "/viz/status"]
    status = msgspec.json.decode(said[-1].payload, type=Status)
    assert (status.plan_limit_ms, status.gap_m) == (pytest.approx(300.0), pytest.approx(2.0, abs=0.1))
    assert status == Status(
        slot=8,
        term="1",
        head="u0",
        status="planned",
        plan_ms=10.0,
        plan_limit_ms=status.plan_limit_ms,
        gap_m=status.gap_m,
        gap_limit_m=0.0,
        heard=3,
        unheard=0,
        arrived=2,
        least_energy_j=5e4 - 560,
        least_battery_pct=status.least_battery_pct,
        mean_battery_pct=status.mean_battery_pct,
        oldest_fix_slots=0,
    )
    assert status.least_battery_pct == pytest.approx(100 * (5e4 - 560) / 5e4)


def test_plan_times_of_a_simulation_come_from_beside_it(messages: list[Message]) -> None:
    """The limit is a line only where a plan comes near it, since it would flatten all others."""
    change(messages, {}, Report, plan_ms=0.0)
    scenery = Scenery({3: 12.5, 5: 150.0})
    said: list[Shown] = []
    for message in sorted(messages, key=lambda message: message.sent_ns):
        said += scenery.advance(message.sent_ns)
        scenery.hear(message, message.sent_ns)
    found = [msgspec.json.decode(each.payload, type=Status) for each in said if each.topic == "/viz/status"]
    timed = {each.slot: (each.plan_ms, each.plan_limit_near_ms) for each in found if each.plan_ms is not UNSET}
    assert timed == {3: (12.5, UNSET), 5: (150.0, pytest.approx(300.0))}


def test_what_nobody_measured_is_absent_from_the_status(messages: list[Message]) -> None:
    """A simulated report has a plan time of 0 ms, which the plot must leave out."""
    change(messages, {}, Report, plan_ms=0.0)
    said = [each for each in shown(messages, EPOCH_NS + 9 * SLOT_NS) if each.topic == "/viz/status"]
    assert said
    assert all("plan_ms" not in msgspec.json.decode(each.payload) for each in said)


def test_targets_are_marked(messages: list[Message]) -> None:
    """Each target has a ring, and a line that leads there; a later goal moves both within a second."""
    change(messages, {"uav": "u1"}, Fix, course=Course(goal=1, route=[(1.0, 2.0), (3.0, 4.0)]))
    drawn = scene(messages, "goals", 3)
    places = {name: each.lines[1].pose.position for name, each in drawn.items()}
    assert {name: (at.x, at.y) for name, at in places.items()} == {
        "u0": (0.0, 16.0),
        "u1": (3.0, 4.0),
        "u2": (24.0, 16.0),
    }
    assert [(p.x, p.y) for p in drawn["u1"].lines[0].points][1:] == [(1.0, 2.0), (3.0, 4.0)]


def test_links_have_the_colour_of_the_age_of_the_fix(messages: list[Message]) -> None:
    """Green in the slot itself, amber when older, red from five slots on; a UAV that no head has heard has none."""
    for slot in range(2, 9):
        change(messages, {"slot": slot}, Report, heard=["u0", "u1"])
    colours = []
    for time in (2.0, 3.9, 8.9):
        (drawn,) = scene(messages, "links", time)["links"].lines
        colours.append([(each.r, each.g, each.b) for each in drawn.colors[::2]])
        assert (drawn.points[0].x, drawn.points[2].x) == (0.0, 0.0)
    assert colours == [[pytest.approx(GREEN), pytest.approx(old)] for old in (GREEN, AMBER, RED)]
    change(messages, {}, Report, heard=["u0", "u1"])
    assert len(scene(messages, "links", 8)["links"].lines[0].points) == 2


def test_a_uav_that_holds_is_outlined_in_its_colour_and_says_why(messages: list[Message]) -> None:
    """Its disc keeps its own colour, by which its trail and its goal are known."""
    messages = [m for m in messages if not (isinstance(m, Command) and m.uav == "u1" and m.slot >= 3)]
    change(messages, {"uav": "u1"}, Fix, waypoint_y_m=4.0, from_y_m=4.0, executing=False)
    drawn, label = scene(messages, "uavs", 7)["u1"], scene(messages, "labels", 7)["u1"].texts[0]
    outline, fill = drawn.lines[0].color, drawn.cylinders[0].color
    assert (outline.r, outline.g, outline.b) == pytest.approx(AMBER)
    assert (fill.r, fill.g, fill.b) == pytest.approx(colour_of(1))
    assert label.text.startswith("u1: ")


def test_the_area_holds_all_starts_and_targets() -> None:
    """Missions from a file may lie anywhere."""
    mission = mission_of([[(-30.0, 4.0), (500.0, 4.0)]], area_m2=100.0, sent_ns=EPOCH_NS)
    frame = scene([mission], "area", 1)["frame"].lines[0]
    assert {p.x for p in frame.points} == {-30.0, 500.0}
    assert frame.type == LinePrimitive.LINE_LOOP


def test_zones_are_drawn_once_a_minute_with_their_names(messages: list[Message]) -> None:
    """A fence is an outline and replaces the frame; an exclusion zone is filled, and a concave one with its area."""
    fence = Zone(name="fence", kind="inclusion", polygon=[(-20, -20), (60, -20), (60, 60), (-20, 60)])
    corner = Zone(name="corner", kind="exclusion", polygon=[(40, 40), (40, 50), (45, 50), (45, 45), (50, 45), (50, 40)])
    tower = Zone(name="tower", kind="exclusion", centre=[40, 0], radius_m=7)
    ring = Zone(name="ring", kind="inclusion", centre=[20, 20], radius_m=70)
    mission = msgspec.structs.replace(messages[0], zone=[fence, corner, tower, ring])
    said = [mission, *messages[1:]]
    drawn = scene(said, "area", 8)
    assert drawn.keys() == {"zone fence", "zone corner", "zone tower", "zone ring"}
    outline = drawn["zone fence"].lines[0]
    assert [(p.x, p.y) for p in outline.points] == fence.polygon
    assert outline.type == LinePrimitive.LINE_LOOP
    assert not drawn["zone fence"].triangles
    assert not drawn["zone ring"].cylinders
    points = drawn["zone corner"].triangles[0].points
    assert area_m2([(p.x, p.y) for p in points]) == pytest.approx(75)
    disc = drawn["zone tower"].cylinders[0]
    assert (disc.pose.position.x, disc.size.x, disc.size.y) == (40, 14, 14)
    assert max(p.x for p in drawn["zone ring"].lines[0].points) == pytest.approx(70)
    assert {e.texts[0].text for e in drawn.values()} == {"fence", "corner", "tower", "ring"}
    assert sum(each.topic == "/viz/area" for each in shown(said)) == 1


def area_m2(points: list[tuple[float, float]]) -> float:
    """Return the sum of the areas of triangles, all of which must be counter-clockwise."""
    areas = [
        ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2
        for a, b, c in zip(points[::3], points[1::3], points[2::3], strict=True)
    ]
    assert min(areas) >= 0
    return sum(areas)


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=3, max_size=12, unique=True))
def test_triangles_cover_a_simple_polygon_exactly(corners: list[tuple[int, int]]) -> None:
    """They lie inside (none is clockwise), and their areas add up to the polygon's."""
    assume(polygon_fault(corners) == "")
    pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
    whole_m2 = abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in pairs)) / 2
    assert area_m2(triangulated(corners)) == pytest.approx(whole_m2)


def test_the_scale_fits_the_fence() -> None:
    """An exclusion zone far away does not make the swarm small."""
    fence = Zone(name="fence", kind="inclusion", polygon=[(-20, -30), (60, -30), (60, 500)])
    far = Zone(name="far", kind="exclusion", centre=[1e6, 0], radius_m=1)
    assert extent_m(mission_of(parallel(), zone=[fence, far])) == ((-20, -30), (60, 500))
    assert extent_m(mission_of(parallel(), area_x_m=300.0, area_y_m=50.0)) == ((0, 0), (300, 50))


def test_events_are_logged_with_their_source() -> None:
    """Faults are logged as warnings."""
    event = Event(source="operator", kind="fault", detail="kill u1 @3s", sent_ns=EPOCH_NS, slot=6)
    (said,) = shown([event], EPOCH_NS + 1)
    log = Log.FromString(said.payload)
    assert (log.message, log.name, log.level) == ("fault: kill u1 @3s", "operator", Log.WARNING)


def test_a_dead_uav_looks_dead_and_the_log_tells_the_story(messages: list[Message]) -> None:
    """Its disc is grey, empty and crossed out, and its label says what it is."""
    messages = [m for m in messages if not (isinstance(m, Fix) and m.uav == "u1" and m.slot >= 4)]
    fault = Event(source="operator", kind="fault", detail="kill u1 @4", sent_ns=EPOCH_NS + 2_000_000_000, slot=4)
    said = shown([*messages, fault])
    lines = [Log.FromString(each.payload) for each in said if each.topic == "/viz/log"]
    assert ("dead: u1: killed by a fault in slot 4", Log.WARNING) in [(each.message, each.level) for each in lines]
    assert any(each.message.startswith("take-off: ") and each.level == Log.INFO for each in lines)
    scene = SceneUpdate.FromString(
        [each for each in said if each.topic == "/viz/uavs" and each.time_ns <= EPOCH_NS + 4_500_000_000][-1].payload
    )
    discs = {entity.id: entity for entity in scene.entities}
    assert [text.text for text in discs["u1"].texts] == ["u1 dead"]
    assert (len(discs["u1"].cylinders), len(discs["u1"].lines)) == (0, 3)
    assert discs["u0"].cylinders


def test_a_uav_that_landed_looks_so_before_its_head_frees_its_airspace(messages: list[Message]) -> None:
    """Others still keep clear of its disc, which is grey and crossed out, and says why."""
    fault = Event(source="u1", kind="landed", detail="", sent_ns=EPOCH_NS + 2_000_000_000, slot=4)
    discs = scene([*messages, fault], "uavs", 8)
    assert [text.text for text in discs["u1"].texts] == ["u1 landed"]
    assert (len(discs["u1"].cylinders), len(discs["u1"].lines)) == (0, 3)


def test_long_lists_in_the_log_can_be_broken_into_lines() -> None:
    """Viewers break lines at spaces only; a partition of 50 UAVs would exceed the panel."""
    event = Event(source="operator", kind="fault", detail="partition u1,u2|u3,u4 @3s", sent_ns=EPOCH_NS, slot=6)
    (said,) = shown([event], EPOCH_NS + 1)
    assert Log.FromString(said.payload).message == "fault: partition u1, u2|u3, u4 @3s"


def test_positions_on_the_map_state_their_covariance(messages: list[Message]) -> None:
    """A viewer draws no error ellipse for an unknown type of covariance."""
    change(messages, {}, Fix, lat_deg=47.4, lon_deg=8.5)
    fix = LocationFix.FromString(next(s for s in shown(messages)[::-1] if s.topic == "/viz/location/u1").payload)
    assert (fix.latitude, fix.longitude) == (47.4, 8.5)
    assert fix.position_covariance_type == LocationFix.DIAGONAL_KNOWN
    assert list(fix.position_covariance) == [6.25, 0, 0, 0, 6.25, 0, 0, 0, 0]


def test_the_last_words_of_a_mission_with_one_uav() -> None:
    """A mission with one UAV has no pair and no gap, and raises no error."""
    messages = flight(parallel(uavs=1))
    said = shown([msgspec.structs.replace(messages[0], sent_ns=EPOCH_NS), *messages[1:]])
    status = msgspec.json.decode(next(s for s in said if s.topic == "/viz/status").payload, type=Status)
    assert status.gap_m is UNSET


def test_every_topic_is_described_by_a_schema_that_stands_alone(messages: list[Message]) -> None:
    """A reader with the file alone can decode every message."""
    for each in {each.topic: each for each in shown(messages)}.values():
        channel = channel_of(each.topic)
        assert channel is not None
        if channel.encoding == "json":
            assert json.loads(each.payload).keys() <= json.loads(channel.schema_data)["properties"].keys()
            continue
        pool = DescriptorPool()
        for file in FileDescriptorSet.FromString(channel.schema_data).file:
            pool.Add(file)
        kind = GetMessageClass(pool.FindMessageTypeByName(channel.schema_name))
        assert kind.FromString(each.payload).SerializeToString(deterministic=True) == each.payload


def test_topics_leave_the_mission_out() -> None:
    """One layout fits every recording."""
    assert topic_of("swarm/m-1/viz/location/u1") == "/viz/location/u1"
    assert topic_of("swarm/m-1/uav/u1/fix") is None
    assert channel_of("/viz/other") is None


def test_the_layout_shows_only_what_there_is(messages: list[Message]) -> None:
    """Topics, message paths and panels all exist; both viewers find their title."""
    whole = layout(mission_of(parallel()))
    topics, panels = {each.topic for each in shown(messages)}, whole["configById"]
    assert set(panels["3D!swarm"]["topics"]) <= topics
    for config in panels.values():
        if "tabs" in config:
            continue
        assert config["foxglovePanelTitle"] == config["lichtblickPanelTitle"]
        for path in config.get("paths", []):
            topic, _, name = re.sub(r"\{.*\}", "", path["value"]).rpartition(".")
            assert topic in topics
            fields = (Status if topic == "/viz/status" else Told).__struct_fields__
            assert {name, *re.findall(r"\{(\w+)==", path["value"])} <= set(fields)
    tabs = [tab["layout"] for config in panels.values() for tab in config.get("tabs", [])]
    assert set.union(*map(_leaves, [whole["layout"], *tabs])) == set(panels)


@pytest.mark.parametrize("uavs", [MANY_UAVS, MANY_UAVS + 1])
def test_names_goals_and_links_of_many_uavs_begin_switched_off(uavs: int) -> None:
    """All other layers are on for any number of UAVs."""
    mission = mission_of([[(12.0 * k, 0.0), (12.0 * k, 9.0)] for k in range(uavs)])
    seen = layout(mission)["configById"]["3D!swarm"]["topics"]
    assert {name for name, topic in seen.items() if not topic["visible"]} == (
        set() if uavs <= MANY_UAVS else {f"/viz/{name}" for name in BUSY}
    )


@pytest.mark.parametrize(("area_m2", "step_m"), [(10_000.0, 20.0), (160_000.0, 20.0), (9e6, 500.0)])
def test_the_grid_is_coarser_over_larger_areas(area_m2: float, step_m: float) -> None:
    """The grid has 20 m, or more in large areas, where it would look like a solid surface."""
    grid = layout(mission_of(parallel(), area_m2=area_m2))["configById"]["3D!swarm"]["layers"]["grid"]
    assert grid["size"] / grid["divisions"] == step_m
    assert grid["divisions"] <= 50


def test_roles_stand_below_their_name_where_discs_are_small() -> None:
    """In a large area a label is higher than a disc."""
    messages = flight(parallel(), area_m2=9e6)
    messages[0] = msgspec.structs.replace(messages[0], sent_ns=EPOCH_NS)
    name, role = (scene(messages, layer, 3)["u0"].texts[0] for layer in ("labels", "uavs"))
    assert name.pose.position.y - role.pose.position.y > 3000 * name.font_size / 600 * 0.9


@pytest.mark.parametrize(("area_m2", "metres"), [(10_000.0, 100.0), (1_000_000.0, 1000.0)])
def test_the_map_shows_the_whole_area(area_m2: float, metres: float) -> None:
    """The map is centred on the area, at the closest zoom at which it fits into the panel."""
    mission = mission_of(parallel(), area_m2=area_m2, origin_lat_deg=60.0, origin_lon_deg=24.0)
    config = layout(mission)["configById"]["map!gps"]
    middle = to_wgs84(metres / 2, metres / 2, 60.0, 24.0)
    assert (config["center"]["lat"], config["center"]["lon"]) == middle
    pixels = metres / (TILE_MPP * math.cos(math.radians(middle[0])) / 2 ** config["zoomLevel"])
    assert MAP_PX / 2 < pixels <= MAP_PX


def _leaves(node: Any) -> set[str]:
    return {node} if isinstance(node, str) else _leaves(node["first"]) | _leaves(node["second"])


@given(st.lists(st.tuples(st.tuples(st.floats(0, 60), st.floats(0, 60)), st.floats(0.5, 8)), max_size=9))
def test_gaps_are_those_of_all_pairs(discs: list[tuple[tuple[float, float], float]]) -> None:
    """The sweep from left to right misses no pair."""
    named = [(centre, r_m, str(k)) for k, (centre, r_m) in enumerate(discs)]
    pairs = [
        (math.hypot(a[0][0] - b[0][0], a[0][1] - b[0][1]) - a[1] - b[1], {a[2], b[2]})
        for i, a in enumerate(named)
        for b in named[i + 1 :]
    ]
    found = gaps(named)
    assert found.overlapping == set().union(*(names for gap_m, names in pairs if gap_m < -1e-9))
    if pairs:
        assert found.least_m == pytest.approx(min(gap_m for gap_m, _ in pairs))
    else:
        assert found.least_m is None
