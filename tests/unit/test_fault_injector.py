"""Tests of the fault injector of an operator that takes over: nothing that fell into the gap is lost or done twice."""

from __future__ import annotations

import signal
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from edc_swarm.mission.configuration import NS_PER_S, Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Event, MissionMessage, mission_message
from processes.operator.fault_injector import HEARD_SLOTS, Injector, untold

FAULTS = ["kill u001 @4s for 10s", "freeze u002 @5s for 20s", "restart u003 @8s", "gps u001 outage @9s for 2s"]


@dataclass
class Seat:
    """What an injector sees of its operator and of the processes, and what it does to them."""

    now_s: float
    done: list[tuple[str, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Be clock, monitor and bus too."""
        self.bus = self.clock = self.monitor = self
        self.head, self.standbys, self.in_office = "u001", ["u002"], dict[str, str]()

    def now_ns(self) -> int:
        """Return the time; the epoch is 0."""
        return round(self.now_s * NS_PER_S)

    def publish_event(self, kind: EventKind, detail: str = "") -> None:
        """Note an event."""
        self.done.append((kind.value, detail))

    def signal(self, name: str, number: int) -> None:
        """Note a signal."""
        self.done.append((signal.Signals(number).name, name))

    def restart(self, name: str, *, lose_memory: bool) -> None:
        """Note a start."""
        assert not lose_memory
        self.done.append(("start", name))


def mission() -> MissionMessage:
    """Return a mission of three UAVs with all the faults."""
    return mission_message(complete_mission(Mission(uavs=3, fault=FAULTS)), 0)


def told(kind: EventKind, detail: str, at_s: float) -> Event:
    """Return an event of the operator before."""
    return Event(
        instance="a", seq=0, sent_ns=round(at_s * NS_PER_S), source="operator", kind=kind, detail=detail, slot=0
    )


KILLED, FROZEN = told(EventKind.FAULT, FAULTS[0], 4.0), told(EventKind.FAULT, FAULTS[1], 5.0)
STARTED = told(EventKind.HOST_REQUEST, "", 14.0)


def takes_over(events: list[Event] | None, *times_s: float) -> list[list[tuple[str, str]]]:
    """Return what an injector that begins at the first of `times_s` does at each of them."""
    seat, found = Seat(times_s[0]), []
    injector = Injector(mission(), cast("Any", seat), events)
    for seat.now_s in times_s:
        injector.inject_due()
        found.append(seat.done)
        seat.done = []
    return found


BEFORE = [KILLED, FROZEN]
LATER = [told(EventKind.FAULT, FAULTS[2], 8.0), told(EventKind.FAULT_WITHOUT_TARGET, FAULTS[3], 9.0)]
RESTARTED = [("fault", "restart u003 @8s"), ("start", "u003")]
OUTAGE = ("fault", "gps u001 outage @9s for 2s")
LEFT_OUT = ("fault-without-target", "kill head @4s")
OVER = ("fault-without-target", "gps u001 outage @9s for 2s")


@pytest.mark.parametrize(
    ("events", "times_s", "expected"),
    [
        pytest.param(BEFORE, (6.0, 8.5, 9.5), [[], RESTARTED, [OUTAGE]], id="faults to come"),
        pytest.param(BEFORE, (9.5,), [[*RESTARTED, OUTAGE]], id="late, and still in force"),
        pytest.param(BEFORE, (11.5,), [[*RESTARTED, OVER]], id="late, and over"),
        pytest.param(
            [*BEFORE, *LATER],
            (12.0, 14.5, 26.0),
            [[], [("start", "u001")], [("SIGCONT", "u002")]],
            id="ends to come",
        ),
        pytest.param(
            BEFORE, (30.0,), [[*RESTARTED, OVER, ("start", "u001"), ("SIGCONT", "u002")]], id="ends that are late"
        ),
        pytest.param([*BEFORE, *LATER, STARTED], (30.0,), [[("SIGCONT", "u002")]], id="an end that was carried out"),
        pytest.param([*BEFORE, LATER[1]], (12.0,), [RESTARTED], id="one that is told after it was due first"),
        pytest.param(None, (8.5, 9.5), [[], [OUTAGE]], id="unknown"),
    ],
)
def test_takeover(
    events: list[Event] | None, times_s: tuple[float, ...], expected: list[list[tuple[str, str]]]
) -> None:
    """Every fault and every end is carried out once, at its time or at once if no operator was there at its time."""
    assert takes_over(events, *times_s) == expected


@pytest.mark.parametrize(("head", "done"), [("u002", ("fault", "kill u002 @4s")), ("", LEFT_OUT)])
def test_a_fault_of_the_head_waits_until_an_operator_that_takes_over_knows_the_head(
    head: str, done: tuple[str, str]
) -> None:
    """It has heard no report as it begins; a fault that finds no head after two slots has no target."""
    seat = Seat(10.0)
    seat.head, of_head = "", mission_message(complete_mission(Mission(uavs=3, fault=["kill head @4s"])), 0)
    injector = Injector(of_head, cast("Any", seat), [])
    injector.inject_due()
    assert seat.done == []
    seat.now_s, seat.head = 10.0 + HEARD_SLOTS * of_head.dt_s, head
    injector.inject_due()
    assert seat.done[0] == done


def test_the_first_operator_injects_all() -> None:
    """Without an operator before, every fault comes at its time."""
    done = takes_over([], 0.0, 4.1, 5.1, 8.1, 9.1, 14.1, 25.1)
    assert [len(acts) for acts in done] == [0, 2, 2, 2, 1, 1, 1]


def test_a_freeze_for_good_outlasts_one_that_overlaps() -> None:
    """The longest freeze counts also for an operator that takes over."""
    for_good = told(EventKind.FAULT, "freeze u002 @4.5s", 4.5)
    assert takes_over([KILLED, for_good, FROZEN, *LATER, STARTED], 30.0) == [[]]


def test_a_freeze_after_a_resume_ends() -> None:
    """A freeze for good that was ended outlasts nothing."""
    for_good = told(EventKind.FAULT, "freeze u002 @2s", 2.0)
    resumed = told(EventKind.FAULT, "resume u002 @3s", 3.0)
    assert takes_over([for_good, resumed, KILLED, FROZEN, *LATER, STARTED], 30.0) == [[("SIGCONT", "u002")]]


@pytest.mark.parametrize(
    ("said", "left"),
    [
        ([], [0, 1, 2, 3, 4, 5]),
        (["kill u002 @4s", "heal @4s"], [0, 2, 3, 4]),
        (["kill u003 @4s", "kill u001 @4s", "partition u003|u001,u002,u004 @4s"], [1, 3, 5]),
        (["kill u003 @5s", "kill head @4s"], [0, 1, 3, 4, 5]),
    ],
)
def test_faults_at_one_time_that_no_event_tells(said: list[str], left: list[int]) -> None:
    """The operator before died between two of its events; an event about a role names a UAV."""
    texts = [
        "kill u001 @4s",
        "kill u002 @4s",
        "kill head @4s",
        "kill standby @4s",
        "partition head|rest @4s",
        "heal @4s",
    ]
    of_one_time = mission_message(complete_mission(Mission(uavs=4, fault=texts)), 0)
    events = [told(EventKind.FAULT, text, 4.0) for text in said]
    assert [texts.index(str(fault)) for fault in untold(parse_faults(of_one_time), of_one_time, events)] == left
