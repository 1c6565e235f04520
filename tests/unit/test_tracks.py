"""Tracks of discs: the slots that lost messages leave unknown, and those that stay known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from edc_swarm.analysis.tracks import Tracks, tracks_of
from edc_swarm.protocol.messages import Command, Fix, Message, Truth
from tests.unit.synthetic import change, flight, parallel, recorded


def without(first: int, last: int, *kinds: type, **fields: Any) -> Tracks:
    """Return tracks of three UAVs without u1's messages of slots first..last and 8; `fields` change its next fix."""
    messages = flight(parallel())
    change(messages, {"uav": "u1", "slot": last + 1}, Fix, **fields)
    lost = [("u1", slot, kind) for slot in (*range(first, last + 1), 8) for kind in (*kinds, Command)]
    kept = [m for m in messages if (getattr(m, "uav", ""), getattr(m, "slot", 0), type(m)) not in lost]
    return tracks_of(recorded(kept))


@pytest.mark.parametrize(("first", "last"), [(0, 0), (0, 3), (3, 3), (3, 5)])
def test_a_lost_way_is_flown_evenly(first: int, last: int) -> None:
    """The track interpolates from the last known to the next known place, also from the start of the mission."""
    tracks = without(first, last, Fix, Truth, from_x_m=18.0)
    start_m, end_m = np.array([12.0, 2.0 * max(first - 1, 0)]), np.array([18.0, 2.0 * last])
    assert tracks.centre_m.shape == (10, 3, 2)
    assert tracks.centre_m[first : last + 2, 1] == pytest.approx(np.linspace(start_m, end_m, last - first + 2))
    assert np.flatnonzero(tracks.lost[:, 1]).tolist() == list(range(first, last + 1))
    assert not tracks.lost[:, [0, 2]].any()
    assert np.isnan(tracks.true_to_m[first : last + 1, 1]).all()
    assert np.isnan(tracks.true_from_m[first : last + 1, 1]).all()


def test_a_truth_that_is_not_lost_is_known() -> None:
    """The motion of the disc is lost, that of the UAV is not."""
    tracks = without(3, 5, Fix, from_x_m=18.0)
    assert tracks.lost[3:6, 1].all()
    assert tracks.true_to_m[3:6, 1, 0].tolist() == [12.5] * 3


def test_the_last_slot_may_be_known_by_its_truth_alone() -> None:
    """A last slot without any fix counts if it has a truth."""
    messages = [m for m in flight(parallel()) if not (isinstance(m, Fix) and m.slot == 8)]
    assert tracks_of(recorded(messages)).slots == 9


def test_who_was_never_heard_is_at_its_start() -> None:
    """A UAV without a fix is taken to be at its start."""
    messages = [m for m in flight(parallel()) if getattr(m, "uav", "") != "u2"]
    assert tracks_of(recorded(messages)).centre_m[:, 2].tolist() == [[24.0, 0.0]] * 10


def test_who_holds_after_a_loss_is_at_its_waypoint() -> None:
    """Recordings of early versions contain no more."""
    tracks = without(3, 5, Fix, Truth, executing=False, from_x_m=0.0, from_y_m=0.0, waypoint_x_m=18.0)
    assert tracks.centre_m[6, 1].tolist() == [18.0, 12.0]


def test_who_is_where_it_was_before_a_loss_has_stayed_there() -> None:
    """A UAV at the same place before and after a gap has held, and is judged."""
    assert not without(3, 5, Fix, Truth, from_y_m=4.0).lost.any()


def test_no_way_is_lost_where_only_a_repetition_is() -> None:
    """If only a retransmitted fix is missing, the place of the disc is known."""
    messages: list[Message] = flight(parallel())
    for slot in range(5, 9):
        change(messages, {"uav": "u1", "slot": slot}, Fix, seq=slot + 1, from_x_m=18.0)
    tracks = tracks_of(recorded(messages))
    assert not tracks.lost.any()
    assert tracks.centre_m[5, 1].tolist() == [12.0, 8.0]


def test_a_step_whose_fix_alone_is_lost_is_known_by_its_command() -> None:
    """The command of the next step begins at the end of the lost one."""
    messages = [m for m in flight(parallel()) if not (isinstance(m, Fix) and m.uav == "u1" and m.slot in {3, 6})]
    for said in (messages, [m for m in messages if not isinstance(m, Truth)]):
        tracks = tracks_of(recorded(said))
        assert [(step.uav, step.slot, step.command.slot) for step in tracks.silent] == [(1, 3, 3), (1, 6, 6)]
        assert not tracks.lost.any()
