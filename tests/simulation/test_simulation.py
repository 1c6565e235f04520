"""Whole swarms in the simulator: every fault does what it says, and the swarm stays calm and alive."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import msgspec
import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.interface import Plan, PlanRequest
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.completion import STALL_SLOTS
from edc_swarm.protocol.messages import EPOCH_NS, Command, Event, Fix, Message, MissionMessage, Report, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation, SimulationEnd
from tests.builders import entry

EDC: dict[str, Any] = {"planner_name": "edc", "area_m2": 10_000.0}
"""Fields of a mission that the project's own planner flies to its end."""
HOLD: dict[str, Any] = {"failsafe": "hold"}
LANDING_SLOTS = 42
"""Slots until a UAV that died has left the airspace, with the default failsafe."""


class Flight:
    """A simulated mission with every message, by kind, and its time (mission seconds)."""

    def __init__(
        self,
        *faults: str,
        planner: Any = None,
        planner_name: str = "straight",
        to_the_end: bool = False,
        **fields: Any,
    ) -> None:
        defaults: dict[str, Any] = {"uavs": 5, "planner": planner_name, "area_m2": 40_000.0, "max_slots": 30}
        self.mission: MissionMessage = mission_message(
            complete_mission(mission_from_dict({**defaults, **fields, "fault": list(faults)}))
        )
        self.said: list[tuple[float, Message]] = []
        make = planner or (lambda: make_planner(self.mission.planner, self.mission))
        self.simulation = Simulation(self.mission, make, self._hear)
        if to_the_end:
            self.simulation.monitor.complete = lambda slot: False  # type: ignore[method-assign]  # noqa: ARG005
        self.end: SimulationEnd = self.simulation.run()

    def _hear(self, _key: str, message: Message, now_ns: int) -> None:
        self.said.append(((now_ns - EPOCH_NS) / 1e9, message))

    @property
    def messages(self) -> list[Message]:
        """Every message, in order."""
        return [message for _, message in self.said]

    def fixes(self, uav: str) -> list[Fix]:
        """All fixes of a UAV."""
        return [message for message in self.messages if isinstance(message, Fix) and message.uav == uav]

    def fix_slots(self, uav: str) -> list[int]:
        """Slots with a fix, once each."""
        return sorted({fix.slot for fix in self.fixes(uav)})

    @property
    def reports(self) -> list[Report]:
        """Reports with a quorum."""
        return [message for message in self.messages if isinstance(message, Report) and message.has_quorum]

    @property
    def planned_slots(self) -> list[int]:
        """Slots with a plan."""
        return sorted({report.slot for report in self.reports})

    def missed(self, first: int, last: int) -> int:
        """Number of slots from `first` to `last` without a plan."""
        return len(set(range(first, last + 1)) - set(self.planned_slots))

    def broken(self) -> list[str]:
        """Guarantees that are broken."""
        return [result.guarantee for result in check(Recording.from_messages(self.messages)) if result.broken]


class Circling:
    """A planner that never lets UAVs rest: there and back, by turns."""

    def plan(self, request: PlanRequest) -> Plan:
        """One metre right in even slots, left in odd ones."""
        step_m = 1.0 if request.slot % 2 else -1.0
        return Plan([(float(x) + step_m, float(y)) for x, y in request.position_m], "no-qp-needed")


def test_same_seed_same_messages() -> None:
    """Two runs of one scenario with losses and faults publish the same bytes at the same times."""
    runs = [
        Flight("link *>* loss 0.2 delay 20 jitter 30 duplicate 0.1 @0", "kill head mid-step @9", seed=3)
        for _ in range(2)
    ]
    first, second = ([(at_s, encode(message)) for at_s, message in run.said] for run in runs)
    assert first == second
    other = Flight("link *>* loss 0.2 delay 20 jitter 30 duplicate 0.1 @0", "kill head mid-step @9", seed=4)
    assert [encode(message) for message in other.messages] != [payload for _, payload in first]


# --- every fault does what it says -------------------------------------------------------------


