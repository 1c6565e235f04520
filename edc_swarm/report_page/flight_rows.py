"""The table of the UAVs: where each ended, when, how far it flew, what it waited for, and what was lost of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from edc_swarm.analysis.columns import Columns
from edc_swarm.analysis.story import Story
from edc_swarm.protocol.messages import MissionMessage, Report, roster_index
from edc_swarm.recording.model import Recording
from edc_swarm.story.happening import STATES


class FlightRow(Struct, frozen=True):
    """One UAV: None is unknown.

    `held_pct` is the share of the slots from the first flown command until it is home in which it flew no command;
    `unheard_pct` the share of the plans that lacked its fix, of those made while it was heard by the recorder.
    """

    uav: str
    state: str
    home_s: float | None
    way_m: float | None
    held_pct: float | None
    unheard_pct: float | None
    battery_pct: float | None
    led_slots: int | None


def flight_rows(
    recording: Recording,
    columns: Columns,
    story: Story,
    clusters: Mapping[str, Mapping[int, Report]],
    leader: list[int],
) -> list[FlightRow]:
    """Return the rows in roster order; plans by cluster and slot, `leader` the roster indices of all heads."""
    mission = recording.mission
    states = np.array([list(row) for row in story.states], np.uint8).reshape(len(story.states), -1)
    at_target = _at_target(recording, *states.shape)
    flown = np.flatnonzero(columns.executed.any(axis=1))
    first = int(flown[0]) if len(flown) else len(states)
    rows = []
    for k, entry in enumerate(mission.roster):
        away = np.flatnonzero(~at_target[:, k] | columns.lost[:, k])
        home = int(away[-1]) + 1 if len(away) else 0
        counted = slice(first, max(first, home))
        moving = columns.alive[counted, k] & ~columns.lost[counted, k]
        heard = ~np.isnan(columns.energy_j[:, k])
        plans = clusters[entry.cluster]
        asked = [slot for slot in plans if slot < len(heard) and heard[slot]]
        missed = sum(entry.uav in plans[slot].unheard for slot in asked)
        charge = columns.energy_j[heard, k]
        rows.append(
            FlightRow(
                uav=entry.uav,
                state=STATES[states[-1, k]] if len(states) else "unknown",
                home_s=_home_s(home, mission) if home < len(states) else None,
                way_m=None if not len(heard) or columns.lost[:, k].any() else float(columns.step_m[:, k].sum()),
                held_pct=100 * float((moving & ~columns.executed[counted, k]).sum() / moving.sum())
                if moving.any()
                else None,
                unheard_pct=100 * missed / len(asked) if asked else None,
                battery_pct=100 * float(charge[-1]) / entry.energy_j if len(charge) and entry.energy_j else None,
                led_slots=leader.count(k) if plans else None,
            )
        )
    return rows


def _home_s(slot: int, mission: MissionMessage) -> float:
    """Return when a UAV is home that flies its last step in `slot`; 0 is for one that starts at its target."""
    return (slot + 1) * mission.dt_s - mission.guard_s if slot else 0.0


def _at_target(recording: Recording, slots: int, uavs: int) -> NDArray[np.bool_]:
    """Return (S, K) True where a UAV is at its target by its newest fix."""
    index = roster_index(recording.mission.roster)
    said = np.zeros((slots, uavs), np.int8)  # 1: at its target, -1: not, 0: no fix.
    for fix in recording.fixes:
        if fix.slot < slots:
            said[fix.slot, index[fix.uav]] = 1 if fix.arrived else -1
    for now, before in zip(said[1:], said[:-1], strict=True):
        now[now == 0] = before[now == 0]
    return said > 0


def cells(row: FlightRow) -> list[str]:
    """Return the cells of a row as text."""
    return [
        row.uav,
        row.state,
        _text(row.home_s, 1),
        _text(row.way_m, 1),
        _text(row.held_pct, 0),
        _text(row.unheard_pct, 0),
        _text(row.battery_pct, 0),
        _text(row.led_slots, 0),
    ]


HEADINGS = ("UAV", "at the end", "home (s)", "way (m)", "held (%)", "unheard (%)", "battery (%)", "led (slots)")


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
