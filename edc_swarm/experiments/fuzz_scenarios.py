"""The missions and fault schedules of the fuzzer: a function of the seed alone.

The generator prefers the faults that break such systems: grants late in a slot, fixes lost just after a grant, freezes
just before a tick, processes stopped between two effects, and a planner that steers UAVs at each other, since safety
must not depend on guidance.
"""

from __future__ import annotations

from collections.abc import Collection
from random import Random
from typing import Any

import msgspec
import numpy as np

from edc_swarm.errors import PlacementError
from edc_swarm.experiments.random_zones import random_zones
from edc_swarm.experiments.variety import new_goals, varied_roster
from edc_swarm.geometry import Floats, length_m
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.mission.vehicle_budget import budget_of, vehicle_of
from edc_swarm.mission.zone import Zone
from edc_swarm.planner.edc import Edc
from edc_swarm.planner.request import Arrays

LAST_FAULT_SLOT = 45
RECKLESS_SLOTS = 70
HEALED_S = 26.0
"""Mission time from which the network is good, if progress is checked."""
RECKLESS = "edc_swarm.experiments.fuzz_scenarios:Reckless"


class Reckless(Edc):
    """The slot QP under adversarial guidance, which sends each UAV to the place of another one, or into a zone."""

    def _wishes(self, arrays: Arrays) -> Floats:
        """Return steps straight towards another UAV, a hull, a barrier or the target, in turn."""
        aims = [arrays.target_m]
        if len(arrays.foreign.uav):
            aims.append(arrays.foreign.position_m)
        if len(arrays.foreign.hulls.keep_m):
            aims.append((arrays.foreign.hulls.a_m + arrays.foreign.hulls.b_m) / 2)
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
            wish_m[k] = to_m * min(1.0, self._u_max_m[arrays.uav[k]] / far_m) if far_m > 0 else 0.0
        return wish_m


def scenario(seed: int, kept: Collection[int] | None = None, *, clusters: bool = False) -> Mission:
    """Return the mission of `seed` with all its faults, or only those at the indices `kept`.

    With `clusters` its UAVs form two to four clusters.
    """
    rng = Random(f"fuzz/{seed}")
    uavs = rng.choice([2, 3, 3, 4, 4, 5, 5, 6, 7, 8])
    names = _cluster_names(Random(f"fuzz/{seed}/clusters"), uavs) if clusters else []
    uavs = max(uavs, len(names))
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
        "resends": Random(f"fuzz/{seed}/resends").choice([0, 2, 10, 40]),
        **_failsafe(Random(f"fuzz/{seed}/failsafe")),
        **_vehicle(Random(f"fuzz/{seed}/vehicle")),
    }
    if clusters and fields["planner"] != RECKLESS:
        # A UAV that stays for good may cover the target of one of another cluster, which G7 does not excuse.
        fields["failsafe"] = "land"
    if fields["planner"] == RECKLESS:
        fields["max_slots"] = RECKLESS_SLOTS
    else:
        fields["link"] = [{**link, "end_s": HEALED_S} for link in fields["link"]]
    mission = _placed(fields)
    varied = varied_roster(Random(f"fuzz/{seed}/roster"), mission)
    roster = varied or msgspec.to_builtins(mission.roster)
    for entry, name in zip(roster, names, strict=False):
        entry["cluster"] = name
    fields["roster"] = roster if varied or clusters else []  # Else the mission draws the same roster itself.
    mission = complete_mission(mission_from_dict({**fields, "roster": roster}))
    zones = random_zones(Random(f"fuzz/{seed}/zones"), mission, with_ways=mission.planner != RECKLESS)
    zoned = msgspec.structs.replace(mission, zone=[msgspec.convert(zone, Zone) for zone in zones])
    faults = _schedule(rng, mission)
    if fields["planner"] != RECKLESS:
        faults += _for_good(Random(f"fuzz/{seed}/for-good"), mission)
    faults += _about_vehicles(Random(f"fuzz/{seed}/about-vehicles"), mission)
    faults += _about_landings(Random(f"fuzz/{seed}/landings"), mission)
    faults += _about_clusters(Random(f"fuzz/{seed}/about-clusters"), mission) if clusters else []
    faults += new_goals(Random(f"fuzz/{seed}/goals"), zoned, LAST_FAULT_SLOT)
    chosen = faults if kept is None else [fault for index, fault in enumerate(faults) if index in kept]
    # The drawn zones have a fence of their own: the area in addition could close a way.
    airspace = {"area_m2": mission.area_m2, "zone": zones, "fence": "none" if zones else "area"}
    return mission_from_dict({**fields, **airspace, "fault": chosen})


def _cluster_names(rng: Random, uavs: int) -> list[str]:
    """Draw the cluster of each UAV: two to four clusters, side by side in the roster or mixed, none empty."""
    count = rng.choice([2, 2, 2, 3, 4])
    names = [f"c{1 + index * count // max(uavs, 2 * count)}" for index in range(max(uavs, 2 * count))]
    if rng.random() < 0.5:
        rng.shuffle(names)
    return names