def test_kill() -> None:
    """A dead UAV is silent, and the others go on."""
    flight = Flight("kill u002 @3.1s", to_the_end=True)
    assert flight.fix_slots("u002") == list(range(7))
    assert flight.reports[-1].unheard == ["u002"]


def test_kill_for_a_while() -> None:
    """A UAV that is killed for 2 s comes back by itself, in a life of its own."""
    flight = Flight("kill u002 @3.1s for 2s", to_the_end=True)
    assert flight.fix_slots("u002") == [*range(7), *range(10, 30)]
    assert {fix.instance for fix in flight.fixes("u002")} == {"u002-1", "u002-2"}
    assert flight.reports[-1].unheard == []


def test_kill_between_two_effects() -> None:
    """A UAV killed in mid-step has persisted its last step, but need not have published it."""
    flight = Flight("kill u002 mid-step @3.1s", to_the_end=True, planner=Circling)
    slots = [motion.slot for motion in flight.end.motions if motion.uav == "u002"]
    assert slots == list(range(2, 8))
    assert flight.fix_slots("u002")[-1] in {6, 7}


def test_restart_keeps_the_promise() -> None:
    """A UAV that comes back is where it was, with its grant, and flies again in the next slot but one."""
    flight = Flight("restart u002 @3.1s", to_the_end=True, planner=Circling)
    before, after = (
        [fix for fix in flight.fixes("u002") if fix.instance == f"u002-{life}"] for life in (1, 2)
    )  # fmt: skip
    assert (after[0].slot, after[0].term, after[0].head) == (7, 1, before[-1].head)
    assert flight.fix_slots("u002") == list(range(30))
    assert after[-1].executing
    assert after[-1].voter
    assert after[0].seq == 0


def test_restart_without_memory() -> None:
    """A UAV that lost its promise never grants again, and no head hears it again."""
    flight = Flight("restart u002 lose-memory @3.1s", to_the_end=True)
    after = [fix for fix in flight.fixes("u002") if fix.instance == "u002-2"]
    assert after
    assert not any(fix.voter or fix.head or fix.executing for fix in after)
    assert all("u002" in report.unheard for report in flight.reports if report.slot >= 7)


def test_freeze_and_resume() -> None:
    """A frozen UAV is silent until it is resumed, and then skips the slots that it missed."""
    flight = Flight("freeze u002 @3.1s", "resume u002 @6.1s", to_the_end=True)
    assert flight.fix_slots("u002") == [*range(7), *range(12, 30)]
    assert not next(fix for fix in flight.fixes("u002") if fix.slot == 12).executing


def test_freeze_for_a_while() -> None:
    """With `for` a frozen UAV resumes by itself."""
    assert Flight("freeze u002 @3.1s for 3s", to_the_end=True).fix_slots("u002") == [*range(7), *range(12, 30)]


@pytest.mark.parametrize("for_s", [0.1, 2.0])
def test_freeze_between_two_effects(for_s: float) -> None:
    """A UAV stopped in mid-step goes on after the stated time, counted from when it stopped."""
    flight = Flight(f"freeze u002 mid-step @3.1s for {for_s}s", to_the_end=True)
    back = 8 + round(for_s / 0.5) - (for_s < 0.5)
    assert set(range(back, 30)) <= set(flight.fix_slots("u002"))


@pytest.mark.parametrize("fault", ["partition u002|rest @3.1s for 3s", "partition rest|u002 @3.1s for 6"])
def test_partition(fault: str) -> None:
    """A UAV that is cut off is unheard meanwhile, suspects its head, and rejoins the same head."""
    flight = Flight(fault, to_the_end=True)
    unheard = [report.slot for report in flight.reports if "u002" in report.unheard]
    assert unheard == [7, 8, 9, 10, 11, 12]
    assert any(fix.suspects for fix in flight.fixes("u002") if 7 <= fix.slot <= 12)
    assert flight.fixes("u002")[-1].suspects is False
    assert {report.term for report in flight.reports} == {1}


