"""Recordings of autopilots: what they do not report is not judged, and a stray is judged by its body alone."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np

from edc_swarm.analysis.autopilots import TOLD_AFTER
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.true_paths import parts_of
from edc_swarm.mission.vehicle_model import VehicleModel
from edc_swarm.protocol.messages import Event, Fix, Message, MissionMessage, Truth
from tests.unit.synthetic import Path, flight, recorded, straight, whole

VEHICLE = VehicleModel(model="mavlink", autopilot="udpin:127.0.0.1:{14550+i}", a_max_mps2=4.0)
SLOTS = 30
STRAYS_FROM = 5
PATHS: list[Path] = [
    [*straight((12.0 * k, 0.0), (12.0 * k, 4.0), 8), *((SLOTS - 9) * [(12.0 * k, 4.0)])] for k in range(3)
]


def flown(truth: Iterable[Truth] = (), **fields: Any) -> list[Message]:
    """Return a faultless mission of three autopilots; `truth` replaces those of the same UAVs and slots."""
    fields = {"vehicle": VEHICLE, "lag_slots": 1, "failsafe": "land", "land_after_s": 2.0, "landing_s": 2.0, **fields}
    messages = flight(PATHS, **fields)
    mission = messages[0]
    assert isinstance(mission, MissionMessage)
    parts = parts_of(mission)
    instead = {(each.uav, each.slot): each for each in truth}
    found: list[Message] = []
    for message in messages:
        if isinstance(message, Truth):
            told = instead.get((message.uav, message.slot), message)
            if message.slot < SLOTS - TOLD_AFTER:
                found.append(_with_samples(message, told, parts))
        else:
            found.append(message)
    return whole(found)


def _with_samples(truth: Truth, place: Truth, parts: int) -> Truth:
    between = np.linspace((place.from_x_m, place.from_y_m), (place.to_x_m, place.to_y_m), parts + 1)[1:-1]
    return msgspec.structs.replace(
        truth,
        from_x_m=place.from_x_m,
        from_y_m=place.from_y_m,
        to_x_m=place.to_x_m,
        to_y_m=place.to_y_m,
        waypoint_x_m=truth.to_x_m,
        waypoint_y_m=truth.to_y_m,
        between_x_m=between[:, 0].tolist(),
        between_y_m=between[:, 1].tolist(),
    )


def astray(messages: list[Message], uav: str) -> list[Message]:
    """Let a UAV stray: its fixes say so from `STRAYS_FROM` on, and it accepts no command any more."""
    found: list[Message] = []
    for message in messages:
        if isinstance(message, Fix) and message.uav == uav and message.slot >= STRAYS_FROM:
            rest = PATHS[int(uav[1])][STRAYS_FROM - 1]
            found.append(
                msgspec.structs.replace(
                    message, voter=False, executing=False, command_term=-1, command_seq=-1, stray_m=4.0,
                    waypoint_x_m=rest[0], waypoint_y_m=rest[1], from_x_m=rest[0], from_y_m=rest[1],
                )
            )  # fmt: skip
        elif not (getattr(message, "uav", "") == uav and getattr(message, "slot", 0) >= STRAYS_FROM) or isinstance(
            message, Fix | Truth
        ):
            found.append(message)
    event = Event(source=uav, instance=f"i{uav[1]}", slot=STRAYS_FROM - 1, kind="strayed", detail="left GUIDED")
    return whole([*found, event])


def drift(uav: str, speed_m: float, toward: float = 1.0) -> list[Truth]:
    """Return a way to the east from `STRAYS_FROM` on, `speed_m` a slot, as far north as all targets are."""
    (x_m, _), (_, y_m), places = PATHS[int(uav[1])][STRAYS_FROM - 1], PATHS[0][-1], itertools.count()
    ends = [x_m + toward * speed_m * next(places) for _ in range(STRAYS_FROM, SLOTS + 1)]
    return [
        Truth(uav=uav, slot=slot, from_x_m=a, from_y_m=y_m, to_x_m=b, to_y_m=y_m)
        for slot, (a, b) in enumerate(itertools.pairwise(ends), STRAYS_FROM)
    ]


def verdicts(messages: list[Message]) -> dict[str, GuaranteeResult]:
    """Return the verdicts by guarantee."""
    return {result.guarantee: result for result in check(recorded(messages))}


def test_slots_that_are_told_late_are_judged() -> None:
    """Every slot but the last two is reported: everything is judged, true collisions too."""
    found = verdicts(flown())
    assert {name: found[name].status for name in ("G1", "G2", "G3", "G4")} == dict.fromkeys(
        ("G1", "G2", "G3", "G4"), "held"
    )
    metrics = compute_metrics(recorded(flown()))
    assert metrics.true_collisions == 0
    assert metrics.min_true_distance_m is not None


def test_slots_that_nobody_reported_are_not_judged() -> None:
    """Two slots without a truth of one UAV, and no number missing: where its body was is unknown, which is said."""
    messages = whole([m for m in flown() if not (isinstance(m, Truth) and m.uav == "u1" and m.slot in {3, 4})])
    found = verdicts(messages)
    assert found["G3"].status == found["G4"].status == "not-judged"
    assert "slots that autopilots did not report: 2 of u1" in str(found["G3"])
    metrics = compute_metrics(recorded(messages))
    assert metrics.true_collisions is None
    assert metrics.min_true_distance_m is None


def test_a_stray_that_flies_away_leaves_no_disc() -> None:
    """A pilot flies it 30 m to the west: others keep clear of its hull, which moves with it."""
    away = drift("u0", 3.0, toward=-1.0)
    found = verdicts(astray(flown(away), "u0"))
    assert found["G3"].status == "held", str(found["G3"])
    followed = verdicts(flown(away))["G3"]
    assert [violation.kind for violation in followed.violations] == ["outside-disc"], "one that follows has left it"


def test_a_stray_that_meets_another_body_is_seen_however_late() -> None:
    """Time alone lands no stray: long after the failsafe would have, its reported body still counts."""
    found = verdicts(astray(flown(drift("u1", 0.6)), "u1"))["G3"]
    assert [violation.kind for violation in found.violations] == ["true-collision"]
    assert found.violations[0].slot is not None
    assert found.violations[0].slot > STRAYS_FROM + 2 * 4 + 2, "after its airspace would have been free"


def test_one_that_never_took_off_needs_no_truth() -> None:
    """It said so, and its body is on the ground."""
    messages = [m for m in flown() if not (getattr(m, "uav", "") == "u2" and isinstance(m, Truth))]
    assert verdicts(whole(messages))["G3"].status == "not-judged"
    event = Event(source="u2", instance="i2", slot=0, kind="grounded", detail="it does not arm")
    assert verdicts(whole([*messages, event]))["G3"].status == "held"