def _about_clusters(rng: Random, mission: Mission) -> list[str]:
    """Draw what happens to the heads of clusters, and between clusters."""
    names = sorted({entry.cluster for entry in mission.roster})
    one, other = (
        ",".join(entry.uav for entry in mission.roster if entry.cluster == name) for name in rng.sample(names, 2)
    )
    uav, at_s = _id(rng, mission), _slot(rng) * mission.dt_s + rng.choice([0.0, 0.1, 0.21, 0.4, 0.48])
    later_s = at_s + rng.choice([0.0, 0.2, 0.5])
    aims = (
        [f"kill head-{rng.choice(names)} @{at_s:.3f}s"],
        [f"restart head-{rng.choice(names)} @{at_s:.3f}s", f"kill standby-{rng.choice(names)} @{later_s:.3f}s"],
        [f"partition {one}|{other} @{at_s:.3f}s for {rng.randint(1, 15)}"],
        [f"partition {one}>{other} @{at_s:.3f}s for {rng.randint(1, 15)}"],
        [f"partition {one}|{other} @{at_s:.3f}s for {rng.randint(1, 8)}", f"kill head-{names[0]} @{later_s:.3f}s"],
        [f"link {uav}>* loss 0.7 @{at_s:.3f}s for {rng.randint(2, 15)}"],
        [f"link {uav}>* delay {rng.choice([120, 300, 480])} @{at_s:.3f}s for {rng.randint(2, 10)}"],
    )
    return [fault for faults in rng.sample(aims, rng.randint(1, 2)) for fault in faults]


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


def _failsafe(rng: Random) -> dict[str, Any]:
    """Draw the failsafe: none, the default one, or one so short that UAVs land and hulls go within the mission."""
    limits = {"land_after_s": rng.choice([0.5, 3.0, 4.0]), "landing_s": rng.choice([0.0, 0.5, 2.0])}
    return rng.choice([{"failsafe": "hold"}, {}, limits, limits])


def _vehicle(rng: Random) -> dict[str, Any]:
    """Draw vehicle and wind: ideal in half of the missions, else one that brakes for up to a dozen slots.

    A vehicle that cannot stand still between steps allows for no clocks that differ.
    """
    model = {"model": "multirotor", "a_max_mps2": rng.choice([0.8, 1.5, 2.5, 5.0])}
    wind = {"mean_mps": rng.choice([0.0, 4.0, 6.0]), "direction_deg": 30.0 * rng.randrange(12)}
    wind["gust_mps"] = rng.choice([0.0, 1.5, 3.0])
    return {"vehicle": model, "wind": wind, "guard_s": 0.0} if rng.random() < 0.5 else {}


def _about_vehicles(rng: Random, mission: Mission) -> list[str]:
    """Draw what happens to vehicles with inertia: a gust, an outage of GPS, motors as weak as the plan still allows."""
    if mission.vehicle.is_ideal:
        return []
    entry = rng.choice(mission.roster)
    budget, limit_mps2 = budget_of(mission, entry), vehicle_of(mission, entry).limit_mps2
    least = (budget.others_mps2 + budget.command_per_plan * budget.a_max_mps2) / limit_mps2
    faults = [
        f"gust {_id(rng, mission)} {rng.choice([2, 4])}mps @{_slot(rng)} for {rng.randint(2, 8)}",
        f"gps {_id(rng, mission)} outage @{_slot(rng)} for {rng.randint(1, 12)}",
        f"motor {entry.uav} weak {min(1.0, 1.001 * least):.4f} @{_slot(rng)} for {rng.randint(2, 12)}",
    ]
    return rng.sample(faults, rng.randint(0, 2))


def _about_landings(rng: Random, mission: Mission) -> list[str]:
    """Draw, in every other mission with a short failsafe, a UAV that is gone until it lands, or a little longer."""
    failsafe = failsafe_of(mission)
    if failsafe is None or failsafe.slots > LAST_FAULT_SLOT or rng.random() < 0.5:
        return []
    uav, at_s = _id(rng, mission), rng.randint(3, 25) * mission.dt_s + rng.choice([-0.002, 0.001, 0.01, 0.3, 0.45])
    away_s = mission.dt_s * (
        failsafe.wait_slots + rng.choice([0, 1, 2, failsafe.descent_slots, failsafe.descent_slots + 5])
    )
    mid_step = rng.choice(["", " mid-step"])
    return rng.choice(
        [
            [f"kill {uav}{mid_step} @{at_s:.3f}s"],
            [f"kill {uav}{mid_step} @{at_s:.3f}s", f"restart {uav} @{at_s + away_s:.3f}s"],
            [f"freeze {uav}{mid_step} @{at_s:.3f}s for {away_s:.3f}s"],
            [f"partition {uav}|rest @{at_s:.3f}s for {away_s:.3f}s"],
            [f"partition {uav}>rest @{at_s:.3f}s for {away_s:.3f}s"],
        ]
    )


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
