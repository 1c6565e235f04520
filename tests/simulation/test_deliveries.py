"""Messages and deliveries per slot of a swarm without a head: linear in the number of UAVs, and it ends."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from edc_swarm.agent.effects import Effect
from edc_swarm.agent.rota import CANDIDATES, WINDOW_SLOTS, Rota
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.messages import Event, Fix, Message, MissionMessage, Report, mission_message
from edc_swarm.simulation.computers import Computer, Process
from edc_swarm.simulation.network import Network
from edc_swarm.simulation.simulator import Simulation


def swarm(uavs: int, **fields: Any) -> MissionMessage:
    """A mission of `uavs` UAVs at the density of 50 on 40 000 m2."""
    basis = {"uavs": uavs, "area_m2": 800.0 * uavs, "planner": "straight", "max_slots": 24, "failsafe": "hold"}
    return mission_message(complete_mission(mission_from_dict({**basis, **fields})))


LAST_WORDS = {EventKind.CLOSED, EventKind.LINK_DELAYS, EventKind.END}


class Counts:
    """Messages that were published, their deliveries, and most listeners, by slot; and the first head's slot.

    `queries` are those for liveliness tokens: a UAV that hears all fixes watches all UAVs, any other its head, and
    queries the router whenever that changes. `wide` are the queries for all tokens.
    """

    def __init__(self, mission: MissionMessage, monkeypatch: pytest.MonkeyPatch) -> None:
        self.published: Counter[int] = Counter()
        self.delivered: Counter[int] = Counter()
        self.listeners: Counter[int] = Counter()
        self.events: Counter[int] = Counter()
        self.queries: Counter[int] = Counter()
        self.wide: Counter[int] = Counter()
        self._watched: dict[str, str] = {}
        self.led_slots: list[int] = []
        self._start_ns = mission.epoch_ns
        self._slot_ns = mission.slot_ns
        original, carry_out = Network._send, Computer._carry_out

        def count(network: Network, sender: str, message: Message, receivers: Any) -> None:
            receivers = list(receivers)
            slot = network._schedule.slot
            self.delivered[slot] += sum(port.uav != sender and port.process is not None for port in receivers)
            if isinstance(message, Fix):
                self.listeners[slot] = max(self.listeners[slot], len(receivers))
            original(network, sender, message, receivers)

        def watch(computer: Computer, process: Process, effects: list[Effect]) -> None:
            carry_out(computer, process, effects)
            self._watch(computer, process)

        monkeypatch.setattr(Network, "_send", count)
        monkeypatch.setattr(Computer, "_carry_out", watch)
        simulation = Simulation(mission, lambda: make_planner(mission.planner, mission), self._record)
        simulation.run()

    def _watch(self, computer: Computer, process: Process) -> None:
        key = "*" if computer.subscribes_to_fixes else process.node.grant[1]
        if self._watched.get(computer.uav, "") != key:
            self._watched[computer.uav] = key
            self.queries[computer._schedule.slot] += 1
            self.wide[computer._schedule.slot] += key == "*"

    def _record(self, _key: str, message: Message, now_ns: int) -> None:
        self.published[(now_ns - self._start_ns) // self._slot_ns] += 1
        if isinstance(message, Event) and message.kind not in LAST_WORDS:
            self.events[(now_ns - self._start_ns) // self._slot_ns] += 1
        if isinstance(message, Report) and message.has_quorum:
            self.led_slots.append(message.slot)


def most_listeners(mission: MissionMessage) -> int:
    """The bound of ARCHITECTURE: a head, its standbys, the UAVs on duty, and those that were a moment ago."""
    return 1 + mission.standbys + 2 * CANDIDATES


@pytest.mark.parametrize(
    ("uavs", "loss"), [(50, 1.0), (100, 1.0), (200, 1.0), (400, 1.0), (50, 0.8), (100, 0.8), (200, 0.8)]
)
def test_deliveries_are_linear(uavs: int, loss: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A swarm that never has a head sends at most 5 messages per UAV and slot, to at most `most_listeners` each."""
    mission = swarm(uavs, max_slots=8, fault=[f"link *>* loss {loss} @0"])
    counts = Counts(mission, monkeypatch)
    assert counts.led_slots == []
    most = most_listeners(mission)
    assert CANDIDATES <= max(counts.listeners.values()) <= most
    assert max(counts.published.values()) <= 5 * uavs
    assert max(counts.events.values(), default=0) <= most, "only who claims has something to tell"
    assert max(counts.delivered.values()) <= (2 * most + CANDIDATES) * uavs
    assert CANDIDATES <= max(counts.wide.values()) <= most
    assert max(counts.queries.values()) <= most + uavs, "one for each change of the head"


@pytest.mark.parametrize("fault", ["kill {} @0.1s", "freeze {} @0.1s", "partition {}|rest @0", "partition rest>{} @0"])
def test_a_swarm_whose_first_candidates_fail_gets_a_head(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All UAVs of the first window are dead, frozen, cut off or deaf: one of the next window leads soon."""
    first = Rota(swarm(20)).on_duty(0)
    counts = Counts(swarm(20, fault=[fault.format(uav) for uav in first]), monkeypatch)
    assert WINDOW_SLOTS <= counts.led_slots[0] <= 2 * WINDOW_SLOTS
    assert max(counts.listeners.values()) <= most_listeners(swarm(20))
    assert set(counts.led_slots) >= set(range(counts.led_slots[0] + WINDOW_SLOTS, 24)), "it keeps a head"


def test_the_rota() -> None:
    """First those with the most energy, then all others in a drawn order; each is on duty in every round."""
    mission = swarm(10)
    rota = Rota(mission)
    by_energy = sorted(mission.roster, key=lambda entry: -entry.energy_j)
    assert rota.on_duty(-1) == rota.on_duty(0) == tuple(entry.uav for entry in by_energy[:CANDIDATES])
    windows = [rota.on_duty(slot) for slot in range(3 * WINDOW_SLOTS)]
    assert {uav for window in windows for uav in window} == {entry.uav for entry in mission.roster}
    assert all(len(set(window)) == CANDIDATES for window in windows)
    assert windows == [Rota(mission).on_duty(slot + 3 * WINDOW_SLOTS) for slot in range(3 * WINDOW_SLOTS)]
    assert len(Rota(swarm(3)).on_duty(0)) == 3
