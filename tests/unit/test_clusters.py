"""Clusters: who is in which, what bad input says, what a head knows of foreign UAVs, and the verdicts of each."""

from __future__ import annotations

import math
from collections import Counter
from random import Random
from typing import Any

import msgspec
import pytest

from edc_swarm.agent.election import Election
from edc_swarm.agent.foreign import NEAR_SLOTS, Foreign
from edc_swarm.agent.head import Head
from edc_swarm.agent.knowledge import ABSENT_SLOTS, Knowledge
from edc_swarm.agent.leadership import Leadership
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.clusters import of_each, parts_of
from edc_swarm.analysis.guarantees.evidence import Evidence, gather
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, verdict
from edc_swarm.analysis.head_terms import failover_slots, heads_of
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.errors import MissionError
from edc_swarm.geometry import segment_distance_m
from edc_swarm.mission.clusters import cluster_names, of_cluster
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.vehicle_model import VehicleModel
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.admission import Admission
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.messages import Fix, Message, MissionMessage, Report
from edc_swarm.recording.by_cluster import by_cluster
from edc_swarm.recording.model import Recording
from edc_swarm.report_page.assets import page_assets
from edc_swarm.report_page.data import Page
from edc_swarm.report_page.render import render
from edc_swarm.simulation.network import TRANSIT_NS
from edc_swarm.simulation.simulator import Simulation
from edc_swarm.story.teller import Storyteller
from tests.builders import EPOCH_NS, at, entry, fix, mission_message

TWO = [
    *(entry(f"a{k}", (20.0 * k, 0.0), (20.0 * k, 8.0), cluster="a", energy_j=1e6) for k in range(3)),
    *(entry(f"b{k}", (20.0 * k, 40.0), (20.0 * k, 32.0), cluster="b", energy_j=1e6) for k in range(2)),
]
"""Two clusters that never come near each other."""


def _refused(**fields: Any) -> str:
    with pytest.raises(MissionError) as refused:
        complete_mission(mission_from_dict(fields))
    return str(refused.value)


def _named(*names: str) -> list[dict[str, Any]]:
    return [
        {"uav": f"u{k}", "start_x_m": 20.0 * k, "start_y_m": 0.0, "target_x_m": 20.0 * k, "target_y_m": 9.0, **named}
        for k, name in enumerate(names)
        for named in [{"cluster": name} if name else {}]
    ]


def _flown(faults: tuple[str, ...] = ()) -> list[Message]:
    said: list[Message] = []
    flown = complete_mission(Mission(roster=TWO, uavs=len(TWO), fault=list(faults), max_slots=60))
    fields = {name: getattr(flown, name) for name in flown.__struct_fields__}
    message = MissionMessage(**fields, epoch_ns=EPOCH_NS)
    Simulation(message, lambda: make_planner("edc", message), lambda _key, each, _ns: said.append(each)).run()
    return said


@pytest.fixture(scope="module")
def flight() -> list[Message]:
    """Return what two clusters say, of which one loses its head."""
    return _flown(("kill head-b @3 for 2",))


def test_k_means_leaves_no_cluster_empty_and_depends_on_the_seed_alone() -> None:
    """Drawing twice, and completing twice, gives the same clusters."""
    for seed in range(5):
        drawn = Mission(uavs=9, clusters=4, seed=seed, area_m2=20_000.0)
        flown = complete_mission(drawn)
        assert flown == complete_mission(drawn) == complete_mission(flown)
        sizes = Counter(each.cluster for each in flown.roster)
        assert set(sizes) == {"c1", "c2", "c3", "c4"}
        assert sum(sizes.values()) == 9


def test_as_many_clusters_as_uavs_are_one_uav_each() -> None:
    """Nobody shares a cluster then."""
    assert len(cluster_names(complete_mission(Mission(uavs=4, clusters=4)).roster)) == 4


