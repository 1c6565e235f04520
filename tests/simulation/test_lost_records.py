"""What a recording lacks accuses nobody: no window of time that is missing breaks anything but G5."""

from __future__ import annotations

from functools import cache

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation

FAULTS = ["freeze u002 mid-step @6s for 8s", "kill u003 @9s", "restart u003 @11s"]
"""u002 brakes from slot 13 on, and u003 is dead in slots 18 to 21."""


@cache
def said() -> tuple[MissionMessage, list[Message]]:
    """Return a mission of three vehicles with inertia, and its messages."""
    return flown(failsafe="hold", fault=FAULTS, vehicle={"model": "multirotor"})


def flown(**fields: object) -> tuple[MissionMessage, list[Message]]:
    """Simulate a mission of three UAVs, and return it and its messages."""
    common = {"uavs": 3, "seed": 2, "area_m2": 3600.0, "max_slots": 60}
    mission = mission_message(complete_mission(mission_from_dict({**common, **fields})))
    messages: list[Message] = []
    planner = make_planner(mission.planner, mission)
    Simulation(mission, lambda: planner, lambda _key, now, _ns: messages.append(now)).run()
    return mission, messages


def without(first: float, last: float, flight: tuple[MissionMessage, list[Message]] | None = None) -> list[Message]:
    """Return what was said outside of the slots first..last."""
    mission, messages = flight or said()
    begin_ns, end_ns = (mission.epoch_ns + round(slot * mission.slot_ns) for slot in (first, last + 1))
    return [m for m in messages if isinstance(m, MissionMessage) or not begin_ns <= m.sent_ns < end_ns]


def statuses(messages: list[Message]) -> dict[str, str]:
    """Return the verdicts of `check`."""
    return {result.guarantee: result.status for result in check(Recording.from_messages(messages))}


def test_the_whole_record_holds() -> None:
    """The mission keeps every guarantee."""
    assert set(statuses(said()[1]).values()) == {"held"}


@pytest.mark.parametrize(("first", "last"), [(3, 11), (8, 11), (5, 19), (20, 22)])
def test_a_window_that_is_missing_accuses_nobody(first: int, last: int) -> None:
    """A UAV brakes from the step of its newest fix, and u003 may have flown before it died in the window."""
    found = statuses(without(first, last))
    assert found.pop("G5") == "broken"
    assert set(found.values()) == {"not-judged"}


@pytest.mark.parametrize(("seed", "first"), [(2, 6), (5, 10)])
def test_who_was_killed_in_a_window_that_is_missing_need_not_be_where_it_was_before(seed: int, first: int) -> None:
    """u003 flies on for some slots and dies within the window; the others fly through the place that it left."""
    found = statuses(without(first, 17, flown(failsafe="hold", seed=seed, fault=["kill u003 @9s"])))
    assert found.pop("G5") == "broken"
    assert set(found.values()) == {"not-judged"}


@pytest.mark.parametrize("kind", [Fix, Truth])
def test_who_was_killed_and_lacks_all_messages_of_a_kind_accuses_nobody(kind: type[Fix | Truth]) -> None:
    """No number tells that they are missing, but plans rest on its fixes, and truths that no fix explains move."""
    _, messages = flown(failsafe="hold", fault=["kill u003 @9s"])
    found = statuses([m for m in messages if not (isinstance(m, kind) and m.uav == "u003")])
    assert "broken" not in found.values()
    assert (found["G3"], found["G4"], found["G5"]) == ("not-judged", "not-judged", "not-judged")


def test_a_killed_head_of_which_the_record_has_commands_and_no_report_lacks_reports() -> None:
    """The reports of its successor are there."""
    _, messages = flown(failsafe="hold", fault=["kill head @6s"])
    found = statuses([m for m in messages if not (isinstance(m, Report) and m.term == 1)])
    assert (found["G1"], found["G5"]) == ("not-judged", "not-judged")


@pytest.mark.parametrize("instance", ["u003-1", "u003-2"])
def test_a_process_that_nobody_heard_is_missed(instance: str) -> None:
    """By the faults u003 was killed and started again, so it has spoken as two processes."""
    found = statuses([m for m in said()[1] if m.instance != instance])
    assert set(found.values()) == {"not-judged"}


@pytest.mark.parametrize("instance", ["u002-1", "u002-2"])
def test_a_process_that_nobody_heard_is_missed_where_its_memory_was_lost(instance: str) -> None:
    """The fixes of u002-2 tell no place, so nothing tells where u002-1 had flown to."""
    _, messages = flown(seed=5, fault=["restart u002 lose-memory @5s"])
    found = statuses([m for m in messages if m.instance != instance])
    assert set(found.values()) == {"not-judged"}


