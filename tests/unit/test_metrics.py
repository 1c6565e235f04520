"""Metrics by their definitions, on missions that are small enough to compute by hand."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from edc_swarm.analysis.columns import columns_of
from edc_swarm.analysis.energy_bill import energy_bills
from edc_swarm.analysis.head_terms import HeadTerm
from edc_swarm.analysis.living import SILENT_SLOTS, living_at_end
from edc_swarm.analysis.metrics import Metrics, Quantiles, compute_metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.analysis.timings import Timing, Timings, content_hash, load_timings
from edc_swarm.analysis.tracks import tracks_of
from edc_swarm.emulation.energy import propulsion_power_w
from edc_swarm.errors import RecordingError
from edc_swarm.mission.power_models import EnergyModel
from edc_swarm.mission.prospect import COMPLETED
from edc_swarm.mission.roles import OPERATOR
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from tests.unit.synthetic import EPOCH_NS, SLOT_NS, change, flight, parallel, recorded, straight, whole

PROMISED = {
    "heads",
    "plan_ms",
    "makespan_s",
    "makespan_ratio",
    "energy_straight_j",
    "gaps",
    "duration_s",
    "failover_slots",
    "min_true_distance_m",
    "completed",
    "not_home",
    "uavs",
    "energy_compute_j",
    "slots_held",
    "ticks_late_pct",
    "extra_distance_mean_pct",
    "true_collisions",
    "slots",
    "min_disc_gap_m",
    "extra_distance_pct",
    "straight_m",
    "energy_propulsion_j",
    "path_m",
    "potential_collisions",
    "slots_missed",
    "arrived",
    "messages",
    "fix_to_command_ms",
}


@pytest.fixture
def messages() -> list[Message]:
    """Return the messages of three UAVs 12 m apart that fly 16 m north in slots 1 to 8."""
    return flight(parallel())


def send_far(messages: list[Message], uavs: set[str]) -> None:
    """Move the targets of some UAVs far beyond the ends of their flights."""
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    roster = [msgspec.structs.replace(e, target_y_m=99.0) if e.uav in uavs else e for e in mission.roster]
    messages[0] = msgspec.structs.replace(mission, roster=roster)


def metrics(messages: list[Message]) -> Metrics:
    """Return the metrics of the recording of `messages`."""
    return compute_metrics(recorded(messages))


def test_json_holds_every_promised_name(messages: list[Message]) -> None:
    """The names of metrics are a promise to users."""
    printed = msgspec.json.decode(msgspec.json.encode(metrics(messages)))
    assert printed.keys() >= PROMISED
    assert printed["plan_ms"].keys() == {"p50", "p99", "max"}
    assert printed["heads"] == [{"term": 1, "head": "u0", "first_slot": 0, "last_slot": 8}]


def test_a_straight_mission(messages: list[Message]) -> None:
    """All metrics that follow from the geometry have their values."""
    m = metrics(messages)
    assert (m.uavs, m.slots, m.duration_s) == (3, 9, 4.5)
    assert (m.completed, m.arrived, m.not_living) == (True, 3, [])
    assert (m.potential_collisions, m.true_collisions) == (0, 0)
    assert (m.min_disc_gap_m, m.min_true_distance_m) == (pytest.approx(2.0), pytest.approx(12.0))
    assert (m.path_m, m.straight_m) == (pytest.approx(48.0), pytest.approx(48.0))
    assert m.extra_distance_pct == pytest.approx(0.0, abs=1e-9)
    assert m.makespan_s == pytest.approx(8 * 0.5)
    assert m.makespan_ratio == pytest.approx(4.0 / (16.0 / 5.0))
    assert (m.slots_held, m.slots_missed, m.gaps, m.ticks_late_pct) == (0, 0, 0, 0.0)
    assert m.messages == len(messages)
    assert m.plan_ms == Quantiles(6.0, m.plan_ms.p99, 10.0)
    assert m.plan_ms.p99 == pytest.approx(9.92)


def test_faults_that_came_to_nothing() -> None:
    """Faults without a target and faults after the end are listed, injected ones are not."""
    messages = flight(parallel(), fault=["kill head @0", "heal @8", "heal @9", "kill u1 @20s"])
    messages.append(Event(source="operator", slot=0, kind="fault-without-target", detail="kill head @0s"))
    assert metrics(messages).faults_undone == ["kill head @0s", "heal @4.5s", "kill u1 @20s"]
    assert ("faults not done", "kill head @0s; heal @4.5s; kill u1 @20s") in metric_rows(metrics(messages))
    assert "faults not done" not in dict(metric_rows(metrics(flight(parallel()))))


def test_energy_is_the_power_curve_over_the_flight(messages: list[Message]) -> None:
    """The energy is that of 4 m/s for 4 s each, compared with the same distance at 5 m/s."""
    m, model = metrics(messages), EnergyModel()
    assert m.energy_propulsion_j == pytest.approx(3 * 4.0 * propulsion_power_w(4.0, model))
    assert m.energy_straight_j == pytest.approx(48.0 / 5.0 * propulsion_power_w(5.0, model))
    assert m.energy_compute_j == pytest.approx(5.0 * sum(2.0 + slot for slot in range(9)) / 1e3)


def test_guards_are_flown_around() -> None:
    """A UAV hovers within the guards, and is faster between them."""
    m = metrics(flight(parallel(), guard_s=0.05))
    model = EnergyModel()
    slot_j = 0.4 * propulsion_power_w(5.0, model) + 0.1 * propulsion_power_w(0.0, model)
    assert m.energy_propulsion_j == pytest.approx(24 * slot_j)
    assert m.makespan_s == pytest.approx(8 * 0.5 - 0.05)


def test_a_detour_is_extra_distance() -> None:
    """Extra distance is measured in total and as the mean over the UAVs whose start is not their target."""
    detour = [(0.0, 0.0), (0.0, 2.0), (2.0, 2.0), (2.0, 0.0)]
    paths = [detour, straight((50, 0), (56, 0), 3), [(100.0, 0.0)] * 2]
    m = metrics(flight(paths))
    assert m.extra_distance_pct == pytest.approx(100 * (12 / 8 - 1))
    assert m.extra_distance_mean_pct == pytest.approx((200 + 0) / 2)


def test_collisions_are_pairs_at_any_instant() -> None:
    """Two UAVs that swap places within one slot overlap once."""
    paths = [straight((0, 0), (12, 0), 1), straight((12, 0.4), (0, 0.4), 1), straight((90, 0), (91, 0), 1)]
    m = metrics(flight(paths, v_max_mps=30.0))
    assert (m.potential_collisions, m.true_collisions) == (1, 1)
    assert m.min_disc_gap_m == pytest.approx(0.4 - 10)
    assert m.min_true_distance_m == pytest.approx(0.4)


def test_makespan_begins_with_the_first_command_and_ends_for_good() -> None:
    """Time without a head before the first command does not count; time after leaving the target does."""
    paths = [straight((0, 0), (4, 0), 2), [(50, 0), (50, 0), (50, 2), (50, 2), (50, 0)]]
    messages = flight(paths)
    for slot in (0, 1):
        messages[:] = [m for m in messages if not (isinstance(m, Command) and m.slot == slot + 1)]
    assert metrics(messages).makespan_s is None, "the record lacks commands"
    m = metrics(whole(messages))
    assert m.makespan_s == pytest.approx((4 + 1 - 3) * 0.5)
    assert m.makespan_ratio == pytest.approx((4 + 1 - 3) * 0.5 * 5.0 / 4.0)


def test_an_unfinished_mission_has_no_makespan(messages: list[Message]) -> None:
    """A living UAV that has not arrived leaves the makespan undefined."""
    send_far(messages, {"u2"})
    m = metrics(messages)
    assert (m.completed, m.arrived, m.makespan_s, m.makespan_ratio) == (False, 2, None, None)


def test_a_mission_is_completed_when_everybody_is_home(messages: list[Message]) -> None:
    """A killed UAV is named with the reason; the living ones still have a makespan."""
    send_far(messages, {"u2"})
    messages.append(Event(source="operator", slot=8, kind="fault", detail="kill u2 @8"))
    m = metrics(messages)
    assert (m.completed, m.arrived, m.not_living) == (False, 2, ["u2"])
    assert [(who.uav, who.cause, who.slot) for who in m.not_home] == [("u2", "killed", 8)]
    assert m.makespan_s == pytest.approx(4.0)
    rows = dict(metric_rows(m))
    assert rows["not home"] == "u2: dead since slot 8 (killed by a fault), 83.00 m from its target"
    assert rows["makespan"] == "4.00 s of the living UAVs, 1.25 times the least"


def test_the_dead_cost_and_hold_nothing(messages: list[Message]) -> None:
    """From its last fix on, a killed UAV costs no energy, holds no slot, and has no extra distance."""
    send_far(messages, {"u2"})
    messages[:] = [m for m in messages if not (isinstance(m, Fix | Truth) and m.uav == "u2" and m.slot > 3)]
    messages.append(Event(source="operator", slot=4, kind="fault", detail="kill u2 @4"))
    messages = whole(messages)
    m, columns = metrics(messages), columns_of(recorded(messages))
    assert (m.completed, m.not_living, m.slots_held) == (False, ["u2"], 0)
    assert columns.alive.sum(axis=0).tolist() == [9, 9, 4]
    assert m.energy_propulsion_j == pytest.approx((8 + 8 + 3) * 0.5 * propulsion_power_w(4.0, EnergyModel()))
    assert (m.path_m, m.straight_m) == (pytest.approx(16.0 + 16.0 + 6.0), pytest.approx(16.0 + 16.0 + 99.0))
    assert (m.extra_distance_pct, m.extra_distance_mean_pct) == (pytest.approx(0.0), pytest.approx(0.0))
    assert m.makespan_ratio == pytest.approx(4.0 / (16.0 / 5.0))


def test_the_table_compares_only_who_is_home(messages: list[Message]) -> None:
    """Without a UAV at home there is no comparison and no makespan; with some, the table names them."""
    rows = dict(metric_rows(metrics(messages)))
    assert (rows["way flown"], rows["makespan"]) == (
        "48.0 m, 0.00 % more than straight",
        "4.00 s, 1.25 times the least",
    )
    send_far(messages, {"u1", "u2"})
    rows = dict(metric_rows(metrics(messages)))
    assert (rows["way flown"], rows["makespan"]) == ("48.0 m; by those at their targets 0.00 % more than straight", "-")
    send_far(messages, {"u0", "u1", "u2"})
    assert dict(metric_rows(metrics(messages)))["way flown"] == "48.0 m"


def test_held_and_missed_slots() -> None:
    """A held UAV-slot is away from the target without a command; a missed slot has no command at all."""
    paths = [[*path[:4], path[3], *path[4:]] for path in parallel(2)]
    messages = flight(paths)
    messages = [m for m in messages if not (isinstance(m, Command) and m.slot == 4)]
    change(messages, {"slot": 4}, Fix, executing=False, command_term=-1, command_seq=-1)
    m, torn = metrics(whole(messages)), metrics(messages)
    assert (m.slots_held, m.slots_missed, m.gaps) == (2, 1, 0)
    assert (torn.slots_held, torn.slots_missed, torn.gaps) == (None, None, 2)


def test_a_mission_without_any_command_has_no_commanded_slots() -> None:
    """Where nobody was ever commanded, nothing was measured: no held or missed slots, and no energy, is not 0."""
    said = flight([[path[0]] * 9 for path in parallel()])
    change(said, {}, Fix, executing=False, command_term=-1, command_seq=-1)
    idle = whole(m for m in said if not isinstance(m, Command | Report))
    send_far(idle, {"u0", "u1", "u2"})
    m = metrics(idle)
    assert (m.slots, m.path_m, m.arrived) == (9, 0.0, 0)
    assert (m.slots_held, m.slots_held_by, m.slots_missed, m.energy_propulsion_j) == (None,) * 4
    rows = dict(metric_rows(m))
    assert (rows["slots"], rows["slots held"]) == ("9 (4.5 s), - without commands", "-")


def test_who_was_never_heard_does_not_live_in_the_shortest_record_either() -> None:
    """Three slots are no time to fall silent, and yet a UAV without any fix has shown no life."""
    said = [m for m in flight(parallel(steps=2)) if not (isinstance(m, Fix | Truth) and m.uav == "u2")]
    recording = recorded(said)
    assert recording.fixes[-1].slot == SILENT_SLOTS - 1
    assert living_at_end(recording, tracks_of(recording)).tolist() == [True, True, False]


def test_slots_count_until_completion(messages: list[Message]) -> None:
    """Slots without commands after completion are not missed; an unfinished mission counts to its last slot."""
    last = whole(m for m in messages if not (isinstance(m, Command) and m.slot == 8))
    assert metrics(last).slots_missed == 1
    change(last, {"slot": 8}, Fix, waypoint_y_m=14.0, executing=False)
    assert (metrics(last).completed, metrics(last).slots_missed, metrics(last).slots_held) == (False, 1, 3)
    still = [*parallel()[:2], [*parallel()[2], *[parallel()[2][-1]] * 4]]
    rest = whole(m for m in flight(still) if not (isinstance(m, Command) and m.slot in {9, 10, 11}))
    assert (metrics(rest).slots, metrics(rest).slots_missed) == (13, 0)


def test_latency_is_counted_from_the_fix_that_the_head_used(messages: list[Message]) -> None:
    """The latency counts from the fix in the command; a command without one has no latency."""
    fix = next(m for m in messages if isinstance(m, Fix) and m.uav == "u1" and m.slot == 3)
    messages.append(msgspec.structs.replace(fix, sent_ns=fix.sent_ns + 4_000_000, seq=77))
    assert set(np.round(columns_of(recorded(messages)).fix_to_command_ms, 6)) == {10.0}
    change(messages, {"uav": "u1", "slot": 4}, Command, fix_seq=77)
    assert set(np.round(columns_of(recorded(messages)).fix_to_command_ms, 6)) == {6.0, 10.0}
    older = [msgspec.structs.replace(m, fix_seq=-1) if isinstance(m, Command) else m for m in messages]
    assert metrics(older).fix_to_command_ms == Quantiles(None, None, None)


@pytest.mark.parametrize("again", [False, True])
def test_a_command_that_answers_no_fix_has_no_latency(messages: list[Message], again: bool) -> None:
    """A fix that was sent after the command cannot be its input."""
    change(messages, {"uav": "u1", "slot": 3}, Fix, sent_ns=EPOCH_NS + 4 * SLOT_NS)
    fix = next(m for m in messages if isinstance(m, Fix) and m.uav == "u1" and m.slot == 3)
    messages += [msgspec.structs.replace(fix, sent_ns=fix.sent_ns + 1)] * again
    columns = columns_of(recorded(messages))
    assert columns.command_slot.tolist() == sorted([*range(1, 10)] * 2 + [1, 2, 3, 5, 6, 7, 8, 9])
    assert set(np.round(columns.fix_to_command_ms, 6)) == {10.0}


def test_heads_and_failover() -> None:
    """Each head has its slots, a change of heads its slots without commands; a claim alone makes no head."""
    messages = flight(parallel())
    for slot in range(9):
        if slot in (4, 5):
            messages = [m for m in messages if not (isinstance(m, Report) and m.slot == slot)]
        elif slot > 5:
            change(messages, {"slot": slot}, Report, head="u1", instance="i1", term=3)
    messages = whole(messages)
    m = metrics(messages)
    assert m.heads == [HeadTerm(1, "u0", 0, 3), HeadTerm(3, "u1", 6, 8)]
    assert m.failover_slots == [2]
    messages[1:] = messages[:0:-1]
    assert metrics(messages).heads == m.heads
    change(messages, {"slot": 6}, Report, slot=4)
    assert metrics(messages).failover_slots == [0]
    change(messages, {"slot": 4}, Report, slot=6)
    boast = next(m for m in messages if isinstance(m, Report))
    messages.append(msgspec.structs.replace(boast, head="u2", term=4, grants=["u2"], quorum=1))
    before = metrics(messages)
    messages.append(msgspec.structs.replace(boast, head="u2", term=5, status="no-quorum", plan_ms=1e6))
    assert before.heads == metrics(messages).heads == m.heads
    assert before.plan_ms == metrics(messages).plan_ms


def test_what_is_recorded_twice_is_no_gap(messages: list[Message]) -> None:
    """A duplicate belongs to G5, and nothing is missing."""
    assert metrics([*messages, messages[-1]]).gaps == 0


def test_late_ticks_are_counted_per_life() -> None:
    """`late_ticks` starts at 0 with every instance."""
    messages = flight(parallel(1))
    change(messages, {"slot": 3}, Fix, late_ticks=1)
    change(messages, {"slot": 8}, Fix, late_ticks=2, instance="i0b")
    assert metrics(whole(messages)).ticks_late_pct == pytest.approx(100 * 3 / 9)
    assert metrics(messages).ticks_late_pct is None, "fixes of the second life may be missing"


def test_timings_replace_recorded_plan_times(tmp_path: Path, messages: list[Message]) -> None:
    """Timings replace the plan times, which a simulated recording lacks."""
    (tmp_path / "run.mcap").write_bytes(b"a recording")
    plans = [Timing(slot, 4.0 + 2 * (slot % 2), solve_ms=1.0) for slot in range(9)]
    saved = Timings(content_hash(tmp_path / "run.mcap"), plans)
    (tmp_path / "run.timings.json").write_bytes(msgspec.json.encode(saved))
    timings = load_timings(tmp_path / "run.mcap")
    assert timings == plans
    m = compute_metrics(recorded(messages), timings)
    assert (m.plan_ms.p50, m.plan_ms.max) == (4.0, 6.0)
    assert m.energy_compute_j == pytest.approx(5.0 * 44.0 / 1e3)
    assert compute_metrics(recorded(messages), timings[1:]).energy_compute_j is None


@pytest.mark.parametrize(
    "saved", [b'{"recording":"00","plans":[{"slot":0,"plan_ms":4.0}]}', b'[{"slot":0,"plan_ms":4.0}]']
)
def test_timings_of_another_recording_are_refused(tmp_path: Path, saved: bytes) -> None:
    """The file name alone does not connect timings to a recording."""
    (tmp_path / "run.mcap").write_bytes(b"a recording")
    (tmp_path / "run.timings.json").write_bytes(saved)
    told: list[str] = []
    assert load_timings(tmp_path / "run.mcap", told.append) == []
    assert len(told) == 1
    assert "plan times are unknown" in told[0]


def test_plan_times_that_nobody_measured_are_unknown(messages: list[Message]) -> None:
    """A plan time of 0 ms, as in simulated recordings, means unknown."""
    change(messages, {}, Report, plan_ms=0.0)
    recording = recorded(messages)
    m = compute_metrics(recording)
    assert (m.plan_ms, m.energy_compute_j) == (Quantiles(None, None, None), None)
    assert [bill.compute_j for bill in energy_bills(recording)] == [None, 0.0, 0.0]


def test_a_real_run_has_plan_times_of_its_own(messages: list[Message]) -> None:
    """Timings beside a real recording belong to a simulation with the same file name."""
    recording = recorded(messages)
    recording.run["clock"] = "wall"
    assert compute_metrics(recording, [Timing(0, 400.0)]).plan_ms.max == 10.0
    computed_j = [bill.compute_j or 0.0 for bill in energy_bills(recording, [Timing(0, 400.0)])]
    assert sum(computed_j) == pytest.approx(0.27)


def test_timings_are_optional_and_must_be_timings(tmp_path: Path) -> None:
    """A missing file is accepted, an invalid one is reported in one line."""
    assert load_timings(tmp_path / "run.mcap") == []
    (tmp_path / "run.timings.json").write_bytes(b'{"slot":1}')
    with pytest.raises(RecordingError, match="holds no timings"):
        load_timings(tmp_path / "run.mcap")


def test_missing_truth_leaves_true_metrics_open(messages: list[Message]) -> None:
    """Without truths there is no true distance, and all other metrics stay defined."""
    untrue: list[Message] = [m for m in messages if not isinstance(m, Truth)]
    m = metrics(untrue)
    assert (m.min_true_distance_m, m.true_collisions, m.completed) == (None, None, True)
    assert len(columns_of(recorded(untrue)).time_s) == 9


def test_a_mission_without_fixes_or_of_one_uav_has_metrics() -> None:
    """Undefined metrics are None, never an exception."""
    nothing = metrics(flight(parallel())[:1])
    assert (nothing.slots, nothing.completed, nothing.makespan_s, nothing.plan_ms.p50) == (None,) * 4
    assert (nothing.energy_propulsion_j, nothing.path_m, nothing.ticks_late_pct) == (None, None, None)
    assert (nothing.slots_missed, nothing.slots_held, nothing.gaps, nothing.fetched) == (None, None, None, None)
    assert (nothing.potential_collisions, nothing.true_collisions) == (None, None)
    rows = dict(metric_rows(nothing))
    assert (rows["collisions"], rows["way flown"], rows["late ticks"]) == ("- potential, - true", "-", "-")
    assert (rows["slots"], rows["messages"]) == ("-, - without commands", "1, - gaps")
    assert (rows["heads"], rows["energy"].split(",")[0]) == ("none recorded", "-")
    parked = flight([[(0.0, 0.0)] * 2])
    still = metrics(parked)
    assert (still.completed, still.extra_distance_pct, still.extra_distance_mean_pct) == (True, None, None)
    assert (still.makespan_s, still.makespan_ratio) == (0.0, None)
    assert metrics([m for m in parked if not isinstance(m, Command)]).makespan_s is None
    alone = metrics(flight(parallel(1)))
    assert (alone.completed, alone.min_disc_gap_m, alone.min_true_distance_m) == (True, None, None)


@pytest.mark.parametrize(("landed", "completed"), [([], None), (["u1"], False)])
def test_a_mission_may_be_over_without_a_uav_that_landed_elsewhere(
    messages: list[Message], landed: list[str], completed: bool | None
) -> None:
    """The process of `u1` falls silent, which no fault tells of, and the operator ends the mission as complete.

    Its fixes may be missing from the record then, unless a plan says that it has landed.
    """
    said: list[Message] = []
    for message in messages:
        match message:
            case Fix(uav="u1") | Truth(uav="u1") if message.slot > 2:
                continue
            case Event(source="u1"):
                continue
            case Command(uav="u1") if message.slot > 3:
                continue
            case Report() if message.slot > 2:
                others = [uav for uav in message.heard if uav != "u1"]
                said.append(
                    msgspec.structs.replace(
                        message, heard=others, unheard=["u1"], grants=["u0", "u2"], landed=landed * (message.slot > 7)
                    )
                )
            case _:
                said.append(message)
    said.append(Event(source=OPERATOR, instance="op", sent_ns=EPOCH_NS, slot=8, kind=EventKind.END, detail=COMPLETED))
    metrics = compute_metrics(recorded(said))
    assert [(who.uav, who.cause) for who in metrics.not_home] == [("u1", "silent")]
    assert metrics.completed is completed