def test_partition_one_way() -> None:
    """The partition cuts off messages of the left side alone."""
    mute = Flight("partition u002>rest @3.1s for 3s", to_the_end=True)
    assert [report.slot for report in mute.reports if "u002" in report.unheard] == [7, 8, 9, 10, 11, 12]
    assert not any(fix.suspects for fix in mute.fixes("u002")[2:])
    deaf = Flight("partition rest>u002 @3.1s for 3s", to_the_end=True, planner=Circling)
    assert not any("u002" in report.unheard for report in deaf.reports)
    assert [fix.slot for fix in deaf.fixes("u002") if fix.slot > 2 and not fix.executing][-1] == 13


def test_heal() -> None:
    """`heal` ends every partition."""
    flight = Flight("partition u002|rest @3.1s", "partition u003>u001 @3.1s", "heal @6.1s", to_the_end=True)
    assert [report.slot for report in flight.reports if "u002" in report.unheard] == [7, 8, 9, 10, 11, 12]
    assert flight.reports[-1].unheard == []


def test_link() -> None:
    """A link that loses everything for a while is a link cut one way; a late command is not flown."""
    flight = Flight("link u002>* loss 1 @3.1s for 3s", to_the_end=True)
    assert [report.slot for report in flight.reports if "u002" in report.unheard] == [7, 8, 9, 10, 11, 12]
    slow = Flight("link *>u002 delay 600 @3.1s for 3s", to_the_end=True, planner=Circling)
    held = [fix.slot for fix in slow.fixes("u002") if not fix.executing and fix.slot >= 7]
    assert held == [slot for slot in range(8, 14) for _ in range(2)], "and who lacks a command says its fix again"


def test_radio_range() -> None:
    """A UAV that flies out of range of the head is not commanded beyond it: true positions count, not starts."""
    ways = {"u1": ((0.0, 0.0), (0.0, 0.0)), "u2": ((0.0, 20.0), (0.0, 20.0)), "u3": ((40.0, 0.0), (200.0, 0.0))}
    roster = [entry(uav, *way, energy_j=5e4) for uav, way in ways.items()]
    link = [{"range_m": 100.0, "shadowing_db": 0.0}]
    flight = Flight(
        roster=msgspec.to_builtins(roster), uavs=3, link=link, v_max_mps=20.0, gps_model="none", max_slots=60, **HOLD
    )
    assert not flight.end.completed
    assert 90.0 < flight.fixes("u3")[-1].waypoint_x_m < 120.0
    assert (flight.reports[5].unheard, flight.reports[-1].unheard) == ([], ["u3"])
    assert all(fix.waypoint_x_m == 0.0 for fix in flight.fixes("u2"))


def test_clock() -> None:
    """A clock that is 80 ms ahead begins its slots 80 ms early and stamps its messages so."""
    flight = Flight("clock u002 offset 80 @3.1s", "clock u003 offset -50 @3.1s", to_the_end=True, guard_s=0.1)
    began_s = {
        (fix.uav, fix.slot): (at_s - 0.5 * fix.slot, (fix.sent_ns - EPOCH_NS) / 1e9 - 0.5 * fix.slot)
        for at_s, fix in reversed(flight.said)
        if isinstance(fix, Fix)
    }
    assert began_s["u002", 20] == pytest.approx((-0.08, 0.0), abs=1e-6)
    assert began_s["u003", 20] == pytest.approx((0.05, 0.0), abs=1e-6)
    assert began_s["u001", 20] == pytest.approx((0.0, 0.0), abs=1e-6)
    assert flight.missed(1, 29) == 0
    assert flight.broken() == []


def test_clock_drift() -> None:
    """1000 ppm gain a millisecond per second."""
    flight = Flight("clock u002 drift 1000 @0", to_the_end=True)
    at_s = next(at_s for at_s, fix in flight.said if isinstance(fix, Fix) and fix.uav == "u002" and fix.slot == 20)
    assert at_s == pytest.approx(10.0 / 1.001, abs=1e-6)


