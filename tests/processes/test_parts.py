"""The small parts of the processes, each by itself."""

from __future__ import annotations

import fcntl
import os
import socket
import time
from pathlib import Path

import msgspec
import pytest

from edc_swarm.agent.node import Disturbed, Tick
from edc_swarm.agent.vehicle import Airframe, Promise
from edc_swarm.emulation.delay_log import quantiles
from edc_swarm.emulation.links import DelayError, LinkEmulator, cut_pair
from edc_swarm.errors import InputError, MessageError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import ChangeGps
from edc_swarm.mission.link import Link
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.trace import unpack
from edc_swarm.mission.validation import load_mission
from edc_swarm.planner.interface import Plan, PlanRequest
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import mission_message
from processes.bus.abort_notice import operated_router, word_after
from processes.bus.address import NO_ANSWER, check_endpoint, connect_endpoint, free_endpoint, unreachable_router
from processes.bus.peers import CHECK_AFTER_NS, Peers
from processes.bus.subscriptions import MAX_COUNTED_KEYS, MAX_TOKENS, Gate, Heard, Malformed, Postbox, Token
from processes.runtime.clock import MissionClock
from processes.runtime.inbox import Inbox
from processes.runtime.output import Output, salvage_parts
from processes.uav.local_faults import LocalFaults
from processes.uav.planner_loader import SlowPlanner, load_planner
from processes.uav.state import UavState, create_state, promise_path
from tests import builders

MISSION = complete_mission(Mission(uavs=3))
REPORT = builders.report(1, head="u002")


def test_inbox_is_bounded_but_for_orders() -> None:
    """An item that must not be lost passes a full queue."""
    inbox: Inbox[int] = Inbox(limit=2)
    for number in range(4):
        inbox.put(number)
    inbox.put_always(9)
    assert inbox.wait(0) == [0, 1, 9]
    assert inbox.dropped == 2
    assert inbox.wait(0) == []


def test_inbox_is_bounded_in_bytes_too() -> None:
    """A few large items fill it like many small ones; removed items make room again."""
    inbox: Inbox[str] = Inbox(limit_bytes=10)
    inbox.put("a", 6)
    inbox.put("b", 6)
    inbox.put("c", 4)
    assert inbox.wait(0) == ["a", "c"]
    inbox.put("d", 10)
    assert (inbox.wait(0), inbox.dropped) == (["d"], 1)


def test_quiet_items_wait_for_the_next_that_wakes() -> None:
    """They come out before it, in their order; alone they come out when the wait ends, and count for the bounds."""
    inbox: Inbox[int] = Inbox(limit=3)
    inbox.quiet_until_s = time.monotonic() + 60
    for number in (1, 2):
        inbox.put_quietly(number)
    inbox.put(3)
    inbox.put_quietly(4)
    assert (len(inbox), inbox.dropped) == (3, 1)
    assert inbox.wait(0) == [1, 2, 3]
    assert inbox.quiet_until_s == 0, "what comes after the wake-up wakes again"
    inbox.put_quietly(5)
    assert inbox.wait(None) == [5]
    inbox.quiet_until_s = time.monotonic() + 60
    inbox.put_quietly(6)
    assert inbox.wait(0) == [6]


def test_a_planner_rehearses_and_then_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """It plans the mission's first slot once, and the planner that flies has not planned yet."""
    made: list[list[PlanRequest]] = []

    class Stub:
        def __init__(self) -> None:
            made.append([])

        def plan(self, request: PlanRequest) -> Plan:
            made[-1].append(request)
            return Plan(list(request.position_m), "no-qp-needed")

    monkeypatch.setattr("edc_swarm.planner.registry.make_planner", lambda *_: Stub())
    monkeypatch.setattr("processes.uav.planner_loader._warm_for", {MISSION.planner})
    load_planner(MISSION, lambda _planner: None, rehearsed=False)
    assert made == [[]]
    made.clear()
    load_planner(MISSION, lambda _planner: None, rehearsed=True)
    (rehearsed,), flying = made
    assert list(rehearsed.uav) == [0, 1, 2]
    assert [*rehearsed.position_m] == [(entry.start_x_m, entry.start_y_m) for entry in MISSION.roster]
    assert [*rehearsed.target_m] == [(entry.target_x_m, entry.target_y_m) for entry in MISSION.roster]
    assert flying == []


