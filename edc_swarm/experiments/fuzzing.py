"""The fuzzer: random missions under random fault schedules, with every guarantee checked.

A run is a function of its seed: `scenario(seed)` draws a mission and a schedule, `fly` simulates it and returns the
violations. `smallest` drops faults one by one while a violation remains. The generator prefers the faults that break
such systems: grants late in a slot, fixes lost just after a grant, freezes just before a tick, processes stopped
between two effects, and a planner that steers UAVs at each other, since safety must not depend on guidance.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edc_swarm.analysis.breaches import breaches
from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.progress import PROGRESS
from edc_swarm.errors import PlacementError
from edc_swarm.experiments.random_zones import random_zones
from edc_swarm.geometry import DISC_TOLERANCE_M, Floats, length_m, segment_distance_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.edc import Edc
from edc_swarm.planner.registry import make_planner
from edc_swarm.planner.request import Arrays
from edc_swarm.protocol.messages import Message, MissionMessage, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.computers import Motion
from edc_swarm.simulation.simulator import Simulation

CHECKED = ("G1", "G2", "G3", "G4", "G5", "G8")
"""Guarantees that are checked with every planner; `PROGRESS` only with one that completes missions."""
LAST_FAULT_SLOT = 45
RECKLESS_SLOTS = 70
HEALED_S = 26.0
"""Mission time from which the network is good, if progress is checked."""
RECKLESS = "edc_swarm.experiments.fuzzing:Reckless"


@dataclass(frozen=True, slots=True)
class Counterexample:
    """A run that violates a guarantee: its seed, the indices of its faults, and the violations."""

    seed: int
    kept: tuple[int, ...]
    broken: tuple[str, ...]

    @property
    def command(self) -> str:
        """The command line that repeats this run."""
        kept = ",".join(str(index) for index in self.kept)
        return f"edc-swarm fuzz --seed {self.seed} --runs 1 --keep {kept or 'none'}"


class Reckless(Edc):
    """The slot QP under adversarial guidance, which sends each UAV to the place of another one, or into a zone."""

    def _wishes(self, arrays: Arrays) -> Floats:
        """Return steps straight towards another UAV, a hull, a barrier or the target, in turn."""
        aims = [arrays.target_m]
        if len(arrays.uav) > 1:
            aims.append(arrays.position_m)
        if len(arrays.obstacles.keep_m):
            aims.append((arrays.obstacles.a_m + arrays.obstacles.b_m) / 2)
        barriers = self._airspace.barriers
        if len(barriers.a_m):
            aims.append((barriers.a_m + barriers.b_m) / 2)
        rng = Random(f"{arrays.slot // 6}/{len(arrays.uav)}")
        wish_m = np.empty_like(arrays.position_m)
        for k, here_m in enumerate(arrays.position_m):
            aim = rng.choice(aims)
            to_m = (arrays.target_m[k] if aim is arrays.target_m else rng.choice(list(aim))) - here_m
            far_m = float(length_m(to_m))
            wish_m[k] = to_m * min(1.0, self._u_max_m / far_m) if far_m > 0 else 0.0
        return wish_m


def scenario(seed: int, kept: Collection[int] | None = None) -> Mission:
    """Return the mission of `seed` with all its faults, or only those at the indices `kept`."""
    rng = Random(f"fuzz/{seed}")
    uavs = rng.choice([2, 3, 3, 4, 4, 5, 5, 6, 7, 8])
    fields: dict[str, Any] = {
        "name": f"fuzz-{seed}",
        "seed": seed,
        "uavs": uavs,
        "area_m2": uavs * rng.choice([250.0, 400.0, 900.0]),
        "gps_model": rng.choice(["none", "bias", "white", "gauss-markov"]),
        "elect": rng.choice(["energy", "response-time"]),
        "guard_s": rng.choice([0.0, 0.0, 0.04]),
        "lag_slots": rng.choice([0, 0, 0, 1]),
        "lease_slots": rng.choice([1, 2, 2, 3]),
        "standbys": rng.choice([0, 0, 1, 3, 3]),
        "handover_margin": rng.choice([0.0, 0.1]),
        "planner": rng.choice([RECKLESS, RECKLESS, RECKLESS, "edc"]),
        "link": _links(rng),
    }
    if fields["planner"] == RECKLESS:
        fields["max_slots"] = RECKLESS_SLOTS
    else:
        fields["link"] = [{**link, "end_s": HEALED_S} for link in fields["link"]]
    mission = _placed(fields)
    zones = random_zones(Random(f"fuzz/{seed}/zones"), mission, with_ways=mission.planner != RECKLESS)
    faults = _schedule(rng, mission)
    if fields["planner"] != RECKLESS:
        faults += _for_good(Random(f"fuzz/{seed}/for-good"), mission)
    chosen = faults if kept is None else [fault for index, fault in enumerate(faults) if index in kept]
    return mission_from_dict({**fields, "area_m2": mission.area_m2, "fault": chosen, "zone": zones})


def fly(mission: Mission) -> list[str]:
    """Simulate a mission, and return one line for each violation and each guarantee that could not be judged."""
    message = mission_message(complete_mission(mission))
    said: list[Message] = []
    simulation = Simulation(
        message, lambda: make_planner(mission.planner, message), lambda _key, said_now, _ns: said.append(said_now)
    )
    try:
        end = simulation.run()
    except AssertionError as error:
        return [f"assertion: {error}"]
    seen = [*overlaps(message, end.motions), *trespasses(message, end.motions)]
    return [*seen, *_broken(Recording.from_messages(said), _asked(mission))]


def search(seed: int, kept: Collection[int] | None = None) -> Counterexample | None:
    """Run the scenario of `seed`; return None if every guarantee held."""
    mission = scenario(seed, kept)
    broken = fly(mission)
    if not broken:
        return None
    indices = tuple(sorted(kept)) if kept is not None else tuple(range(len(mission.fault)))
    return Counterexample(seed, indices, tuple(broken))


def smallest(finding: Counterexample) -> Counterexample:
    """Drop faults one by one while a violation remains, and return the smallest such run."""
    index = 0
    while index < len(finding.kept):
        fewer = search(finding.seed, finding.kept[:index] + finding.kept[index + 1 :])
        if fewer is None:
            index += 1
        else:
            finding = fewer
    return finding


def overlaps(mission: MissionMessage, motions: Sequence[Motion]) -> list[str]:
    """Return one line for each pair whose discs could overlap while flying `motions`, at any pace within each slot.

    The check compares the two segments flown in a slot as sets of points. The segment of the previous slot counts
    too with `lag_slots` 1, or if the UAV began it too late to finish it in time. A UAV that dies or freezes stays at
    the end of its last step.
    """
    first, last = _paths(mission, motions)
    before_first, before_last = first.copy(), last.copy()
    still = _still_flying(mission, motions, len(first))
    before_first[1:][still[:-1]], before_last[1:][still[:-1]] = first[:-1][still[:-1]], last[:-1][still[:-1]]
    r_m = np.array([entry.r_m for entry in mission.roster])
    i, j = np.triu_indices(len(r_m), 1)
    gap_m = np.minimum.reduce(
        [
            _gaps(first, last, first, last, i, j),
            _gaps(before_first, before_last, first, last, i, j),
            _gaps(first, last, before_first, before_last, i, j),
        ]
    )
    bad = np.argwhere(gap_m < r_m[i] + r_m[j] - DISC_TOLERANCE_M)
    ids = [entry.uav for entry in mission.roster]
    return [
        f"G3: {ids[i[pair]]} and {ids[j[pair]]} can come within {gap_m[slot, pair]:.6f} m in slot {slot}"
        for slot, pair in bad[:10]
    ]


def trespasses(mission: MissionMessage, motions: Sequence[Motion]) -> list[str]:
    """Return one line for each zone and UAV whose accepted steps break it, those of dying UAVs included."""
    if not motions:
        return []
    r_m = {entry.uav: entry.r_m for entry in mission.roster}
    p_m, q_m = (np.array([getattr(motion, end) for motion in motions]) for end in ("from_m", "to_m"))
    said: dict[tuple[str, str], str] = {}
    for zone in mission.zone:
        keep_m = np.array([r_m[motion.uav] * zone.keeps_disc for motion in motions])
        breach_m, _ = breaches(zone, p_m, q_m, keep_m)
        for row in np.flatnonzero(breach_m > DISC_TOLERANCE_M).tolist():
            uav, slot = motions[row].uav, motions[row].slot
            said.setdefault((zone.name, uav), f"G8: {uav} breaks {zone.name} by {breach_m[row]:.6f} m in slot {slot}")
    return list(said.values())[:10]


def _gaps(a: Floats, b: Floats, c: Floats, d: Floats, i: Any, j: Any) -> Floats:
    """Return the distances (slots, pairs) of the segments a-b of UAVs i from the segments c-d of UAVs j."""
    return segment_distance_m(a[:, i], b[:, i], c[:, j], d[:, j])


def _paths(mission: MissionMessage, motions: Sequence[Motion]) -> tuple[Floats, Floats]:
    """Return start and end points (slots, UAVs, 2) of the segment that each UAV flew in each slot."""
    index = {entry.uav: k for k, entry in enumerate(mission.roster)}
    starts = np.array([(entry.start_x_m, entry.start_y_m) for entry in mission.roster])
    slots = max((motion.slot for motion in motions), default=0) + 2
    first = np.broadcast_to(starts, (slots, *starts.shape)).copy()
    last = first.copy()
    for motion in motions:
        k = index[motion.uav]
        first[motion.slot, k] = motion.from_m
        last[motion.slot, k] = motion.to_m
        first[motion.slot + 1 :, k] = last[motion.slot + 1 :, k] = motion.to_m
    return first, last


def _still_flying(mission: MissionMessage, motions: Sequence[Motion], slots: int) -> NDArray[np.bool_]:
    """Return (slots, UAVs) flags: True if the step of a slot may last into the next one."""
    index = {entry.uav: k for k, entry in enumerate(mission.roster)}
    still = np.full((slots, len(index)), bool(mission.lag_slots))
    for motion in motions:
        still[motion.slot, index[motion.uav]] |= motion.late
    return still


def _asked(mission: Mission) -> tuple[str, ...]:
    """Return the guarantees to check on a mission."""
    return CHECKED if mission.planner == RECKLESS else (*CHECKED, PROGRESS)


def _broken(recording: Recording, asked: Collection[str]) -> list[str]:
    """Return the violations of the given guarantees; a guarantee that could not be judged counts as one."""
    results = {result.guarantee: result for result in check(recording)}
    said: list[str] = []
    for result in map(results.__getitem__, asked):
        said += [f"{result.guarantee}: {found.text}" for found in result.violations[:5]]
        said += [] if result.judged else [f"{result.guarantee}: not judged: {'; '.join(result.notes)}"]
    return said


def _placed(fields: dict[str, Any]) -> Mission:
    """Return the mission, on an area enlarged until its UAVs fit."""
    while True:
        mission = mission_from_dict(fields)
        try:
            return complete_mission(mission)
        except PlacementError:
            fields = {**fields, "area_m2": 1.5 * fields["area_m2"]}


def _links(rng: Random) -> list[dict[str, Any]]:
    """Draw the links of a network: good, slow, lossy, or slow and lossy."""
    kind = rng.choice(["good", "good", "lossy", "slow", "bad"])
    if kind == "good":
        return []
    link: dict[str, Any] = {"distribution": rng.choice(["uniform", "normal", "lognormal"])}
    if kind in {"lossy", "bad"}:
        link["loss"] = rng.choice([0.1, 0.3, 0.5])
    if kind in {"slow", "bad"}:
        link |= {"delay_ms": rng.choice([50.0, 120.0, 180.0, 260.0]), "jitter_ms": rng.choice([0.0, 50.0, 200.0])}
    if rng.random() < 0.5:
        link |= {"duplicate": 0.2, "reorder": 0.2}
    return [link]


def _schedule(rng: Random, mission: Mission) -> list[str]:
    """Draw up to eight faults, some of them as targeted sequences of two or three."""
    faults: list[str] = []
    while len(faults) < rng.randint(1, 8):
        faults += rng.choice(_AIMS)(rng, mission)
    return faults[:12]


def _for_good(rng: Random, mission: Mission) -> list[str]:
    """Draw, in every third mission whose progress is checked, a fault without an end after which G7 still applies."""
    at, ids = f"@{_slot(rng)}", [entry.uav for entry in mission.roster]
    minority = ",".join(rng.sample(ids, max(1, (len(ids) - 1) // 2)))
    lasting = (
        f"link *>* loss {rng.choice([0.1, 0.3, 0.5])} {at}",
        f"partition {minority}|rest {at}",
        f"freeze {ids[0]} {at}",
    )
    return [rng.choice(lasting)] if rng.random() < 1 / 3 else []


def _slot(rng: Random) -> int:
    return rng.randint(1, LAST_FAULT_SLOT)


def _uav(rng: Random, mission: Mission) -> str:
    return rng.choice([entry.uav for entry in mission.roster] + ["head", "head", "standby"])


def _id(rng: Random, mission: Mission) -> str:
    return rng.choice([entry.uav for entry in mission.roster])


def _crash_and_return(rng: Random, mission: Mission) -> list[str]:
    """Draw the death of a process, perhaps between two effects, and perhaps its restart."""
    uav, at_s = _id(rng, mission), _slot(rng) * mission.dt_s + rng.choice([0.001, 0.01, 0.2, 0.3, 0.45])
    mid_step = " mid-step" if rng.random() < 0.5 else ""
    back_s = at_s + rng.choice([0.004, 0.1, 0.5, 0.6, 1.0, 4.0])
    memory = " lose-memory" if rng.random() < 0.15 else ""
    return [f"kill {uav}{mid_step} @{at_s:.3f}s", f"restart {uav}{memory} @{back_s:.3f}s"]


def _death(rng: Random, mission: Mission) -> list[str]:
    return [f"kill {_uav(rng, mission)} @{_slot(rng) * mission.dt_s + rng.random() * mission.dt_s:.3f}s"]


def _freeze_before_tick(rng: Random, mission: Mission) -> list[str]:
    """Draw a freeze that starts just before a slot and ends late in it or some slots later."""
    at_s = _slot(rng) * mission.dt_s - rng.choice([0.0005, 0.002, 0.01, 0.05])
    for_s = rng.choice([0.06, 0.3 * mission.dt_s, 0.36 * mission.dt_s, 0.9 * mission.dt_s, 1.3, 2.6])
    mid_step = " mid-step" if rng.random() < 0.3 else ""
    return [f"freeze {_uav(rng, mission)}{mid_step} @{max(at_s, 0.0):.4f}s for {for_s:.3f}s"]


def _partition(rng: Random, mission: Mission) -> list[str]:
    ids = [entry.uav for entry in mission.roster]
    rng.shuffle(ids)
    split = rng.randint(1, len(ids) - 1)
    groups = rng.choice(
        [
            "halves",
            f"{','.join(ids[:split])}|{','.join(ids[split:])}",
            f"{','.join(ids[:split])}>{','.join(ids[split:])}",
            "head|rest",
            "head>rest",
            "rest>head",
        ]
    )
    return [f"partition {groups} @{_slot(rng) * mission.dt_s + rng.random() * 0.4:.3f}s for {rng.randint(1, 15)}"]


def _mute_after_grant(rng: Random, mission: Mission) -> list[str]:
    """Draw the death of the head, with one other UAV unheard during the new grants."""
    at_s, uav = _slot(rng) * mission.dt_s + rng.choice([0.0, 0.1, 0.3, 0.4, 0.48]), _id(rng, mission)
    mute_s = at_s + rng.choice([0.0035, 0.004, 0.0045, 0.2, 0.5])
    groups = rng.choice([f"{uav}>rest", f"rest>{uav}", f"{uav}|rest"])
    return [f"kill head @{at_s:.4f}s", f"partition {groups} @{mute_s:.4f}s for {rng.randint(1, 6)}"]


def _restart_and_mute(rng: Random, mission: Mission) -> list[str]:
    """Draw a restart of the head while a UAV that it has just commanded is unheard."""
    at_s, uav = _slot(rng) * mission.dt_s + rng.choice([0.002, 0.01, 0.21, 0.4]), _id(rng, mission)
    mute_s = at_s + rng.choice([0.0, 0.01, 0.2])
    return [f"restart head @{at_s:.4f}s", f"partition {uav}>rest @{mute_s:.4f}s for {rng.randint(1, 6)}"]


def _late_grant(rng: Random, mission: Mission) -> list[str]:
    """Draw a change of heads while one UAV's messages take most of a slot."""
    at_s, uav = _slot(rng) * mission.dt_s + rng.random() * mission.dt_s, _id(rng, mission)
    slow = f"link {uav}>* delay {rng.choice([150, 300, 440, 480, 700])} @{max(0.0, at_s - 0.6):.3f}s for 6"
    return [slow, f"{rng.choice(['kill', 'restart', 'freeze'])} head @{at_s:.3f}s"]