def test_a_clock_that_is_set_back_takes_no_slot_back() -> None:
    """The slot of a UAV never decreases: it waits until its clock is there again."""
    flight = Flight("clock u002 offset 2000 @3.1s", "clock u002 offset 0 @5.1s", to_the_end=True)
    slots = [fix.slot for fix in flight.fixes("u002")]
    assert slots == sorted(slots)
    assert max(slots) == 29
    assert flight.fixes("u002")[-1].suspects is False


def test_clock_offset_is_reported() -> None:
    """The head reports a fix from the future beyond the guard, once."""
    flight = Flight("clock u002 offset 80 @3.1s", to_the_end=True)
    told = [m for m in flight.messages if isinstance(m, Event) and m.kind == "clock-offset"]
    assert any("u002 is" in event.detail for event in told)
    assert len({(event.source, event.detail[:4]) for event in told}) == len(told)


def test_gps() -> None:
    """Another GPS model changes the reported positions and neither disc nor truth."""
    flight = Flight("gps u002 white @5", gps_model="none", to_the_end=True)
    errors = {f.slot: (f.x_m - f.from_x_m, f.y_m - f.from_y_m) for f in flight.fixes("u002")}
    assert all(abs(x) < 1e-9 and abs(y) < 1e-9 for slot, (x, y) in errors.items() if slot < 5)
    assert len({error for slot, error in errors.items() if slot > 5}) > 20


def test_slow() -> None:
    """A solver that takes longer than the slot makes everybody hold, and is safe."""
    flight = Flight("slow head 600 @6 for 4", to_the_end=True, planner=Circling)
    held = {f.slot for f in flight.fixes("u002") if not f.executing and f.slot >= 2}
    assert {7, 8, 9} <= held
    assert flight.fixes("u002")[-1].executing
    assert flight.broken() == []


@pytest.mark.parametrize(
    ("faults", "silent"),
    [
        (("freeze u002 @5 for 8", "freeze u002 @7 for 2"), range(6, 13)),
        (("freeze u002 @5 for 2", "freeze u002 @6 for 7"), range(6, 13)),
        (("freeze u002 @5 for 6", "resume u002 @7", "freeze u002 @9 for 5"), (6, 9, 10, 11, 12, 13)),
        (("freeze u002 @5 for 8", "kill u002 @7 for 1", "freeze u002 @9 for 2"), (6, 7, 9, 10)),
    ],
)
def test_freezes_that_overlap(faults: tuple[str, ...], silent: Sequence[int]) -> None:
    """Of freezes that overlap the longest counts, and none outlasts a resume or a death."""
    flight = Flight(*faults, to_the_end=True)
    said = {fix.slot for fix in flight.fixes("u002") if 5 < fix.slot < 16}
    assert said == set(range(6, 16)) - set(silent)
    assert flight.broken() == []


@pytest.mark.parametrize(
    ("faults", "silent"),
    [
        (("restart router @8",), 2),
        (("kill router @8 for 4",), 4),
        (("freeze router @8 for 3",), 3),
        (("freeze router @8", "resume router @13"), 5),
    ],
)
def test_router(faults: tuple[str, ...], silent: int) -> None:
    """Without the router nothing passes; nobody claims, and the term grows by at most one."""
    flight = Flight(*faults, to_the_end=True)
    assert not set(range(9, 8 + silent)) & set(flight.planned_slots)
    assert flight.missed(8, 29) <= silent + 3
    assert max(report.term for report in flight.reports) <= 2


def test_a_fault_without_target() -> None:
    """A fault for a head while there is none, or for the recorder, is recorded and changes nothing."""
    flight = Flight("kill head @0", "kill recorder @4", to_the_end=True)
    assert [m.detail for m in flight.messages if isinstance(m, Event) and m.kind == "fault-without-target"] == [
        "kill head @0s", "kill recorder @2s",
    ]  # fmt: skip
    assert flight.missed(1, 29) == 0


def test_every_fault_is_told() -> None:
    """The operator's events tell every fault, with ids in place of words."""
    flight = Flight("freeze head @4 for 2", "partition halves @8 for 2", to_the_end=True)
    told = [m.detail for m in flight.messages if isinstance(m, Event) and m.kind == "fault"]
    assert told == [f"freeze {flight.reports[0].head} @2s for 1s", "partition u001,u002|u003,u004,u005 @4s for 1s"]