def test_who_looks_on_lets_a_burst_gather(monkeypatch: pytest.MonkeyPatch) -> None:
    """One batch has the first item and those of the settling time; an empty inbox does not settle."""
    inbox: Inbox[int] = Inbox()
    monkeypatch.setattr("processes.runtime.inbox.time.sleep", lambda _: inbox.put(2))
    assert inbox.wait(0, settle_s=0.01) == []
    inbox.put(1)
    assert inbox.wait(0) == [1]
    inbox.put(1)
    assert inbox.wait(0, settle_s=0.01) == [1, 2]


@pytest.mark.parametrize(
    ("words", "router"),
    [
        ("run --operate tcp/router:7447 --uavs x", "tcp/router:7447"),
        ("run --operate=tcp/router:7447 --planner=nonsense", "tcp/router:7447"),
        ("run --operate", None),
        ("run --operate nowhere", None),
        ("join tcp/router:7447 --uavs 0", None),
    ],
)
def test_an_operator_gives_up_where_it_would_have_operated(words: str, router: str | None) -> None:
    """A command line with `--operate` names the router, however wrong the rest is; other commands name none."""
    assert operated_router(words.split()) == router
    assert word_after("--certs", [*words.split(), "--certs=a=b"]) == "a=b"


def test_the_gate_counts_tells_and_drops() -> None:
    """The gate rejects undecodable messages and, once there is a mission, impossible ones; the first mission counts."""
    told: list[str] = []
    gate, flown = Gate(told.append), mission_message(MISSION, time.time_ns(), "m")
    fix = builders.fix("mallory", 0, sent_ns=flown.epoch_ns)
    heard = Heard(Keys("m").of(fix), encode(fix))
    assert gate.admit(Heard(heard.key, b"\xff")) is None
    assert gate.admit(heard) == fix
    gate.know(flown)
    gate.know(msgspec.structs.replace(flown, roster=[msgspec.structs.replace(MISSION.roster[0], uav="mallory")]))
    assert gate.admit(heard) is None
    assert len(told) == 2
    assert "no UAV mallory in the roster" in told[1]


def test_peers_remember_so_many_tokens_and_no_more() -> None:
    """A flood of tokens of unknown ids fills no memory, and the vanishing of a real UAV still shows."""
    peers = Peers()
    for number in range(MAX_TOKENS - 1):
        peers.take(Token(f"x{number}", "1", True), 0)
    for instance in ("1", "2"):  # the second one is a token too many
        peers.take(Token("u001", instance, True), 0)
    peers.take(Token("u001", "1", False), 0)
    assert peers.gone(CHECK_AFTER_NS) == ["u001"]


def test_peers_forget_tokens_that_have_gone() -> None:
    """Many instances, one after the other, leave room for the next."""
    peers = Peers()
    for number in range(MAX_TOKENS + 1):
        for alive in (True, False):
            peers.take(Token("u001", f"{number}", alive), 0)
    peers.take(Token("u001", "next", True), 0)
    peers.take(Token("u001", "another", False), 0)
    assert peers.gone(CHECK_AFTER_NS) == []


def test_clock_follows_the_wall_and_a_fault() -> None:
    """The offset is from the true time, however often a fault sets it."""
    clock = MissionClock()
    assert abs(clock.now_ns() - time.time_ns()) < 50_000_000
    for _ in range(2):
        clock.set_off(3_600_000_000_000, 0.0)
    assert abs(clock.now_ns() - time.time_ns() - 3_600_000_000_000) < 50_000_000


