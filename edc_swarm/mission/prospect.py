"""The promise of progress (G7): from which slot on and for which UAVs, from the mission and its faults alone.

A mission is *settled* when its last fault is over: from then on only the swarm itself changes anything. G7 promises
that `limit_slots` later every living UAV is at its target, if a quorum lives. The limit is 20 times the longest
straight flight (of a route: along it, with the time to hover), and 200 slots, of which at least 150 are left when a UAV
that accepts no step has left the airspace (the failsafe). A mission lasts that long unless its file says otherwise
(`max_slots`), so every mission that is not cut short can be judged.

Faults that never end are no reason not to judge. What is promised then:

- *links that lose or delay for good*: the same, if at most half of the messages are lost or late. A UAV
  flies in a slot if its fix and its command come in time, so the limit is divided by the share of the
  commands that do (docs/latency.md, slot arithmetic). A fix is late after `tau_s`; a command is late when
  less than the slot's rest is left, which a slower solver shortens. Of different links the worst counts. A
  measured network is late as long as its trace says;
- *a partition into sides*, between which nothing passes either way: the same to the UAVs of the side that
  has a quorum. The other UAVs are obstacles that hold, and the promise is the one that is made beside the dead;
- *clocks* within `guard_s`, *GPS models*, UAVs that are killed or frozen for good: the same;
- nothing (`Prospect.obstacle` says why) if no side can have a quorum, if a partition is one-way or leaves a UAV
  with links to two sides, if links are worse than that, have a radio range or share a channel, if the router is
  gone for good, if a clock is beyond the guard or drifts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edc_swarm.mission.configuration import Mission, default_tau_s
from edc_swarm.mission.failsafe import failsafe_of
from edc_swarm.mission.fault_targets import resolve
from edc_swarm.mission.faults import (
    ChangeClock,
    ChangeLink,
    Fault,
    Freeze,
    GiveGoal,
    Heal,
    Kill,
    Partition,
    ProcessFault,
    SlowSolver,
    parse_faults,
)
from edc_swarm.mission.field_types import MOST_SLOTS
from edc_swarm.mission.link import FOR_GOOD_S, Link
from edc_swarm.mission.roles import ROUTER
from edc_swarm.mission.routes import hover_time_s, rectangle_m, way_m
from edc_swarm.mission.trace import unpack
from edc_swarm.mission.trace_schedule import Schedule

LEAST_WAIT_SLOTS = 200
"""Slots of the limit beside those for the way: for fail-overs, for waiting, for hulls that vanish."""
MOST_LOSS = 0.5
"""Share of lost or late messages up to which progress is promised."""
FAULT_SLACK_SLOTS = 20
"""Delay of a fault beyond its planned slot for which the mission still lasts long enough."""
COMPLETED, GIVEN_UP, NOBODY_LEFT, STALLED = "completed", "max_slots", "nobody-left", "stalled"
"""All are there; `max_slots` are over; nobody flies any more; nothing can change any more."""


@dataclass(frozen=True, slots=True)
class Prospect:
    """The promise of G7 for a mission that is settled.

    Attributes
    ----------
    limit_slots
        Slots after which every living UAV of `side` is at its target.
    side
        The UAVs that the promise is about: the whole roster unless a partition lasts.
    obstacle
        Reason why nothing is promised; "" if something is.
    lossy
        True if links lose or delay messages for good: a UAV may accept no step for long, by chance.
    """

    limit_slots: int
    side: frozenset[str]
    obstacle: str
    lossy: bool = False


def default_max_slots(mission: Mission) -> int:
    """Return the slots after which a mission without `max_slots` is given up: enough for a verdict on G7."""
    faults = parse_faults(mission)
    slack = FAULT_SLACK_SLOTS if faults else 0
    return min(settled_slot(mission, faults) + prospect_of(mission, faults).limit_slots + slack, MOST_SLOTS)


def settled_slot(mission: Mission, faults: Sequence[Fault]) -> int:
    """Return the first slot in which every fault that ends is over, and every other one has begun."""
    times_s = [time_s for fault in faults for time_s in (fault.at_s, _end_s(fault, faults))]
    times_s += [time_s for link in mission.link for time_s in (link.start_s, link.end_s) if time_s < FOR_GOOD_S]
    return math.ceil(max((time_s for time_s in times_s if math.isfinite(time_s)), default=0.0) / mission.dt_s)


def prospect_of(mission: Mission, faults: Sequence[Fault]) -> Prospect:
    """Return the promise after `faults`, in order of time, with ids in place of `head` and `standby` where known."""
    lasting = [fault for fault in faults if math.isinf(_end_s(fault, faults))]
    partitions = [fault for fault in lasting if isinstance(fault, Partition)]
    side, cut = _quorum_side(mission, partitions) if partitions else (frozenset(e.uav for e in mission.roster), "")
    missed, link = _missed(mission, [fault for fault in lasting if isinstance(fault, ChangeLink)], _slowest(faults))
    obstacle = _router_gone(faults) or _clock_wrong(mission, faults) or cut or link
    straight_slots = _straight_slots(mission, [fault for fault in faults if isinstance(fault, GiveGoal)])
    if straight_slots >= MOST_SLOTS - LEAST_WAIT_SLOTS:
        return Prospect(MOST_SLOTS, side, obstacle)
    failsafe = failsafe_of(mission)
    waits = LEAST_WAIT_SLOTS if failsafe is None else max(LEAST_WAIT_SLOTS, LEAST_WAIT_SLOTS - 50 + failsafe.slots)
    slots = (math.ceil(straight_slots) + waits) / _share_in_time(missed)
    return Prospect(min(math.ceil(slots), MOST_SLOTS), side, obstacle, lossy=missed > 0)


def _straight_slots(mission: Mission, given: Sequence[GiveGoal]) -> float:
    """Return 20 times the slots of the longest way to a target at full speed, with the time to hover on it.

    A UAV that is given a goal may be anywhere between its start and the points that it had before.
    """
    if mission.goals == "lifelong":
        longest_m, slowest_mps = math.dist(*rectangle_m(mission.roster)), min(mission.speeds_mps)
        return 20 * longest_m / (slowest_mps * mission.dt_s)
    ways = (
        20 * entry.straight_m / mission.speed_mps(entry) / mission.dt_s + 20 * hover_time_s(entry) / mission.dt_s
        for entry in mission.roster
    )
    return max([*ways, *_given_slots(mission, given)], default=0.0)


def _given_slots(mission: Mission, given: Sequence[GiveGoal]) -> Iterator[float]:
    """Yield 20 times the slots of the longest way to each goal, from any corner of what all ways so far lie in."""
    roster = {entry.uav: entry for entry in mission.roster}
    places = [point for entry in mission.roster for point in ((entry.start_x_m, entry.start_y_m), *entry.points)]
    for fault in given:
        speed_mps = mission.speed_mps(roster[fault.target]) if fault.target in roster else min(mission.speeds_mps)
        from_m = max(math.dist(place, fault.route[0]) for place in places)
        places += fault.route
        yield 20 * (from_m + way_m(fault.route)) / (speed_mps * mission.dt_s)


def _end_s(fault: Fault, faults: Sequence[Fault]) -> float:
    """Return the mission time at which a fault is over; infinite for one that lasts for good."""
    if isinstance(fault, Partition):
        heals_s = (other.at_s for other in faults if isinstance(other, Heal) and other.at_s >= fault.at_s)
        return min(fault.end_s, *heals_s, math.inf)
    if isinstance(fault, (ChangeLink, SlowSolver)) or math.isfinite(fault.for_s):
        return fault.end_s
    return fault.at_s


def _router_gone(faults: Sequence[Fault]) -> str:
    """Name the fault that takes the router away for good, if there is one."""
    last = [fault for fault in faults if isinstance(fault, ProcessFault) and fault.target == ROUTER]
    if last and isinstance(last[-1], (Kill, Freeze)) and math.isinf(last[-1].for_s):
        return f"'{last[-1]}' takes the router away for good"
    return ""


def _clock_wrong(mission: Mission, faults: Sequence[Fault]) -> str:
    """Name a clock that stays beyond the guard, or drifts, if there is one."""
    last = {fault.target: fault for fault in faults if isinstance(fault, ChangeClock)}
    for fault in last.values():
        if fault.drift_ppm or abs(fault.offset_ms) > 1e3 * mission.guard_s:
            return f"'{fault}' leaves a clock beyond guard_s for good"
    return ""


def _quorum_side(mission: Mission, partitions: Sequence[Partition]) -> tuple[frozenset[str], str]:
    """Return the largest group that lasting partitions leave together, and what forbids a promise to it."""
    roster = [entry.uav for entry in mission.roster]
    whole = frozenset(roster)
    heard = np.ones((len(roster), len(roster)), bool)
    for fault in partitions:
        cut = resolve(fault, "", [], roster)
        if not isinstance(cut, Partition):
            return whole, f"'{fault}' never heals, and whom it cuts off is not known"
        left, right = np.isin(roster, cut.left), np.isin(roster, cut.right)
        heard[np.ix_(left, right)] = False
        if not cut.one_way:
            heard[np.ix_(right, left)] = False
    group = max(_groups(heard | heard.T), key=lambda members: int(members.sum()), default=np.ones(len(roster), bool))
    side = frozenset(uav for uav, inside in zip(roster, group, strict=True) if inside)
    if len(side) < mission.quorum:
        return side, "a partition never heals, and none of its sides can have a quorum"
    if not heard[np.ix_(group, group)].all():
        return side, f"'{partitions[-1]}' never heals, and cuts off some links of a side but not all"
    return side, ""


def _groups(linked: NDArray[np.bool_]) -> Iterator[NDArray[np.bool_]]:
    """Yield the members of every connected group of a symmetric relation."""
    left = np.ones(len(linked), bool)
    while left.any():
        group = np.zeros(len(linked), bool)
        wider = np.arange(len(linked)) == np.argmax(left)
        while (wider != group).any():
            group, wider = wider, linked[wider].any(axis=0)
        yield group
        left &= ~group


def _slowest(faults: Sequence[Fault]) -> SlowSolver | None:
    """Return the fault that slows a solver most, of those that last and that no later one replaces."""
    last = {fault.target: fault for fault in faults if isinstance(fault, SlowSolver)}
    lasting = [fault for fault in last.values() if math.isinf(fault.for_s)]
    return max(lasting, key=lambda fault: fault.by_ms, default=None)


def _missed(mission: Mission, links: Sequence[ChangeLink], slow: SlowSolver | None) -> tuple[float, str]:
    """Return the share of messages lost or late on the worst link that lasts; or 0 and what forbids a promise."""
    slow_ms = slow.by_ms if slow is not None else 0.0
    slot_ms, tau_ms = mission.slot_ns / 1e6, 1e3 * default_tau_s(mission) / mission.time_scale
    spare_ms = min(tau_ms, slot_ms - tau_ms - slow_ms)
    if spare_ms <= 0:
        return 0.0, f"'{slow}' leaves no time for a plan, for good"
    worst, traces = 0.0, {trace.name: trace for trace in mission.trace}
    for rule in _in_force([*mission.link, *(fault.rule() for fault in links)]):
        name, trace = f"the link {rule.sender}>{rule.receiver}", traces.get(rule.trace)
        if rule.model:
            return 0.0, f"{name} has a model of the user's for good"
        if rule.rate_kbps > 0 or (trace is not None and trace.kind == "opportunities"):
            return 0.0, f"{name} shares a channel for good"
        missed = 1 - (1 - _loss(rule)) * (1 - _late(rule, spare_ms)) * (1 - rule.reorder)
        if trace is not None:
            left_ms = spare_ms - rule.delay_ms - rule.jitter_ms
            schedule = Schedule.of(unpack(trace), rule, mission.seed, "")
            missed = 1 - (1 - missed) * (1 - schedule.share_beyond(1000 * left_ms))
        if rule.range_m > 0:
            return 0.0, f"{name} has a radio range for good"
        if missed > MOST_LOSS:
            return 0.0, f"{name} loses or delays {100 * missed:.0f} % of its messages for good"
        worst = max(worst, missed)
    return worst, ""


def _in_force(rules: Iterable[Link]) -> list[Link]:
    """Return the rules that last, without those that a later one replaces."""
    last: dict[tuple[str, str], Link] = {}
    for rule in rules:
        if rule.end_s < FOR_GOOD_S:
            continue
        if rule.sender == rule.receiver == "*":
            last.clear()
        last[rule.sender, rule.receiver] = rule
    return list(last.values())


def _loss(rule: Link) -> float:
    """Return the mean loss of a link, bursts included."""
    if not rule.burst_enter:
        return rule.loss
    bad = rule.burst_enter / (rule.burst_enter + rule.burst_leave)
    return bad * rule.burst_loss + (1 - bad) * rule.loss


def _late(rule: Link, spare_ms: float) -> float:
    """Return the probability that a message takes longer than `spare_ms`."""
    left_ms, jitter_ms = spare_ms - rule.delay_ms, rule.jitter_ms
    if left_ms <= 0:
        return 1.0
    if not jitter_ms:
        return 0.0
    match rule.distribution:
        case "constant":
            return 0.0
        case "uniform":
            return max(0.0, 1 - left_ms / jitter_ms)
        case "normal":
            return math.erfc(left_ms / jitter_ms / math.sqrt(2))
        case "lognormal":
            return 0.5 * math.erfc(math.log(2 * left_ms / jitter_ms) / math.sqrt(2))


def _share_in_time(missed: float) -> float:
    """Return the share of UAV-slots with a command in time, if fixes are sent twice (docs/latency.md).

    With p the share of messages lost or late and k = 1 - p: k^2 (1 + p) / (1 + p k^2).
    """
    kept = 1 - missed
    return kept**2 * (1 + missed) / (1 + missed * kept**2)