# --- calm, and alive ---------------------------------------------------------------------------


def test_ten_per_cent_loss_changes_no_head() -> None:
    """For ten minutes, 1200 slots, at 10 % loss the head and the term stay."""
    energy = {"initial_min_j": 2e5, "initial_max_j": 3e5}
    flight = Flight(link=[{"loss": 0.1}], energy=energy, max_slots=1200, planner=Circling, handover_margin=10.0)
    assert flight.end.slots == 1200
    assert {(report.term, report.head) for report in flight.reports} == {(1, flight.reports[0].head)}
    assert flight.missed(5, 1199) <= 12


def test_near_equal_energies_do_not_pass_the_head_around() -> None:
    """With batteries that differ by less than a slot's flight: at most one handover in 20 slots."""
    energy = {"initial_min_j": 60_000.0, "initial_max_j": 60_001.0, "radio_j_per_message": 1.0}
    flight = Flight(energy=energy, handover_margin=0.0, max_slots=200, planner=Circling)
    changes = [b.slot for a, b in pairwise(flight.reports) if a.term != b.term]
    assert len(changes) >= 5
    assert all(later - earlier >= 20 for earlier, later in pairwise(changes))
    assert flight.missed(1, 199) == 0
    calm = Flight(energy=energy, max_slots=200, planner=Circling)
    assert {report.term for report in calm.reports} == {1}


@pytest.mark.parametrize("at_ms", range(5000, 5500, 25))
def test_fail_over_takes_at_most_two_slots(at_ms: int) -> None:
    """At most two slots go by without commands, at whatever time in a slot the head dies."""
    flight = Flight(f"kill head @{at_ms / 1e3}s", max_slots=16, to_the_end=True)
    assert flight.missed(1, 15) <= 2
    assert {report.term for report in flight.reports} == {1, 2}


@pytest.mark.parametrize("verb", ["kill", "freeze"])
@pytest.mark.parametrize("at_s", ["4.99", "5.0", "5.0004", "5.0007", "5.3"])
def test_head_stopped_in_mid_step(verb: str, at_s: str) -> None:
    """A head stopped between two effects of one step: a new head soon, and every guarantee held."""
    flight = Flight(f"{verb} head mid-step @{at_s}s", uavs=6, area_m2=10_000.0, to_the_end=True)
    assert flight.missed(1, 29) <= 7
    assert flight.reports[-1].slot == 29
    assert not {"G1", "G2", "G4"} & set(flight.broken())


def test_two_heads_die_within_three_slots() -> None:
    """The rest finish, and every guarantee is held."""
    flight = Flight("kill head @10", "kill head @12", uavs=6, max_slots=0, **EDC)
    assert flight.end.completed
    assert flight.broken() == []
    assert len({report.head for report in flight.reports}) == 3


def test_halves_hold_and_finish_after_healing() -> None:
    """Five against five: nobody leads, nobody moves; after healing all arrive."""
    flight = Flight("partition halves @8 for 12", uavs=10, max_slots=0, **EDC)
    assert not set(range(8, 20)) & set(flight.planned_slots)
    moved = [f for f in flight.messages if isinstance(f, Fix) and f.executing and 9 < f.slot <= 20]
    assert moved == []
    assert flight.end.completed
    assert flight.broken() == []
    assert flight.missed(20, 30) <= 5


def test_heavy_loss_and_then_none() -> None:
    """After a minute in which almost nothing gets through, one head leads everybody again."""
    fault = "link *>* loss 0.9 reorder 0.3 @5 for 60"
    flight = Flight(fault, max_slots=90, planner=Circling, handover_margin=10.0, **HOLD)
    last = flight.reports[-1]
    assert last.slot == 89
    assert last.unheard == []
    assert flight.missed(75, 89) == 0
    assert len({report.term for report in flight.reports if report.slot >= 75}) == 1