def test_state_survives_and_is_locked(tmp_path: Path) -> None:
    """A second process for the same UAV fails while the first is alive."""
    entry = MISSION.roster[0]
    create_state(tmp_path, entry)
    state = UavState(tmp_path, entry.uav)
    assert state.promise == Promise(waypoint_x_m=entry.start_x_m, waypoint_y_m=entry.start_y_m)
    promise = Promise(slot=7, term=3, head="u" * 32, waypoint_x_m=0.1 + 0.2, waypoint_y_m=-1e-300)
    airframe = Airframe(x_m=0.1 + 0.2, y_m=-1e-300, energy_j=1.0)
    for slot in (6, 7):
        state.write(msgspec.structs.replace(promise, slot=slot), airframe)
    with pytest.raises(InputError, match="no other process flies"):
        UavState(tmp_path, entry.uav)
    del state
    again = _reopened(tmp_path, entry.uav)
    assert (again.promise, again.airframe) == (promise, airframe)


def _reopened(folder: Path, uav: str) -> UavState:
    """Return the state as another process would find it: a copy of its files, so without the lock."""
    other = folder / "copy"
    other.mkdir()
    for file in folder.glob(f"{uav}.*"):
        (other / file.name).write_bytes(file.read_bytes())
    return UavState(other, uav)


def test_a_missing_or_torn_promise_is_a_lost_memory(tmp_path: Path) -> None:
    """Such a UAV must not grant, so it must not get a fresh promise either."""
    first, second, _ = MISSION.roster
    create_state(tmp_path, first)
    create_state(tmp_path, second)
    promise_path(tmp_path, first.uav).unlink()
    promise_path(tmp_path, second.uav).write_bytes(b'{"slot":')
    states = [UavState(tmp_path, entry.uav) for entry in (first, second)]
    assert [state.promise for state in states] == [None, None]
    states[0].write(None, states[0].airframe)
    assert not promise_path(tmp_path, first.uav).exists()


def test_a_torn_airframe_is_refused_by_name(tmp_path: Path) -> None:
    """Without an airframe the position of the vehicle is unknown."""
    create_state(tmp_path, MISSION.roster[0])
    (tmp_path / "u001.airframe").write_bytes(b'{"x_m":')
    with pytest.raises(InputError, match=r"state file = .*: must be the record of an airframe"):
        UavState(tmp_path, "u001")


def test_peers_believe_a_vanished_token_only_after_a_moment() -> None:
    """A restarted process cancels the check; a second instance keeps a UAV alive."""
    peers = Peers()
    for instance in ("1", "2"):
        peers.take(Token("u001", instance, True), 0)
    peers.take(Token("u001", "1", False), 0)
    assert peers.next_ns is None
    peers.take(Token("u001", "2", False), 10)
    assert peers.next_ns == 10 + CHECK_AFTER_NS
    assert peers.gone(9 + CHECK_AFTER_NS) == []
    assert peers.gone(10 + CHECK_AFTER_NS) == ["u001"]
    assert peers.gone(11 + CHECK_AFTER_NS) == []
    peers.take(Token("u001", "2", False), 20)
    peers.take(Token("u001", "3", True), 21)
    assert peers.gone(1 << 60) == []


def test_postbox_delays_duplicates_and_cuts() -> None:
    """The link model delivers a message now, later, twice or never."""
    box = Postbox(LinkEmulator(MISSION, "u001"))
    assert box.arrive(REPORT, 0, 0.0)
    faults = LocalFaults(MISSION, "u001", box.links, MissionClock())
    faults.apply("link u002>u001 delay 5 duplicate 1 @0s")
    assert not box.arrive(REPORT, 100, 1.0)
    assert box.next_ns == 5_000_100
    assert box.take_due(5_000_099) is None
    assert [box.take_due(5_000_100) for _ in range(3)] == [REPORT, REPORT, None]
    faults.apply("partition u002|u001,u003 @2s for 1s")
    assert not box.arrive(REPORT, 0, 2.5)
    assert box.next_ns is None


