"""Overload: who comes first, who stays standby, and what messages do that come too late."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import msgspec
import numpy as np
import pytest

from edc_swarm.agent.election import Election
from edc_swarm.agent.knowledge import Knowledge
from edc_swarm.agent.leadership import Leadership
from edc_swarm.agent.node import Publish, Received, Tick, UavNode
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.agent.vehicle import Promise
from edc_swarm.geometry import Floats, length_m, point_segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.planner import guidance_kernel as kernel
from edc_swarm.planner import ways
from edc_swarm.planner.interface import Hull, PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Fix, MissionMessage, Report
from edc_swarm.solver.hull_rows import Obstacles
from processes.runtime.priority import permitted_nice
from tests import builders
from tests.builders import at, mission_message, row

IDS = ("a", "b", "c", "d", "e")
ROSTER = [
    msgspec.structs.replace(entry, energy_j=1e4 - k) for k, entry in enumerate(row(IDS, gap_m=40.0, north_m=90.0))
]
MISSION: MissionMessage = mission_message(ROSTER, gps_model="none", standbys=2)


def follower() -> UavNode:
    """UAV b in slot 5, which grants a in term 1 and heard of it in slot 4."""
    promise = Promise(slot=4, term=1, head="a", waypoint_x_m=40.0, waypoint_y_m=0.0)
    node = builders.node(MISSION, "b", promise)
    node.step(Tick(), at(5))
    return node


def report_of(slot: int, heard: str = "abcde", **fields: Any) -> Report:
    """A report of head a with a quorum."""
    return builders.report(slot, heard=list(heard), grants=list(heard), quorum=MISSION.quorum, **fields)


@pytest.mark.parametrize("slots_late", [0, 1, 2, 9])
def test_a_handover_is_followed_however_late_its_report_comes(slots_late: int) -> None:
    """Else this UAV would stay in a term that its head has left, and miss in the quorum of the successor."""
    node = follower()
    for slot in range(6, 7 + slots_late):
        node.step(Tick(), at(slot))
    node.step(Received(report_of(5, successor="c", next_term=2)), at(6.5 + slots_late))
    assert node.grant == (2, "c")


def test_a_late_report_is_no_sign_of_life() -> None:
    """It renews no lease and changes no standbys, and one of another head or a lower term moves nobody."""
    node = follower()
    for slot in range(6, 15):
        node.step(Tick(), at(slot))
    for late in (report_of(5), report_of(5, head="d", successor="c", next_term=2)):
        node.step(Received(late), at(14.5))
        assert (node.grant, node.trusts) == ((1, "a"), False)


def test_nobody_trusts_without_a_head() -> None:
    """A UAV that trusts its head reads fixes late; in control without a head each UAV needs them at once."""
    local = mission_message(ROSTER, gps_model="none", control="local")
    alone = builders.node(local, "b", Promise(waypoint_x_m=40.0, waypoint_y_m=0.0))
    alone.step(Tick(), at(5))
    assert not alone.trusts
    node = follower()
    node.step(Received(report_of(5)), at(5.5))
    assert node.trusts
    assert not node.is_awaited


def test_a_command_that_comes_too_late_asks_for_no_second_fix() -> None:
    """The head is slow, not deaf: the fix would be one of K more that an overloaded machine has to carry."""
    waits, spared = follower(), follower()
    for node in (waits, spared):
        node.step(Tick(), at(6))
    spared.step(Received(builders.command("b", 6, (40.0, 0.0), (40.0, 1.0))), at(6.1))
    said = [
        [e for e in node.step(Tick(), at(6.21)) if isinstance(e, Publish) and isinstance(e.message, Fix)]
        for node in (waits, spared)
    ]
    assert [len(fixes) for fixes in said] == [1, 0]


def heard_by_head(slot: int, *uavs: str, **fields: Any) -> Leadership:
    """Head a, whose standbys are d and e, with the fixes of slot 9 of all, and of `slot` of some."""
    knowledge = Knowledge(ROSTER)
    election = Election(MISSION, "a", (1, "a"), True, knowledge)
    leadership = Leadership(MISSION, "a", knowledge, election, SlotClock(MISSION))
    leadership.head.take_office((1, "a"))
    for when, some in ((9, IDS), (slot, uavs)):
        election.begin_slot(when)
        for uav in some:
            changed = fields if when == slot else {}
            knowledge.hear_fix(
                builders.fix(uav, when, term=1, head="a", energy_j=1e4 - IDS.index(uav), **changed), when
            )
        if when == 9:
            election.hear_report(report_of(9, standby=["d", "e"]))
    return leadership


@pytest.mark.parametrize(
    ("slot", "heard", "gone", "standbys"),
    [
        (10, "abcde", "", ["b", "c"]),  # All are heard: ranked anew.
        (10, "abc", "", ["d", "e"]),  # Their fixes are late.
        (10, "abcd", "", ["d", "e"]),
        (12, "abc", "", ["d", "e"]),
        (13, "abc", "", ["b", "c"]),  # Nobody waits for them any more.
        (10, "abd", "e", ["d", "b"]),  # c is late; e has left the bus.
    ],
)
def test_standbys_stay_while_fixes_are_late(slot: int, heard: str, gone: str, standbys: list[str]) -> None:
    """A head that heard others in each slot would name others in each slot, and all of them would hear all fixes."""
    leadership = heard_by_head(slot, *heard)
    leadership.gone.update(gone)
    assert leadership.with_succession(report_of(slot, heard)).standby == standbys


def test_a_standby_that_suspects_its_head_does_not_stay() -> None:
    """It may not hear."""
    leadership = heard_by_head(10, "a", "b", "d", "e", suspects=True)
    assert leadership.with_succession(report_of(10, "abde")).standby == ["b", "d"]


# --- plans with many unheard UAVs -----------------------------------------------------------------


def crowded(unheard: int) -> PlanRequest:
    """Half of 40 UAVs among the hulls of others, some of which cover targets."""
    spot_m = [(20.0 * (i % 8), 20.0 * (i // 8)) for i in range(40)]
    heard, hulls = range(40 - unheard), range(40 - unheard, 40)
    return PlanRequest(
        slot=1,
        uav=list(heard),
        position_m=[spot_m[i] for i in heard],
        target_m=[spot_m[39 - i] for i in heard],
        rest_m=[0.0] * len(heard),
        r_m=[5.0] * len(heard),
        hulls=[Hull(i, *spot_m[i], spot_m[i][0] + 2.0, spot_m[i][1], 3.0, 5.0) for i in hulls],
    )


def test_near_hulls_alone_give_the_plan_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the hulls out of reach nor the far rings about a covered target change a waypoint, to the last bit."""
    mission = Mission(uavs=40)
    plan_m = make_planner("edc", mission).plan(crowded(20)).waypoint_m
    near = ways.walls_of
    counts = []

    def all_of(position_m: Floats, r_m: Floats, obstacles: Obstacles, _: object = 0) -> kernel.Walls:
        counts.append(len(near(position_m, r_m, obstacles, 2.5).which))
        return near(position_m, r_m, obstacles)

    monkeypatch.setattr(ways, "walls_of", all_of)
    monkeypatch.setattr(ways, "RINGS_AT_ONCE", ways.RINGS)
    assert np.array_equal(plan_m, make_planner("edc", mission).plan(crowded(20)).waypoint_m)
    assert counts[0] < 20 * 20, "hulls are out of reach"