@pytest.mark.parametrize("uavs", [1, 2, 3])
def test_small_swarms(uavs: int) -> None:
    """One, two and three UAVs fly, survive a restart of the head, and finish."""
    flight = Flight("restart head @5.1s", uavs=uavs, max_slots=0, **EDC)
    assert flight.end.completed
    assert flight.broken() == []
    assert flight.missed(12, flight.end.slots - 1) <= 3


def test_one_of_two_is_no_quorum() -> None:
    """When one of two dies, the other holds."""
    flight = Flight("kill u001 @8", uavs=2, planner=Circling, to_the_end=True)
    assert not [f for f in flight.fixes("u002") if f.executing and f.slot > 9]


def test_the_whole_swarm_restarts() -> None:
    """All processes come back at once, standbys forgotten: a new term, and all is well."""
    faults = [f"restart u00{k} @4.1s" for k in range(1, 6)]
    flight = Flight(*faults, to_the_end=True)
    assert flight.reports[-1].slot == 29
    assert flight.reports[-1].unheard == []
    assert flight.reports[-1].term == 2


@pytest.mark.parametrize("standbys", [0, 1])
def test_no_standby_left(standbys: int) -> None:
    """Without a standby that lives, the best candidate is granted after a further lease."""
    flight = Flight("kill head @4.1s", "kill standby @4.1s", standbys=standbys, uavs=6, to_the_end=True)
    assert flight.reports[-1].slot == 29
    assert flight.missed(9, 29) <= 6


def test_a_deaf_uav_is_no_successor() -> None:
    """A UAV that hears nobody is not handed the lead, however full its battery is."""
    energy = {"initial_min_j": 60_000.0, "initial_max_j": 60_100.0, "radio_j_per_message": 1.0}
    flight = Flight(
        "partition rest>u002 @5", uavs=3, energy=energy, handover_margin=0.0, max_slots=100, planner=Circling
    )
    assert "u002" not in {report.successor for report in flight.reports if report.slot > 8}
    assert "u002" not in {report.head for report in flight.reports if report.slot > 8}
    assert flight.missed(1, 99) <= 2


def test_an_empty_battery_ends_a_uav() -> None:
    """The head's battery runs out: it stays where it is, publishes that, and another one leads."""
    flight = Flight(roster=roster(900.0, 5e4, 6e4, 7e4), uavs=4, elect="response-time", max_slots=40, planner=Circling)
    assert flight.reports[0].head == "u1"
    empty = next(m for m in flight.messages if isinstance(m, Event) and m.kind == "battery-empty")
    assert (empty.source, flight.fix_slots("u1")[-1]) == ("u1", empty.slot - 1)
    assert flight.reports[-1].head != "u1"
    assert flight.reports[-1].slot == 39
    assert flight.end.completed is False


@pytest.mark.parametrize("empty", ["u1", "u4"])
def test_an_empty_battery_takes_its_token_with_it(empty: str) -> None:
    """A UAV with an empty battery leaves like a process that ends: no slot is missed, and no head waits for it."""
    energies_j = [900.0 if uav == empty else 5e4 for uav in ("u1", "u2", "u3", "u4")]
    flight = Flight(
        roster=roster(*energies_j), uavs=4, elect="response-time", max_slots=20, to_the_end=True, planner=Circling
    )
    ended = next(m.slot for m in flight.messages if isinstance(m, Event) and m.kind == "battery-empty")
    assert 2 < ended < 19
    assert flight.missed(1, 19) == 0
    said_at_s = {m.slot: at_s - m.slot * flight.mission.dt_s for at_s, m in flight.said if isinstance(m, Report)}
    assert all(said_at_s[slot] < flight.mission.tau_s / 4 for slot in range(2, 20))


def test_all_batteries_run_out() -> None:
    """A mission in which no UAV flies any more ends at once."""
    flight = Flight(roster=roster(500.0, 500.0, 500.0), uavs=3, planner=Circling, max_slots=40)
    assert not flight.end.completed
    assert flight.end.slots < 10


def test_a_late_starter_joins() -> None:
    """A UAV whose process starts at slot 12 takes part from the next slots on."""
    flight = Flight("kill u002 @0", "restart u002 @12", to_the_end=True, planner=Circling)
    joined = [report.slot for report in flight.reports if "u002" in report.heard]
    assert joined[-1] == 29
    assert 12 <= min(slot for slot in joined if slot > 1) <= 14