def _lossy_while(rng: Random, mission: Mission) -> list[str]:
    del mission
    slot = _slot(rng)
    loss = rng.choice([0.3, 0.6, 0.9])
    return [f"link *>* loss {loss} duplicate 0.3 reorder 0.3 @{slot} for {rng.randint(1, 10)}"]


def _clock(rng: Random, mission: Mission) -> list[str]:
    """Draw a clock offset within the guard, as the guarantees assume."""
    guard_ms = 1e3 * mission.guard_s
    if guard_ms == 0:
        return []
    offset_ms = round(rng.uniform(-0.95, 0.95) * guard_ms, 3)
    return [f"clock {_id(rng, mission)} offset {offset_ms} @{rng.choice([0, _slot(rng)])}"]


def _slow_solver(rng: Random, mission: Mission) -> list[str]:
    return [f"slow {_uav(rng, mission)} {rng.choice([50, 290, 450, 600, 1200])} @{_slot(rng)} for {rng.randint(1, 20)}"]


def _router(rng: Random, mission: Mission) -> list[str]:
    del mission
    return [f"restart router @{_slot(rng)}"]


def _gps(rng: Random, mission: Mission) -> list[str]:
    return [f"gps {_id(rng, mission)} {rng.choice(['bias', 'white', 'gauss-markov'])} @{_slot(rng)}"]


_AIMS = (
    _crash_and_return,
    _crash_and_return,
    _death,
    _freeze_before_tick,
    _freeze_before_tick,
    _partition,
    _partition,
    _mute_after_grant,
    _mute_after_grant,
    _restart_and_mute,
    _restart_and_mute,
    _late_grant,
    _late_grant,
    _lossy_while,
    _clock,
    _slow_solver,
    _router,
    _gps,
)