def test_no_hull_is_left_out_that_a_flight_can_come_near() -> None:
    """A UAV that flies as far as it can, in any of 64 directions, keeps its distance from all hulls not listed."""
    rng = np.random.default_rng(0)
    start_m, a_m = rng.uniform(0, 200, (30, 2)), rng.uniform(0, 200, (40, 2))
    hulls = Obstacles(a_m, a_m + rng.normal(0, 4, (40, 2)), rng.uniform(0, 9, 40), np.full(40, 5.0))
    walls = ways.walls_of(start_m, np.full(30, 5.0), hulls, reach_m=np.full(30, 40.0))
    angle = np.linspace(0, 2 * np.pi, 64)
    ends_m = start_m[:, None] + 40.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for k in range(30):
        far = np.setdiff1d(np.arange(40), walls.which[walls.begin[k] : walls.begin[k + 1]])
        assert len(far) > 0
        away_m = point_segment_distance_m(ends_m[k][:, None], walls.a_m[far], walls.b_m[far])
        assert (away_m >= walls.keep_m[k, far]).all()


def test_a_place_to_wait_is_clear_of_all_hulls() -> None:
    """Also of those that do not cover the target, which the near rings may touch."""
    rng = np.random.default_rng(1)
    a_m = rng.uniform(0, 120, (40, 2))
    hulls = Obstacles(a_m, a_m, np.full(40, 1.0), np.full(40, 5.0))
    goal_m = ways.free_goals(a_m[:12] + 1.0, np.full(12, 5.0), hulls)
    assert (point_segment_distance_m(goal_m[:, None], a_m[None], a_m[None]) >= 11.0).all()
    assert (length_m(goal_m - a_m[:12]) < 60.0).all()