@pytest.mark.parametrize("lag_slots", [0, 1])
def test_fixes_far_too_late(lag_slots: int) -> None:
    """Delays of several slots, then none: nothing moves meanwhile, nothing breaks, all arrive."""
    faults = ("link *>* delay 700 jitter 900 duplicate 0.3 @6 for 20",)
    flight = Flight(*faults, uavs=5, lag_slots=lag_slots, max_slots=0, **EDC)
    assert flight.end.completed
    assert flight.broken() == []


def test_sequence_numbers_have_no_holes() -> None:
    """`seq` counts from 0 per instance and key, and `closed` tells the last of each."""
    flight = Flight("restart u002 @3.1s", "kill head @6")
    seqs: dict[tuple[str, str], list[int]] = {}
    for message in flight.messages:
        if isinstance(message, Fix):
            seqs.setdefault((message.instance, f"fix {message.uav}"), []).append(message.seq)
        elif isinstance(message, Command):
            seqs.setdefault((message.instance, f"command {message.uav}"), []).append(message.seq)
    assert all(found == list(range(len(found))) for found in seqs.values())
    closed = {m.source: m for m in flight.messages if isinstance(m, Event) and m.kind == "closed"}
    last = msgspec.json.decode(closed["u002"].detail)
    assert last[f"swarm/{flight.mission.name}/uav/u002/fix"] == seqs["u002-2", "fix u002"][-1]


def roster(*energies_j: float) -> list[dict[str, Any]]:
    """UAVs u1, u2, ... 40 m apart with these batteries; the first has the fastest computer."""
    entries = [
        entry(f"u{k}", (40.0 * k, 0.0), (40.0 * k, 90.0), body_m=0.25, energy_j=energy_j, compute_factor=1.0 + k)
        for k, energy_j in enumerate(energies_j, 1)
    ]
    found: list[dict[str, Any]] = msgspec.to_builtins(entries)
    return found


def test_the_mission_type_is_the_missions() -> None:
    """The message on the bus has every field of the mission file."""
    assert set(Mission.__struct_fields__) <= set(MissionMessage.__struct_fields__)


def test_a_vote_that_is_split_for_long_ends() -> None:
    """After half of all messages were lost for 35 s, and votes split, one head leads everybody."""
    flight = Flight(
        "kill head @5.242s",
        "kill u002 mid-step @13.450s",
        "restart u002 @13.550s",
        link=[{"distribution": "lognormal", "loss": 0.5, "duplicate": 0.2, "reorder": 0.2, "end_s": 35.0}],
        elect="response-time",
        seed=930,
        uavs=8,
        area_m2=2000.0,
        lag_slots=1,
        lease_slots=3,
        handover_margin=0.0,
        max_slots=110,
        to_the_end=True,
    )
    assert flight.missed(85, 109) == 0
    assert len({report.term for report in flight.reports if report.slot >= 85}) == 1


# --- nothing can change any more -----------------------------------------------------------------


class Resting:
    """A planner that lets nobody move for so many plans, and then flies straight."""

    def __init__(self, plans: int) -> None:
        self._left = plans

    def plan(self, request: PlanRequest) -> Plan:
        """Stay, or a metre towards each target."""
        self._left -= 1
        waypoint_m = []
        for (x, y), (tx, ty) in zip(request.position_m, request.target_m, strict=True):
            far_m = math.hypot(tx - x, ty - y)
            share = min(1.0, 1.0 / far_m) if self._left < 0 and far_m else 0.0
            waypoint_m.append((float(x + share * (tx - x)), float(y + share * (ty - y))))
        return Plan(waypoint_m, "no-qp-needed")


def verdict_on_progress(flight: Flight) -> GuaranteeResult:
    """G7 of a flight, from its messages."""
    return next(r for r in check(Recording.from_messages(flight.messages)) if r.guarantee == "G7")


