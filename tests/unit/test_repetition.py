"""Repetition within a slot: measured by sequence numbers, bounded, in time, ended by an acknowledgement."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from msgspec import UNSET

from edc_swarm.agent.effects import Effect, Persist, Publish, Received, Tick
from edc_swarm.agent.node import UavNode
from edc_swarm.agent.repetition import MOST_MISSED, Hearing, Repetition, repeats
from edc_swarm.agent.slot_clock import SlotClock
from edc_swarm.agent.vehicle import Promise
from edc_swarm.protocol.messages import Command, Fix, Message
from tests import builders
from tests.builders import at, mission_message, row

MISSION = mission_message(row("abc", gap_m=40.0, north_m=90.0), gps_model="none", resends=10)


def repetition(uav: str = "a", slot: int = 5, **fields: Any) -> Repetition:
    """The copies of a UAV in a slot that has begun."""
    mission = msgspec.structs.replace(MISSION, **fields)
    made = Repetition(mission, uav, SlotClock(mission))
    made.begin_slot(slot)
    return made


def hear_fixes(made: Repetition, seqs: list[int], uav: str = "b") -> None:
    """Let a UAV's fixes with these numbers come in."""
    for seq in seqs:
        made.hear(builders.fix(uav, 4, seq=seq))


def all_due(made: Repetition, until: float) -> list[tuple[float, Message]]:
    """Every copy until a moment in slots, with its moment."""
    sent = []
    while made.next_ns is not None and made.next_ns <= at(until):
        now_ns = made.next_ns
        sent += [(now_ns / builders.SLOT_NS - 1000, message) for message in made.due(now_ns)]
    return sent


@pytest.mark.parametrize(
    ("loss", "most", "expected"),
    [(0.0, 20, 0), (0.02, 20, 0), (0.1, 20, 1), (0.5, 20, 5), (0.7, 20, 10), (0.9, 20, 20), (0.9, 99, 37), (1.0, 9, 9)],
)
def test_as_often_as_the_loss_asks_for(loss: float, most: int, expected: int) -> None:
    """The probability that all copies are lost is at most 2 %, or the budget is spent."""
    assert repeats(loss, most) == expected
    assert expected == most or loss ** (expected + 1) <= 0.02


@pytest.mark.parametrize(
    ("seqs", "loss"),
    [
        ([7, 8, 9, 10], 0.0),
        ([7, 9, 11, 13], 3 / 7),
        ([7, 9, 8, 10], 0.0),  # Overtaken, not lost.
        ([7, 8, 8, 8, 10], 1 / 4),  # Twice is once.
        ([0, 1000], MOST_MISSED / (MOST_MISSED + 2)),  # An outage says little.
    ],
)
def test_loss_is_counted_by_sequence_numbers(seqs: list[int], loss: float) -> None:
    """What comes late or twice is no loss, and the first number is the beginning."""
    hearing = Hearing()
    for seq in seqs:
        hearing.hear(builders.fix("b", 4, seq=seq))
    assert hearing.loss(["b"]) == pytest.approx(loss)
    hearing.hear(builders.fix("b", 4, seq=3, instance="another life"))
    assert hearing.loss(["b"]) == 0.0


def test_old_losses_are_forgotten() -> None:
    """Only the newest numbers count."""
    hearing = Hearing()
    for seq in [0, 5, *range(6, 200)]:
        hearing.hear(builders.fix("b", 4, seq=seq))
    assert hearing.loss(["b"]) == 0.0


def test_without_loss_nothing_is_repeated() -> None:
    """No copy, no field that is not there without repetition."""
    made = repetition()
    hear_fixes(made, [1, 2, 3])
    sent = builders.command("b", 6)
    assert made.command_with_missed(sent) is sent
    made.repeat_plan([sent], builders.report(5, unheard=["c"]), at(5.2))
    assert made.next_ns is None


def test_commands_are_spread_over_the_time_that_is_left() -> None:
    """Copies end before the slot of the command begins, at equal distances; half of the budget is for commands."""
    made = repetition()
    hear_fixes(made, [1, 9, 19, 29])
    sent = made.command_with_missed(builders.command("b", 6))
    assert sent.missed is not UNSET
    assert sent.missed > 0.8
    made.repeat_plan([sent], builders.report(5), at(5.4))
    times = [time for time, message in all_due(made, 7.0) if isinstance(message, Command)]
    assert len(times) == 5
    assert times == pytest.approx([5.4 + 0.6 * 0.9 * part / 5 for part in range(1, 6)], abs=1e-6)