def test_k_means_puts_together_who_flies_together() -> None:
    """Two groups far apart are two clusters."""
    roster = [
        entry(f"u{k}", (12.0 * (k // 2), 200.0 * (k % 2)), (12.0 * (k // 2), 200.0 * (k % 2) + 9)) for k in range(8)
    ]
    flown = complete_mission(Mission(roster=roster, uavs=8, clusters=2, seed=5))
    assert [each.cluster for each in flown.roster] == ["c1", "c2"] * 4


def test_a_mission_with_one_cluster_is_its_own_part() -> None:
    """Its roster names no cluster, also where the file names one."""
    flown = complete_mission(Mission(uavs=3))
    assert of_cluster(flown, "") is flown
    assert all(not each.cluster for each in flown.roster)
    assert complete_mission(mission_from_dict({"roster": _named("a", "a")})).roster[0].cluster == ""


def test_bad_input_is_refused_in_one_line() -> None:
    """Too many clusters, an empty one, a UAV in two or in none, overlaps, and planners that keep nobody apart."""
    assert "clusters = 5: must be at most the number of UAVs (4)" in _refused(uavs=4, clusters=5)
    assert "roster[1].cluster" in _refused(roster=_named("a", ""))
    assert "none may be empty" in _refused(roster=_named("a", "b", "b"), clusters=3)
    assert "an id that no other UAV has" in _refused(roster=[*_named("a", "b"), {**_named("a")[0], "cluster": "b"}])
    near = _named("a", "b")
    near[1]["start_x_m"] = 3.0
    assert "m from the start of u" in _refused(roster=near)
    assert "planner" in _refused(roster=_named("a", "b"), planner="orca")
    assert "clusters" in _refused(roster=_named("a", "b"), control="local", planner="orca")
    for text in map(str, (_refused(uavs=4, clusters=5), _refused(roster=_named("a", "")))):
        assert "\n" not in text


def test_faults_name_the_heads_of_clusters() -> None:
    """`head-NAME` and `standby-NAME` are targets where there is such a cluster."""
    flown = mission_message(TWO, clusters=2, fault=["kill head-b @3", "kill standby-a @4"])
    assert len(parse_faults(flown)) == 2
    with pytest.raises(MissionError):
        parse_faults(mission_message(TWO, clusters=2, fault=["kill head-c @3"]))
    with pytest.raises(MissionError):
        parse_faults(mission_message([entry("a")], fault=["kill head-a @3"]))
    named = [entry("head-a", (40.0, 80.0), (40.0, 90.0), cluster="a"), *TWO]
    with pytest.raises(MissionError, match="both an id and a word"):
        parse_faults(mission_message(named, clusters=2, fault=["kill head-a @3"]))


def test_a_foreign_uav_is_where_its_fix_of_the_slot_says_and_nowhere_else() -> None:
    """A fix of a slot before is a hull, which grows by the longest step for each slot."""
    foreign = Foreign(mission_message(TWO, clusters=2), "a")
    foreign.hear_fix(fix("b0", 4, (0.0, 38.0)), 4)
    assert [(seen.uav, seen.position_m) for seen in foreign.heard(4)] == [(3, (0.0, 38.0))]
    assert [hull.uav for hull in foreign.hulls(4, strays=False)] == [4]
    for slot in (5, 6):
        assert foreign.heard(slot) == []
        later = {hull.uav: hull.radius_m for hull in foreign.hulls(slot, strays=False)}
        assert later == {3: pytest.approx((slot - 4) * 2.5), 4: pytest.approx((slot + 1) * 2.5)}


def test_a_head_waits_for_near_foreign_uavs_that_it_has_heard_lately() -> None:
    """As it waits for its own: until tau, not for one unheard for more than three slots, nor for one far away."""
    mission = mission_message(TWO, clusters=2)
    own, knowledge = of_cluster(mission, "a"), Knowledge(of_cluster(mission, "a").roster)
    election, clock = Election(own, "a0", (1, "a0"), True, knowledge), SlotClock(mission)
    foreign = Foreign(mission, "a")
    leadership = Leadership(own, "a0", knowledge, election, clock, foreign)
    leadership.planner = make_planner("edc", mission)
    leadership.head = Head(own, "a0", 0, knowledge, foreign)
    leadership.head.take_office((1, "a0"))
    for uav in ("b0", "b1"):
        foreign.hear_fix(fix(uav, 3, (0.0, 38.0)), 3)
    due = []
    for slot in (4, 4 + ABSENT_SLOTS):
        election.begin_slot(slot)
        foreign.begin_slot(slot)
        foreign.look_around(slot, [(0.0, 0.0)])
        for k in range(3):
            knowledge.hear_fix(fix(f"a{k}", slot, term=1, head="a0"), slot)
        now_ns = clock.start_ns(slot)
        due += [(set(foreign.awaited), leadership.plan_due(slot, now_ns))]
        assert leadership.plan_due(slot, leadership.deadline_ns(slot))
        foreign.hear_fix(fix("b0", slot, (0.0, 38.0)), slot)
        due += [(set(foreign.awaited), leadership.plan_due(slot, now_ns))]
    assert due == [({"b0", "b1"}, False), ({"b1"}, False), ({"b0"}, False), (set(), True)]
    foreign.look_around(8, [(9000.0, 9000.0)])
    assert foreign.awaited == set()


def test_heads_plan_as_soon_as_all_that_they_wait_for_are_heard() -> None:
    """On a good network that is when the fixes of the slot come, half a millisecond after it began, not tau."""
    said = _flown()
    (mission,) = (message for message in said if isinstance(message, MissionMessage))
    reports = [message for message in said if isinstance(message, Report) and message.has_quorum and message.slot > 4]
    assert {report.head for report in reports} >= {"a0", "b0"}
    late_ns = {report.sent_ns - (mission.epoch_ns + report.slot * mission.slot_ns) for report in reports}
    assert late_ns == {TRANSIT_NS}


def test_a_report_of_its_head_makes_a_foreign_hull_smaller_and_landing_takes_it_away() -> None:
    """A report that no quorum backs changes nothing."""
    foreign = Foreign(mission_message(TWO, clusters=2), "a")
    ends = {"hull_ax_m": [20.0], "hull_ay_m": [38.0], "hull_bx_m": [20.0], "hull_by_m": [38.0]}
    place: dict[str, Any] = {**ends, "hull_r_m": [1.0]}
    said = Report(head="b0", slot=5, term=1, status="planned", grants=["b0", "b1"], quorum=2, hull_uav=["b1"], **place)
    alone = Report(head="b0", slot=6, term=2, status="planned", grants=["b0"], quorum=1, landed=["b1"])
    foreign.hear_report(said, 5)
    foreign.hear_report(alone, 6)
    assert {hull.uav: hull.radius_m for hull in foreign.hulls(6, strays=False)}[4] == pytest.approx(1.0 + 2.5)
    foreign.hear_report(
        Report(head="b0", slot=7, term=1, status="planned", grants=["b0", "b1"], quorum=2, landed=["b1"]), 7
    )
    assert 4 not in {hull.uav for hull in foreign.hulls(7, strays=False)}


def test_a_report_of_a_slot_to_come_says_nothing_of_this_one() -> None:
    """A cluster whose clock is ahead reports where its UAV is one slot later; until then it may be a step away."""
    foreign = Foreign(mission_message(TWO, clusters=2), "a")
    ends: dict[str, Any] = {
        "hull_ax_m": [20.0],
        "hull_ay_m": [30.5],
        "hull_bx_m": [20.0],
        "hull_by_m": [30.5],
        "hull_r_m": [0.0],
    }
    early = Report(head="b0", slot=4, term=1, status="planned", grants=["b0", "b1"], quorum=2, hull_uav=["b1"], **ends)
    foreign.hear_report(early, 3)
    assert {hull.uav: hull.radius_m for hull in foreign.hulls(3, strays=False)}[4] == pytest.approx(4 * 2.5)
    foreign.begin_slot(4)
    assert {hull.uav: hull.radius_m for hull in foreign.hulls(4, strays=False)}[4] == 0.0


def test_a_head_hears_the_uavs_that_can_come_near_and_asks_again_for_the_others_as_their_hulls_grow() -> None:
    """A UAV that was far away is asked for again once its hull comes near."""
    far_m = 2 * (5.0 + NEAR_SLOTS * 2.5) + 30.0
    roster = [*TWO[:3], entry("b0", (0.0, far_m), (0.0, far_m + 9), cluster="b")]
    foreign = Foreign(mission_message(roster, clusters=2), "a")
    places = [(0.0, 0.0), (20.0, 0.0)]
    seen = []
    for slot in (0, 12, 13, 16):
        if slot == 13:
            foreign.hear_fix(fix("b0", 13, (0.0, far_m)), 13)
        foreign.look_around(slot, places)
        seen.append(set(foreign.near))
    assert seen == [set(), {"b0"}, {"b0"}, set()]


@pytest.mark.parametrize("a_max_mps2", [math.inf, 0.4])
def test_only_hulls_that_no_uav_can_come_near_are_left_out(a_max_mps2: float) -> None:
    """However old its fix, a hull left out is not near, its braking path included."""
    autopilot = VehicleModel(model="mavlink", autopilot="udpin:127.0.0.1:{14550+i}", a_max_mps2=a_max_mps2)
    inertia = {} if math.isinf(a_max_mps2) else {"vehicle": autopilot}
    rng, own, counts = Random("far"), [(0.0, 0.0), (40.0, 0.0)], Counter[bool]()
    away_m = [(rng.uniform(60, 700) * math.cos(k), rng.uniform(60, 700) * math.sin(k)) for k in range(60)]
    roster = [*TWO[:3], *(entry(f"b{k}", at_m, cluster="b") for k, at_m in enumerate(away_m))]
    foreign = Foreign(mission_message(roster, clusters=2, lag_slots=len(inertia), **inertia), "a")
    for k, (x_m, y_m) in enumerate(away_m[:50]):
        foreign.hear_fix(fix(f"b{k}", k % 20, (x_m, y_m), from_x_m=x_m - 1.5, from_y_m=y_m + 2.0), 20)
    near = {hull.uav for hull in foreign.hulls(20, strays=False, own=own)}
    for hull in foreign.hulls(20, strays=False):
        counts[hull.uav in near] += 1
        ends_m = (hull.ax_m, hull.ay_m), (hull.bx_m, hull.by_m)
        apart_m = min(float(segment_distance_m(at_m, at_m, *ends_m)) for at_m in own) - hull.radius_m
        assert hull.uav in near or apart_m > foreign._near_m
    assert counts[True] > 5
    assert counts[False] > 5


def test_a_report_is_admitted_by_the_quorum_of_its_own_cluster() -> None:
    """Grants of another cluster back nothing."""
    admission = Admission(mission_message(TWO, clusters=2))
    of: dict[str, Any] = {"slot": 3, "term": 1, "status": "planned", "sent_ns": at(3.5)}
    assert admission.refusal(Report(head="b0", grants=["b0", "b1"], quorum=2, **of)) is None
    assert admission.refusal(Report(head="b0", grants=["b0", "a0"], quorum=2, **of)) is not None
    assert admission.refusal(Report(head="a0", grants=["a0"], quorum=1, **of)) is not None


def test_both_clusters_elect_heads_and_every_guarantee_holds(flight: list[Message]) -> None:
    """One of them loses its head and elects another."""
    recording = Recording.from_messages(flight)
    heads = heads_of(recording)
    assert [len(terms) for terms in heads.values()] == [1, 2]
    assert len(failover_slots(heads)) == 1
    assert {r.guarantee: r.status for r in check(recording)} == {
        **dict.fromkeys(("G1", "G2", "G3", "G4", "G5", "G7"), "held"),
        "G8": "not-applicable",
    }


def test_tables_and_page_say_which_head_is_of_which_cluster(flight: list[Message]) -> None:
    """Each cluster's row of the metrics has its heads; the table of the UAVs has a column with the cluster."""
    recording = Recording.from_messages(flight)
    metrics, heads = compute_metrics(recording), heads_of(recording)
    rows = dict(metric_rows(metrics))
    assert "heads" not in rows
    for name, terms in heads.items():
        said = rows[f"cluster {name}"].partition("; heads: ")[2]
        assert [part.split(" ", 1)[0] for part in said.split("), ")] == [term.head for term in terms]
    page = render(Page.of(recording, metrics.heads), metrics, [], {}, page_assets())
    assert "<th scope=col>UAV</th><th scope=col>cluster</th><th scope=col>at the end</th>" in page
    for each in TWO:
        assert f"<tr><th scope=row>{each.uav}</th><td>{each.cluster}</td>" in page


def test_two_heads_in_one_term_of_one_cluster_break_g1_and_in_two_clusters_do_not(flight: list[Message]) -> None:
    """Both clusters have a head in term 1."""
    plan = next(each for each in flight if isinstance(each, Report) and each.head.startswith("a") and each.has_quorum)
    rival = Report(
        head="a2" if plan.head != "a2" else "a1", slot=plan.slot, term=plan.term, status="planned",
        grants=plan.grants, quorum=plan.quorum, sent_ns=plan.sent_ns,
    )  # fmt: skip
    g1 = next(r for r in check(Recording.from_messages([*flight, rival])) if r.guarantee == "G1")
    assert g1.broken
    assert any(found.kind == "two-heads" and found.text.startswith("cluster a: ") for found in g1.violations)


def test_a_cluster_that_does_not_arrive_breaks_g7(flight: list[Message]) -> None:
    """The record ends before the UAVs of one cluster arrive."""
    cut = [each for each in flight if getattr(each, "slot", 0) < 4 or not str(getattr(each, "uav", "")).startswith("b")]
    results = {result.guarantee: result for result in check(Recording.from_messages(cut))}
    assert not results["G7"].held


def test_a_record_without_a_word_of_one_cluster_judges_nothing(flight: list[Message]) -> None:
    """As of a host whose recording is lost."""
    cut = [each for each in flight if not str(getattr(each, "instance", "")).startswith("b")]
    statuses = {result.guarantee: result.status for result in check(Recording.from_messages(cut))}
    assert set(statuses.values()) == {"not-judged", "not-applicable"}
    assert statuses["G8"] == "not-applicable"


def _late(flight: list[Message], kind: str = "not-arrived", guarantee: str = "G7", fault: str = "") -> GuaranteeResult:
    """Return the verdict on both clusters if cluster a has a violation, with a fault in the mission."""
    said = [
        msgspec.structs.replace(each, fault=[*each.fault, fault])
        if isinstance(each, MissionMessage) and fault
        else each
        for each in flight
    ]

    def checker(part: Evidence) -> GuaranteeResult:
        found = [Violation(kind, "a0 is not there", uavs=["a0"])] if part.recording.fixes[0].uav[0] == "a" else []
        return verdict(guarantee, "Title", found)

    return of_each(parts_of(gather(Recording.from_messages(said))), checker)


def test_g7_promises_nothing_where_a_partition_between_clusters_never_heals(flight: list[Message]) -> None:
    """One that heals, one within a cluster, and another violation than not to be there are no excuse."""
    assert _late(flight).broken
    for fault in ("partition a0,a1,a2|rest @2", "partition a0>b0 @2"):
        assert not _late(flight, fault=fault).broken, fault
    for fault in ("partition a0,a1,a2|rest @2 for 20", "partition a0|a1,a2 @2", "partition b0|b1 @2"):
        assert _late(flight, fault=fault).broken, fault
    assert _late(flight, "landed-unasked", fault="partition a0,a1,a2|rest @2").broken
    assert _late(flight, guarantee="G1", fault="partition a0,a1,a2|rest @2").broken


def test_g7_promises_nothing_while_another_cluster_has_no_quorum_left(flight: list[Message]) -> None:
    """The loss of one of two UAVs of cluster b is one; that of one of three of cluster a is none."""

    def without(uav: str) -> list[Message]:
        return [each for each in flight if not (isinstance(each, Fix) and each.uav == uav and each.slot > 3)]

    assert not _late(without("b1")).broken
    assert _late(without("a2")).broken
    assert _late(without("b1"), guarantee="G1").broken


def test_the_recording_of_each_cluster_has_its_own_messages(flight: list[Message]) -> None:
    """Quorums are those of the clusters."""
    parts = by_cluster(Recording.from_messages(flight))
    assert {name: {each.uav[0] for each in part.fixes} for name, part in parts.items()} == {"a": {"a"}, "b": {"b"}}
    assert [part.mission.quorum for part in parts.values()] == [2, 2]


def test_the_story_names_the_head_of_each_cluster_once(flight: list[Message]) -> None:
    """What the operator says is told once."""
    teller = Storyteller(next(each for each in flight if isinstance(each, MissionMessage)))
    for each in flight:
        teller.hear(each)
    for slot in range(40):
        teller.close(slot)
    terms = [told.uavs[0][0] for told in teller.happenings if told.kind == "term"]
    assert sorted(terms) == ["a", "b", "b"]
    assert sum(told.kind == "fault" for told in teller.happenings) == 1
    assert sum(told.kind == "end" for told in teller.happenings) <= 1
    assert list(teller.states) == [each.uav for each in TWO]


def test_a_mission_is_complete_when_every_cluster_is() -> None:
    """The monitor knows the heads of all clusters."""
    monitor = MissionMonitor(mission_message(TWO, clusters=2))
    for each in TWO:
        at_m = (each.target_x_m, each.target_y_m)
        assert not monitor.complete(3)
        monitor.hear_fix(fix(each.uav, 3, at_m, arrived=True))
    assert monitor.complete(3)
    assert set(monitor.in_office) == {"head-a", "standby-a", "head-b", "standby-b"}
