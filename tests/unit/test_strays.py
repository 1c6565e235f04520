"""UAVs that no longer follow: what they say, where heads think they are; and UAVs that are ordered to land."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.agent.effects import Disturbed, Effect, Land, Listen, Publish, Received, Strayed, Tick
from edc_swarm.agent.head import Head
from edc_swarm.agent.knowledge import Knowledge
from edc_swarm.agent.node import UavNode
from edc_swarm.agent.vehicle import Promise
from edc_swarm.emulation.body import Flown
from edc_swarm.mission.faults import OrderLanding
from edc_swarm.mission.vehicle_model import VehicleModel
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Event, Fix, Message, Report
from tests import builders
from tests.builders import at, mission_message, row

IDS = ("a", "b", "c")
ROSTER = row(IDS, gap_m=40.0, north_m=90.0, energy_j=1e4)
MISSION = mission_message(ROSTER, gps_model="none", failsafe="land")
FLOWN = msgspec.structs.replace(
    MISSION, vehicle=VehicleModel(model="mavlink", autopilot="udpin:127.0.0.1:{14550+i}"), lag_slots=1
)
FREE_M = 10.0 * 0.5
"""What a vehicle of `FLOWN` can fly in a slot."""


class Body:
    """A vehicle that stays where it is, or strays."""

    state = None
    next_measured_m = (40.0, 0.0)
    standing = Flown((40.0, 0.0), (40.0, 0.0), None, (40.0, 0.0), 0.0, past=[])

    def __init__(self) -> None:
        self.stray_m: float | None = None

    def fly(self, slot: int, from_m: Any, to_m: Any) -> Flown:
        """Return a report of the place."""
        del slot, from_m
        return Flown(to_m, to_m, None, to_m, 0.0, past=[], stray_m=self.stray_m)

    def brake(self, slot: int, from_m: Any, to_m: Any) -> None:
        """Do nothing."""

    def disturb(self, fault: Any) -> None:
        """Do nothing."""


def promise(**fields: Any) -> Promise:
    """Return what UAV b has on its disk."""
    return Promise(**{"slot": 4, "term": 1, "head": "a", "waypoint_x_m": 40.0, "waypoint_y_m": 0.0, **fields})


def said(effects: list[Effect], kind: type[Message]) -> list[Any]:
    """Return the messages of a kind among the effects."""
    return [effect.message for effect in effects if isinstance(effect, Publish) and isinstance(effect.message, kind)]


def test_a_stray_gives_up_its_vote_and_says_where_it_is() -> None:
    """One event; then a fix a slot, without a vote and with the radius; no command is flown, no message answered."""
    body = Body()
    node: UavNode = builders.node(FLOWN, "b", promise(), body=body)
    node.step(Tick(), at(5))
    told = node.step(Strayed("it has left GUIDED for LOITER"), at(5.2))
    assert [(event.kind, event.detail) for event in said(told, Event)] == [
        (EventKind.STRAYED, "it has left GUIDED for LOITER")
    ]
    assert Listen(False) in told
    body.stray_m = 7.5
    moves = builders.command("b", 6, (40.0, 0.0), (40.0, 1.0))
    assert node.step(Received(moves), at(5.5)) == []
    assert node.wakeup_ns(at(5.5)) == at(6)
    (fix,) = said(node.step(Tick(), at(6)), Fix)
    assert (fix.voter, fix.executing, fix.stray_m, fix.slot) == (False, False, 7.5, 6)
    assert node.step(Tick(), at(6.1)) == []


def test_nobody_waits_for_a_head_that_strays() -> None:
    """Its process gives back the priority over its followers: nobody waits for its plans any more."""
    node: UavNode = builders.node(FLOWN, "b", promise(head="b"), body=Body())
    node.step(Tick(), at(5))
    assert node.is_awaited
    node.step(Strayed("it has left GUIDED for LOITER"), at(5.2))
    assert not node.is_awaited


def stray(slot: int, **fields: Any) -> Fix:
    """Return the fix of stray UAV b, 3 m about (50, 0)."""
    place = {"x_m": 50.0, "y_m": 0.0, "voter": False, "stray_m": 3.0}
    return builders.fix("b", slot, (40.0, 0.0), **{**place, **fields})


def head(knowledge: Knowledge) -> Head:
    """Return UAV a as the head of term 1."""
    made = Head(FLOWN, "a", 0, knowledge)
    made.take_office((1, "a"))
    return made


def test_the_hull_of_a_stray_grows_until_it_is_heard_again() -> None:
    """About its last reported place: 3 m at the end of slot 6, and what it can fly in each slot after that."""
    knowledge = Knowledge(FLOWN.roster)
    knowledge.hear_fix(stray(6), 6)
    leads = head(knowledge)
    hulls = [leads.hulls(slot)["b"] for slot in (6, 7, 30)]
    assert [hull.radius_m for hull in hulls] == pytest.approx([3.0 + FREE_M * slots for slots in (1, 2, 25)])
    assert (hulls[0].ax_m, hulls[0].bx_m) == (50.0, 50.0)
    knowledge.hear_fix(stray(9, x_m=60.0), 9)
    assert (leads.hulls(9)["b"].ax_m, leads.hulls(9)["b"].radius_m) == (60.0, 3.0 + FREE_M)


def test_time_alone_lands_no_stray_but_its_word_does() -> None:
    """The failsafe is that of its autopilot: its UAV says when it is on the ground."""
    knowledge = Knowledge(FLOWN.roster)
    knowledge.hear_fix(stray(6), 6)
    leads = head(knowledge)
    assert {"b"} <= leads.hulls(90).keys()
    assert "c" not in leads.hulls(90), "a UAV that is merely unheard has landed by then"
    knowledge.hear_fix(stray(91, on_ground=True), 91)
    assert "b" not in leads.hulls(91)


def test_a_head_that_never_heard_it_grows_the_hull_of_a_report() -> None:
    """The report of slot 6 covers its slot 7; a head that plans slot 10 adds three slots."""
    knowledge = Knowledge(FLOWN.roster)
    place: dict[str, Any] = builders.hulls({"b": ((50.0, 0.0), (50.0, 0.0), 8.0)})
    knowledge.hear_report(builders.report(6, head="c", grants=["a", "c"], unheard=["b"], strays=["b"], **place))
    assert head(knowledge).hulls(9)["b"].radius_m == pytest.approx(8.0 + 3 * FREE_M)


def test_reports_name_strays_and_old_ones_have_no_such_field() -> None:
    """A recording without autopilots has the bytes that it always had."""
    assert b"strays" not in msgspec.json.encode(builders.report(3))
    assert b"stray_m" not in msgspec.json.encode(builders.fix("a", 3))
    again = msgspec.json.decode(msgspec.json.encode(builders.report(3, strays=["b"])), type=Report)
    assert again.strays == ["b"]


def test_a_uav_that_is_ordered_to_land_rests_first() -> None:
    """It flies at 4 m/s and brakes for two slots, takes no command meanwhile, then lands and leaves."""
    plan = msgspec.structs.replace(MISSION, vehicle=VehicleModel(model="multirotor"), lag_slots=1)
    flies = promise(from_x_m=40.0, from_y_m=-1.0, stepped_slot=4)
    node: UavNode = builders.node(plan, "b", flies)
    node.step(Disturbed(OrderLanding("b")), at(4.5))
    node.step(Received(builders.command("b", 5, (40.0, 0.0), (40.0, 1.0))), at(4.6))
    ends = []
    for slot in range(5, 9):
        effects = node.step(Tick(), at(slot))
        ends.append(Land() in effects)
        assert not any(fix.executing for fix in said(effects, Fix))
        if ends[-1]:
            assert [event.kind for event in said(effects, Event)] == [EventKind.LANDED]
            break
    assert ends[-1]
    assert not ends[0], "it was still moving"
