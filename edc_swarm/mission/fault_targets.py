"""The targets of a fault: ids in place of words such as `head` and `rest`, when the fault begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from edc_swarm.mission.fault_syntax import HALVES, HEAD, REST, STANDBY
from edc_swarm.mission.faults import Fault, Partition


def resolve(
    fault: Fault,
    head: str,
    standbys: Sequence[str],
    roster: Sequence[str],
    in_office: Mapping[str, str] = MappingProxyType({}),
) -> Fault | None:
    """Return the fault with ids in place of `head`, `standby`, `halves`, `rest`; None if one stands for no UAV now.

    `in_office` has the ids for the words of several clusters: `head-NAME`, `standby-NAME`.
    """
    ids = {HEAD: head, STANDBY: standbys[0] if standbys else "", **in_office}
    if isinstance(fault, Partition):
        return _resolve_groups(fault, ids, roster)
    names = {field: getattr(fault, field) for field in fault.declaration.names}
    found = {field: ids.get(name, name) for field, name in names.items()}
    return replace(fault, **found) if all(found.values()) else None


def _resolve_groups(fault: Partition, ids: dict[str, str], roster: Sequence[str]) -> Partition | None:
    left, right = (tuple(ids.get(name, name) for name in group) for group in (fault.left, fault.right))
    left, right = tuple(filter(None, left)), tuple(filter(None, right))
    if fault.left == (HALVES,):
        left, right = tuple(roster[: len(roster) // 2]), tuple(roster[len(roster) // 2 :])
    elif fault.right == (REST,):
        right = tuple(uav for uav in roster if uav not in left)
    elif fault.left == (REST,):
        left = tuple(uav for uav in roster if uav not in right)
    return replace(fault, left=left, right=right) if left and right else None