def test_a_process_that_need_not_have_spoken_is_missed_by_its_grants() -> None:
    """The mission ends 4 s after u003 was started again, so it may have said nothing; but plans rest on its fixes."""
    _, messages = flown(fault=["kill u003 @5s", "restart u003 @6s"], max_slots=20)
    found = statuses([m for m in messages if m.instance != "u003-2"])
    assert set(found.values()) == {"not-judged"}


def test_commands_of_a_process_that_need_not_have_spoken_are_missed() -> None:
    """u001-2 leads term 3, of which the record has no plan; the commands of u001-1 have numbers of their own."""
    faults = ["kill head @3s", "restart u001 @4s", "kill u002 @6s"]
    _, messages = flown(v_max_mps=2.0, fault=faults, max_slots=17)
    assert any(isinstance(m, Report) and m.instance == "u001-2" and m.term == 3 for m in messages)
    found = statuses([m for m in messages if m.instance != "u001-2"])
    assert "broken" not in found.values()
    assert (found["G1"], found["G2"], found["G5"]) == ("not-judged", "not-judged", "not-judged")


@pytest.mark.parametrize("uav", ["u001", "u003"])
def test_commands_of_a_killed_head_that_nobody_flew_are_missed_by_its_report(uav: str) -> None:
    """It was killed just after its first plan, and the claim of its successor discarded the commands."""
    _, messages = flown(fault=["kill head @0.6s"])
    assert statuses(messages)["G5"] == "held"
    lacking = [m for m in messages if not (isinstance(m, Command) and (m.instance, m.uav) == ("u001-1", uav))]
    found = statuses(lacking)
    assert (found["G1"], found["G2"], found["G5"]) == ("not-judged", "not-judged", "not-judged")


def test_the_events_of_a_killed_head_are_missed() -> None:
    """It has taken office before its first plan, and said so."""
    _, messages = flown(fault=["kill head @6s"])
    assert statuses(messages)["G5"] == "held"
    found = statuses([m for m in messages if not (isinstance(m, Event) and m.instance == "u001-1")])
    assert found.pop("G5") == "not-judged"
    assert set(found.values()) == {"held"}


def test_a_process_that_nobody_heard_is_missed_although_its_successor_need_not_have_spoken() -> None:
    """Without the fixes of u003-1 its successor may have landed before 5 s were over, and yet it is heard."""
    _, messages = flown(land_after_s=4.0, fault=["restart u003 @6s"])
    assert statuses(messages)["G5"] == "held"
    found = statuses([m for m in messages if m.instance != "u003-1"])
    assert set(found.values()) == {"not-judged"}


def test_without_a_word_of_the_operator_nobody_knows_what_it_said() -> None:
    """It has told the faults and the end, and has no last word."""
    _, messages = flown(max_slots=20)
    found = statuses([m for m in messages if m.instance != "operator" or isinstance(m, MissionMessage)])
    assert found["G5"] == "not-judged"


def test_the_last_fixes_of_a_killed_process_are_missed() -> None:
    """Plans count on grants that no recorded fix gives: u003 was killed, so its last fixes may be missing."""
    found = statuses([m for m in said()[1] if not (isinstance(m, Fix) and m.uav == "u003" and 15 <= m.slot <= 17)])
    assert (found["G1"], found["G5"]) == ("not-judged", "not-judged")


def test_who_is_restarted_on_the_ground_is_not_missed() -> None:
    """u003 hears nothing and lands after 10 s; a process that comes later says nothing."""
    _, messages = flown(v_max_mps=2.0, fault=["partition u001,u002>u003 @0s", "restart u003 @14s"])
    assert not any(isinstance(m, Fix) and m.instance == "u003-2" for m in messages)
    assert "not-judged" not in statuses(messages).values()


def test_who_lands_after_a_freeze_and_is_killed_then_lacks_no_fix() -> None:
    """It ends with a truth alone, long after its last fix."""
    _, messages = flown(v_max_mps=2.0, land_after_s=4.0, fault=["freeze u003 @5s for 6s", "kill u003 @13s"])
    truths, fixes = ({m.slot for m in messages if isinstance(m, kind) and m.uav == "u003"} for kind in (Truth, Fix))
    assert max(truths) > max(fixes) + 1
    assert "not-judged" not in statuses(messages).values()