@pytest.mark.parametrize("faults", [[], ["gps u001 white @1"], ["partition halves @3 for 9"], ["freeze u002 @5"]])
def test_a_planner_that_never_moves_stalls_and_breaks_progress(faults: list[str]) -> None:
    """With a fault as without: `--fault "gps u001 white @1"` once made G7 "not applicable"."""
    flight = Flight(*faults, max_slots=0, planner=lambda: Resting(10_000))
    assert (flight.end.reason, flight.end.completed) == ("stalled", False)
    assert flight.end.slots <= 12 + STALL_SLOTS + 10 + ("freeze u002 @5" in faults) * LANDING_SLOTS
    assert [event.detail for event in flight.messages if isinstance(event, Event) and event.kind == "end"] == [
        "stalled"
    ]
    assert verdict_on_progress(flight).status == "broken"


def test_a_rest_is_no_standstill() -> None:
    """A planner that lets all UAVs wait for less than `STALL_SLOTS` plans."""
    flight = Flight(max_slots=0, planner=lambda: Resting(STALL_SLOTS - 1))
    assert flight.end.completed
    assert verdict_on_progress(flight).status == "held"


def test_a_long_delay_is_no_standstill() -> None:
    """The head is home, and no command of its plans is ever in time: it may be one day."""
    flight = Flight(link=[{"delay_ms": 300.0}], max_slots=400, **HOLD, **EDC)
    assert flight.end.reason == "max_slots"
    assert verdict_on_progress(flight).status == "not-applicable"


def test_nobody_hovers_where_no_quorum_can_be() -> None:
    """Three of five are dead, or a partition into halves and one dead never heals."""
    dead = [f"kill u00{k} @{k}" for k in (1, 2, 3)]
    for faults in (dead, ["partition u001,u002|u003,u004,u005 @5", "partition u003|u004,u005 @5"]):
        flight = Flight(*faults, max_slots=0, **HOLD, **EDC)
        assert (flight.end.reason, flight.end.slots) == ("stalled", 1 + flight_settled(faults) + STALL_SLOTS)
        assert verdict_on_progress(flight).status == "not-applicable"


def flight_settled(faults: list[str]) -> int:
    """Slot of the last fault."""
    return max(int(fault.rsplit("@", 1)[1]) for fault in faults)


def test_after_a_partition_for_good_the_side_with_a_quorum_arrives() -> None:
    """The others hold where they are, and G7 names them."""
    flight = Flight("partition u001,u002|rest @6", max_slots=0, seed=4, **HOLD, **EDC)
    assert flight.end.reason == "stalled"
    verdict = verdict_on_progress(flight)
    assert verdict.status == "held"
    assert "u001 need not arrive: a partition that never heals cuts it off from the quorum" in verdict.notes
    flight = Flight("partition u001,u002|rest @6", max_slots=0, seed=4, **EDC)
    assert flight.end.reason == "completed"
    verdict = verdict_on_progress(flight)
    assert verdict.status == "held"
    landed = re.compile(r"u001 need not arrive: it landed in slot 2\d, which a fault or a lossy link can cause")
    assert any(map(landed.fullmatch, verdict.notes)), verdict.notes


def test_max_slots_too_few_for_a_verdict() -> None:
    """G7 is not judged on a mission that the user cut short."""
    verdict = verdict_on_progress(Flight(max_slots=5, **EDC))
    assert verdict.status == "not-judged"
    assert verdict.notes[0].startswith("stopped after 5 slots (max_slots = 5 was given)")


def test_no_command_comes_sooner_after_its_fix_than_the_way_takes() -> None:
    """Each command names the fix that its head planned with, so every time but the head's own has the link's delay."""
    flight = Flight(link=[{"delay_ms": 100.0}], max_slots=8)
    sent_ns = {(f.uav, f.slot, f.seq): f.sent_ns for f in flight.messages if isinstance(f, Fix)}
    commands = [c for c in flight.messages if isinstance(c, Command) and c.uav != c.head]
    assert commands
    assert all(c.sent_ns - sent_ns[c.uav, c.slot - 1, c.fix_seq] >= 100_000_000 for c in commands)
