"""Energy bills on a mission that is small enough to compute by hand."""

from __future__ import annotations

from typing import Any

import pytest

from edc_swarm.analysis.energy_bill import EnergyBill, Exhausted, energy_bills, exhausted
from edc_swarm.analysis.timings import Timing
from edc_swarm.emulation.energy import propulsion_power_w
from edc_swarm.mission.power_models import EnergyModel
from edc_swarm.protocol.messages import Command, Event, Fix, Message, Report, Truth
from tests.unit.synthetic import EPOCH_NS, SLOT_NS, flight, parallel, recorded, whole

MODEL = EnergyModel(radio_j_per_message=0.25)
HOVER_W = propulsion_power_w(0.0, MODEL)
STEP_J = 0.4 * propulsion_power_w(5.0, MODEL) + 0.1 * HOVER_W


@pytest.fixture
def messages() -> list[Message]:
    """Return messages of three UAVs that hold a slot and fly 2 m in each of eight; u0 leads, u2 ends in slot 4."""
    said = flight(parallel(), guard_s=0.05, energy=MODEL)
    return whole(m for m in said if not (isinstance(m, Fix | Truth) and m.uav == "u2" and m.slot > 4))


def test_a_bill(messages: list[Message]) -> None:
    """A bill has flight between the guards, hovering, messages and plans; a silent UAV adds nothing."""
    messages.append(Report(head="u1", slot=8, term=9, status="no-quorum", plan_ms=1e6, quorum=2))
    head, other, fallen = energy_bills(recorded(messages))
    spent = {"cruise_j": 8 * STEP_J, "hover_j": 0.5 * HOVER_W, "radio_j": 45 * 0.25, "compute_j": 5.0 * 54e-3}
    expected = EnergyBill(
        uav="u0", cruise_s=4.0, hover_s=0.5, total_j=sum(spent.values()), left_j=5e4 - 560, slots_led=9, **spent
    )
    for name in EnergyBill.__struct_fields__:
        assert getattr(head, name) == pytest.approx(getattr(expected, name)), name
    assert (other.radio_j, other.compute_j, other.slots_led) == (10 * 0.25, 0.0, 0)
    assert (fallen.cruise_s, fallen.hover_s, fallen.left_j) == (2.0, 0.5, 5e4 - 280)


def test_who_was_never_heard_has_an_unknown_battery(messages: list[Message]) -> None:
    """A UAV without a fix has no known expenses."""
    *_, silent = energy_bills(recorded([m for m in messages if not (isinstance(m, Fix) and m.uav == "u2")]))
    assert (silent.left_j, silent.total_j, silent.hover_s, silent.cruise_j) == (None, None, None, None)


@pytest.mark.parametrize("kind", [Fix, Command, Report])
def test_what_the_record_lacks_is_on_no_bill(messages: list[Message], kind: type) -> None:
    """Each lost kind of message leaves unknown what is counted in it, of the UAV that said it."""
    lost = next(m for m in messages if isinstance(m, kind) and getattr(m, "slot", -1) == 3)
    head, other, _ = energy_bills(recorded([m for m in messages if m is not lost]))
    assert (head.cruise_j is None, head.compute_j is None) == (kind is Fix, kind is Report)
    assert (head.radio_j, head.total_j) == (None, None)
    assert other.total_j is not None


def test_measured_times_replace_recorded_ones(messages: list[Message]) -> None:
    """There is one timing for each plan of a slot, in order; plans without one keep the recorded time."""
    again = next(m for m in messages if isinstance(m, Report) and m.slot == 1)
    common: dict[str, Any] = {"instance": "i1", "sent_ns": again.sent_ns + 1, "status": again.status, "quorum": 2}
    messages.append(Report(head="u1", slot=1, term=2, plan_ms=7.0, **common))
    timings = [Timing(0, 100.0), Timing(1, 200.0), Timing(1, 300.0)]
    bills = energy_bills(recorded(messages), timings)
    assert [bill.compute_j for bill in bills] == pytest.approx([5.0 * (0.3 + 49e-3), 5.0 * 0.3, 0.0])


def test_who_ran_empty(messages: list[Message]) -> None:
    """Empty batteries are listed in the order of time; other events are ignored."""
    for uav, slot in (("u2", 5), ("u1", 7)):
        messages.append(Event(source=uav, slot=slot, kind="battery-empty", sent_ns=EPOCH_NS + slot * SLOT_NS))
    assert exhausted(recorded(messages)) == [Exhausted("u2", 5), Exhausted("u1", 7)]