# --- priority ---------------------------------------------------------------------------------------

THREADS = """
import os, resource, sys, threading
from processes.runtime import priority
base = os.getpriority(os.PRIO_PROCESS, 0)
if sys.argv[1] != "root":
    most = 20 - (base - 3) if sys.argv[1] == "limit" else 0
    try:
        resource.setrlimit(resource.RLIMIT_NICE, (most, most))
    except ValueError:
        sys.exit("root has no CAP_SYS_RESOURCE")
    os.setgroups([])
    os.setuid(65534)
stop = threading.Event()
def facts():
    threads = [int(t) for t in os.listdir("/proc/self/task")]
    return {(os.sched_getscheduler(t) == os.SCHED_BATCH, os.getpriority(os.PRIO_PROCESS, t) - base, slice_ms(t))
            for t in threads}
def slice_ms(thread):
    got = priority._ATTRIBUTES.pack(*[0] * 8)
    priority._system.syscall(priority._SCHED_SETATTR + 1, thread, got, len(got), 0)
    return round(priority._ATTRIBUTES.unpack(got)[5] / 1e6)
threading.Thread(target=stop.wait).start()
for place in (priority.give_way, priority.come_first, priority.give_way):
    place()
    threading.Thread(target=stop.wait).start()
    print(*(f"{'batch' if batch else 'other'} {nice} {ms}" for batch, nice, ms in facts()), sep=", ")
stop.set()
"""


@pytest.mark.parametrize(("user", "raised", "slice_ms"), [("root", -10, 19), ("limit", -3, 4), ("nobody", 0, None)])
def test_all_threads_take_their_place(user: str, raised: int, slice_ms: int | None) -> None:
    """Also those that begin later. A user gets as much priority as the limit permits, and a slice to match."""
    if subprocess.run(["nice", "-n", "-1", "true"], capture_output=True, check=False).stderr != b"":
        pytest.skip("only root can take other limits, and become nobody")
    ran = subprocess.run([sys.executable, "-c", THREADS, user], capture_output=True, text=True, check=False)
    if "CAP_SYS_RESOURCE" in ran.stderr:
        pytest.skip("root may not raise limits here")
    assert ran.stderr == ""
    behind, first, behind_again = ran.stdout.splitlines()
    usual_ms = int(behind.split()[-1])
    assert behind == behind_again == f"batch 0 {usual_ms}"
    assert first == f"other {raised} {slice_ms if slice_ms and usual_ms else usual_ms}"  # Old kernels know no slices.


@pytest.mark.parametrize(("base", "limit", "nice"), [(0, 0, 0), (0, 23, -3), (0, 40, -10), (5, 18, 2), (5, 10, 5)])
def test_a_user_asks_for_what_the_limit_permits(base: int, limit: int, nice: int) -> None:
    """A user whom a limit of 23 permits nice -3 gets nothing of nice -10, but an error."""
    assert permitted_nice(base, limit) == nice