def test_a_new_slot_drops_all_copies() -> None:
    """A command is not said in the slot in which it is flown."""
    made = repetition()
    hear_fixes(made, [1, 9, 19, 29])
    made.repeat_plan([builders.command("b", 6)], builders.report(5), at(5.4))
    made.begin_slot(6)
    assert made.next_ns is None


def test_an_acknowledged_command_needs_no_copy() -> None:
    """A fix that names the slot of the command ends its series; one that names an older slot does not."""
    made = repetition()
    hear_fixes(made, [1, 9, 19, 29])
    made.repeat_plan([builders.command("b", 6)], builders.report(5), at(5.4))
    made.hear(builders.fix("b", 5, seq=30, next_slot=5))
    assert made.next_ns is not None
    made.hear(builders.fix("b", 5, seq=31, next_slot=6))
    assert made.next_ns is None


def test_what_the_other_end_misses_counts() -> None:
    """A link that loses one way only is known at both ends."""
    made = repetition()
    made.hear(builders.fix("b", 4, seq=1, missed=0.5))
    made.repeat_plan([builders.command("b", 6), builders.command("c", 6)], builders.report(5), at(5.4))
    assert {message.uav for _, message in all_due(made, 6.0) if isinstance(message, Command)} == {"b"}


def test_silence_is_loss() -> None:
    """Without a command for lease and patience, a UAV sends 2, 4, 8 ... copies of its fix, up to half of the budget."""
    made = repetition("b")
    counts = []
    for slot in range(5, 14):
        made.begin_slot(slot)
        made.repeat_fix(builders.fix("b", slot), at(slot))
        counts.append(1 + len(all_due(made, slot + 1.0)))
    assert counts == [1, 1, 1, 1, 2, 4, 6, 6, 6]


def test_no_budget_no_copies() -> None:
    """With `resends` 0 nothing is counted and nothing repeated."""
    made = repetition(resends=0)
    hear_fixes(made, [1, 9, 19, 29])
    sent = builders.command("b", 6)
    assert made.command_with_missed(sent) is sent
    made.repeat_plan([sent], builders.report(5, unheard=["c"]), at(5.4))
    assert made.next_ns is None


def ticks(uav: UavNode, until: float) -> list[Effect]:
    """The effects of all that a UAV does by itself until a moment in slots."""
    effects: list[Effect] = []
    now_ns = at(5)
    while (now_ns := uav.wakeup_ns(now_ns)) < at(until):
        effects += uav.step(Tick(), now_ns)
    return effects


def test_a_uav_repeats_its_fix_until_it_has_its_command() -> None:
    """Copies carry numbers of their own and need no new promise; the one after the command acknowledges it."""
    promise = Promise(slot=4, term=1, head="a", waypoint_x_m=40.0, waypoint_y_m=0.0)
    uav = builders.node(MISSION, "b", promise)
    uav.step(Tick(), at(5))
    for seq in (1, 9, 19, 29):
        uav.step(Received(builders.command("b", 6, (40.0, 0.0), (40.0, 1.0), seq=seq)), at(5.5))
    first = uav.step(Tick(), at(6))
    (said,) = [e.message for e in first if isinstance(e, Publish) and isinstance(e.message, Fix)]
    assert said.executing
    assert said.missed is not UNSET
    copies = uav.step(Tick(), uav.wakeup_ns(at(6.001)))
    assert not any(isinstance(effect, Persist) for effect in copies)
    (copy,) = [effect.message for effect in copies if isinstance(effect, Publish)]
    assert copy == msgspec.structs.replace(said, seq=said.seq + 1)
    uav.step(Received(builders.command("b", 7, (40.0, 1.0), (40.0, 2.0), seq=30)), at(6.12))
    rest = [effect.message for effect in uav.step(Tick(), uav.wakeup_ns(at(6.13))) if isinstance(effect, Publish)]
    assert [message.next_slot for message in rest if isinstance(message, Fix)] == [7]
    assert uav.wakeup_ns(at(6.4)) == at(7)