def test_postbox_hands_out_both_copies_of_what_comes_twice() -> None:
    """The first copy comes at once, the second at the same time."""
    box = Postbox(LinkEmulator(msgspec.structs.replace(MISSION, link=[Link(duplicate=1.0)]), "u001"))
    assert box.arrive(REPORT, 7, 0.0)
    assert [box.take_due(7) for _ in range(2)] == [REPORT, None]


def test_postbox_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """The postbox bounds its postponed messages and its measurements of them."""
    monkeypatch.setattr("processes.bus.subscriptions.MAX_POSTPONED", 4)
    monkeypatch.setattr("processes.bus.subscriptions.MAX_MEASURED", 2)
    box = Postbox(LinkEmulator(msgspec.structs.replace(MISSION, link=[Link(delay_ms=1)]), "u001"))
    for _ in range(9):
        box.arrive(REPORT, 0, 0.0)
    assert [box.take_due(1_000_000) for _ in range(5)] == [REPORT] * 4 + [None]
    assert box.delay_error is not None
    assert box.delay_error.messages == 2


def test_postbox_tells_the_tail_of_its_lateness() -> None:
    """The 99th percentile of a hundred messages is the ninety-ninth, not the ninetieth."""
    box = Postbox(LinkEmulator(msgspec.structs.replace(MISSION, link=[Link(delay_ms=1)]), "u001"))
    for late in range(101):
        box.arrive(REPORT, 0, 0.0)
        assert box.take_due((1 + late) * 1_000_000) == REPORT
    assert box.delay_error == DelayError(messages=101, p50_ms=50.0, p99_ms=99.0, max_ms=100.0)


def test_postbox_knows_how_late_it_handed_out() -> None:
    """The lateness is relative to the link model, over all postponed messages; None without any."""
    delayed = msgspec.structs.replace(MISSION, link=[Link(delay_ms=5)])
    box = Postbox(LinkEmulator(delayed, "u001"))
    assert box.delay_error is None
    for at_ms, late_ms in enumerate((3.0, 0.5, 1.0)):
        box.arrive(REPORT, at_ms * 100_000_000, 0.0)
        assert box.take_due(round((at_ms * 100 + 5 + late_ms) * 1e6)) == REPORT
    assert box.delay_error == DelayError(messages=3, p50_ms=1.0, p99_ms=3.0, max_ms=3.0)


def test_partition_ends_when_healed_and_is_one_way_when_said() -> None:
    """A one-way partition cuts only the receiver's side."""
    links = LinkEmulator(MISSION, "u001")
    for cut in cut_pair(["u001"], ["u002"], 0.0, 10.0, one_way=True):
        links.add_cut(cut)
    assert not links.is_cut("u002", 1.0)
    LocalFaults(MISSION, "u001", links, MissionClock()).apply("partition u002>u001 @0s")
    assert links.is_cut("u002", 1.0)
    LocalFaults(MISSION, "u001", links, MissionClock()).apply("heal @1s")
    assert not links.is_cut("u002", 1.0)


def test_faults_about_others_and_nonsense_change_nothing() -> None:
    """Every UAV gets the operator's events about all UAVs."""
    faults = LocalFaults(MISSION, "u001", LinkEmulator(MISSION, "u001"), MissionClock())
    assert faults.apply("gps u002 white @1s") == []
    assert faults.apply("nonsense") == []
    assert faults.apply("gps u001 white @1s") == [Disturbed(ChangeGps("u001", "white", at_s=1.0))]
    assert faults.apply("clock u001 offset 5 @1s") == [Tick()]


def test_slow_planner_is_slow_for_a_while() -> None:
    """A slow planner returns the same plan, later."""

    class Still:
        def plan(self, request: PlanRequest) -> Plan:
            del request
            return Plan([], "no-qp-needed")

    slow = SlowPlanner(Still())
    request = PlanRequest(slot=0, uav=[], position_m=[], target_m=[], r_m=[])
    slow.slow_down(0.05, 60.0)
    begin_s = time.monotonic()
    slow.plan(request)
    assert time.monotonic() - begin_s >= 0.05


