"""What a machine carries: the check before take-off, the stretched slot, and the recorder's backlog."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from edc_swarm.errors import InputError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from processes.host import capacity
from processes.services.backlog import Backlog


def swarm(uavs: int, **fields: Any) -> Mission:
    """A mission at the density of 50 UAVs on 40 000 m2."""
    return complete_mission(mission_from_dict({"uavs": uavs, "area_m2": 800.0 * uavs, **fields}))


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two cores, on which a UAV takes 3 ms in a slot."""
    monkeypatch.setattr(capacity, "_cores", lambda: 2)
    monkeypatch.setattr(capacity, "uav_slot_s", lambda _mission: 0.003)


@pytest.mark.usefixtures("two_cores")
def test_a_swarm_that_is_too_large_is_refused() -> None:
    """2 cores x 70 % x 0.5 s / 3 ms are 233 UAVs; the message names what helps, in one line."""
    capacity.check_capacity(swarm(233))
    with pytest.raises(InputError) as caught:
        capacity.check_capacity(swarm(234))
    said = str(caught.value)
    assert "about 233: this machine carries no more at 0.5 s a slot" in said
    assert "--slot 0.6, --overload stretch, or --overload fly" in said
    assert "\n" not in said
    capacity.check_capacity(swarm(234, dt_s=0.6))
    with pytest.raises(InputError):
        capacity.check_capacity(swarm(150, time_scale=2.0))


@pytest.mark.usefixtures("two_cores")
def test_the_stretched_slot_is_long_enough_and_never_shorter() -> None:
    """The next tenth of a second in which the machine carries all."""
    for uavs, slot_s in ((100, 0.5), (234, 0.6), (500, 1.1)):
        mission = swarm(uavs)
        assert capacity.stretched_slot_s(mission) == pytest.approx(slot_s)
        stretched = msgspec.structs.replace(mission, dt_s=slot_s)
        assert capacity.carried_uavs(stretched.dt_s, 0.003) >= uavs


def test_the_measurement_flies_a_uav() -> None:
    """It takes between 10 us and a second per slot, and the UAV follows the head that is measured with it."""
    assert 1e-5 < capacity.uav_slot_s(swarm(100)) < 1.0


def test_a_backlog_is_told_at_each_doubling() -> None:
    """1, 2, 4 s behind, each once; the recorder requests nothing meanwhile."""
    backlog = Backlog()
    told = [backlog.note(age_s, 7) for age_s in (0.2, 0.9, 1.1, 1.5, 5.0, 3.0, 4.5, 0.1, 9.0)]
    assert [text is not None for text in told] == [False, False, True, False, True, False, False, False, True]
    assert told[4] == "5.0 s and 7 messages behind"
    assert backlog.is_behind
    backlog.note(0.0, 0)
    assert not backlog.is_behind
