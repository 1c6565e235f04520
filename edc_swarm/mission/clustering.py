"""The cluster of every UAV, before take-off: as the roster names it, or by k-means of starts and targets."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission

ROUNDS = 50
"""Most rounds of k-means."""
_CLUSTER_STREAM = 2


def with_clusters(mission: Mission) -> Mission:
    """Return the mission, which has a roster, with the cluster of every UAV where there are several clusters.

    Raises
    ------
    MissionError
        There are more clusters than UAVs, some entries name no cluster, or `clusters` and the names do not agree.
    """
    named = [index for index, entry in enumerate(mission.roster) if entry.cluster]
    if not named and mission.clusters == 1:
        return mission
    if mission.clusters > len(mission.roster):
        raise MissionError("clusters", mission.clusters, f"at most the number of UAVs ({len(mission.roster)})")
    if not named:
        names = _kmeans(mission)
    elif len(named) < len(mission.roster):
        index = next(index for index, entry in enumerate(mission.roster) if not entry.cluster)
        raise MissionError(f"roster[{index}].cluster", "", "the name of a cluster, since other entries name theirs")
    else:
        names = [entry.cluster for entry in mission.roster]
    count = len(set(names))
    if mission.clusters not in {1, count}:
        raise MissionError("clusters", mission.clusters, f"{count}, as many as the roster names; none may be empty")
    _check_supported(mission, count)
    roster = [
        msgspec.structs.replace(entry, cluster=name if count > 1 else "")
        for entry, name in zip(mission.roster, names, strict=True)
    ]
    return msgspec.structs.replace(mission, roster=roster, clusters=count)


def _check_supported(mission: Mission, count: int) -> None:
    if count == 1:
        return
    if mission.control == "local":
        raise MissionError("clusters", count, '1 with control = "local", which has no heads')
    if mission.planner != "edc" and ":" not in mission.planner:
        raise MissionError("planner", mission.planner, "edc in a mission with several clusters")


def _kmeans(mission: Mission) -> list[str]:
    """Return the names c1, c2 ... of the clusters of starts and targets that are near each other; none is empty."""
    places_m = np.array([(e.start_x_m, e.start_y_m, e.target_x_m, e.target_y_m) for e in mission.roster])
    rng = np.random.default_rng([mission.seed, _CLUSTER_STREAM])
    centres_m = _seeds(rng, places_m, mission.clusters)
    label = np.full(len(places_m), -1)
    for _ in range(ROUNDS):
        away_m2 = ((places_m[:, None] - centres_m[None]) ** 2).sum(axis=2)
        new = _all_used(np.argmin(away_m2, axis=1), away_m2)
        if (new == label).all():
            break
        label = new
        centres_m = np.array([places_m[label == cluster].mean(axis=0) for cluster in range(mission.clusters)])
    order = list(dict.fromkeys(label.tolist()))
    return [f"c{order.index(cluster) + 1}" for cluster in label.tolist()]


def _seeds(rng: np.random.Generator, places_m: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return first centres (count, 4) that are far from each other (k-means++)."""
    chosen = [int(rng.integers(len(places_m)))]
    while len(chosen) < count:
        away_m2 = ((places_m[:, None] - places_m[chosen][None]) ** 2).sum(axis=2).min(axis=1)
        total_m2 = float(away_m2.sum())
        free = np.setdiff1d(np.arange(len(places_m)), chosen)
        share = away_m2 / total_m2 if total_m2 > 0 else np.isin(np.arange(len(places_m)), free) / len(free)
        chosen.append(int(rng.choice(len(places_m), p=share)))
    return places_m[chosen]


def _all_used(label: NDArray[np.int64], away_m2: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the labels with one UAV moved to each cluster that has none: the UAV farthest from its own centre."""
    label = label.copy()
    for cluster in range(away_m2.shape[1]):
        if (label == cluster).any():
            continue
        spare = np.bincount(label, minlength=away_m2.shape[1])[label] > 1
        own_m2 = np.where(spare, away_m2[np.arange(len(label)), label], -1.0)
        label[int(np.argmax(own_m2))] = cluster
    return label