def test_malformed_bytes_are_told_at_powers_of_two() -> None:
    """One counter covers a flood of keys."""
    malformed = Malformed()
    told = [malformed.count(MessageError("k", "bad")) for _ in range(9)]
    assert [text is not None for text in told] == [n in {1, 2, 4, 8} for n in range(1, 10)]
    flood = [malformed.count(MessageError(f"key{number}", "bad")) for number in range(2 * MAX_COUNTED_KEYS)]
    worth = [text for text in flood if text is not None]
    others = [text for text in worth if text.startswith(tuple(f"{2**power} on others" for power in range(11)))]
    assert len(worth) - len(others) == MAX_COUNTED_KEYS - 1, "with the key above, so many are counted by themselves"
    assert len(others) == 10


def test_addresses() -> None:
    """A process can listen on a free address; the error names any other."""
    check_endpoint(free_endpoint())
    assert connect_endpoint("tcp/0.0.0.0:7447") == "tcp/127.0.0.1:7447"
    for bad in ("foo", "tcp/localhost", "tcp/localhost:0", "tcp/localhost:99999", "udp/localhost:5"):
        with pytest.raises(InputError, match="--listen"):
            check_endpoint(bad)


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_a_router_that_does_not_answer_is_said_to_be_absent_or_silent(protocol: str) -> None:
    """A plain TCP connection distinguishes an unused address from one of another program."""
    with socket.create_server(("127.0.0.1", 0)) as somebody:
        endpoint = f"{protocol}/127.0.0.1:{somebody.getsockname()[1]}"
        assert unreachable_router(endpoint) == f"a router at {endpoint} ({NO_ANSWER[protocol]})"
    assert unreachable_router(endpoint) == f"a router at {endpoint} (connection refused)"


def test_a_part_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    """The recorder holds a lock on its part."""
    part = tmp_path / "live.mcap.part"
    part.write_bytes(b"\x89MCAP0\r\n")
    with part.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert salvage_parts(tmp_path) == []
        assert part.exists()
    assert salvage_parts(tmp_path) == []
    assert (tmp_path / "live.mcap.part.torn").exists()


def test_a_run_that_starts_slowly_keeps_its_part(tmp_path: Path) -> None:
    """Another run in the same folder takes an empty part for a killed run's only if nobody holds it."""
    part = tmp_path / "slow.mcap.part"
    with Output(tmp_path / "slow.mcap", force=False):
        os.utime(part, (0, 0))
        assert salvage_parts(tmp_path) == []
        assert part.exists()
    part.touch()
    assert salvage_parts(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_two_runs_cannot_claim_one_name(tmp_path: Path) -> None:
    """A run creates its part exclusively."""
    with Output(tmp_path / "a.mcap", force=False), pytest.raises(InputError, match="no other run"):
        Output(tmp_path / "a.mcap", force=True)
    assert list(tmp_path.iterdir()) == []


def test_postbox_plays_a_measured_network() -> None:
    """What is sent with the probes of a file is due exactly when they arrived, also in a stall."""
    base = load_mission("scenarios/measured_5g.toml")
    link = msgspec.structs.replace(base.link[0], trace_offset="none")
    box = Postbox(LinkEmulator(msgspec.structs.replace(MISSION, link=[link], trace=base.trace), "u001"))
    rows = unpack(base.trace[0])
    arrivals_us = sorted(at + delay for at, delay in zip(rows.at_us, rows.delay_us, strict=True))
    for at_us in rows.at_us:
        assert not box.arrive(REPORT, 1000 * at_us, at_us / 1e6)
    delivered_us = []
    while (due_ns := box.next_ns) is not None:
        assert box.take_due(due_ns) is not None
        delivered_us.append(due_ns // 1000)
    assert delivered_us == arrivals_us
    assert box.links.log.told()[REPORT.head].delay_ms == [us / 1000 for us in quantiles(rows.delay_us)]
