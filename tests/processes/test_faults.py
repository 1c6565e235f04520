"""Faults on real processes: SIGKILL, SIGSTOP, partitions above the bus, a router that restarts.

Each has one trial; `benchmarks/` has many. The tests check the guarantees on the recording.
"""

from __future__ import annotations

import pytest

from tests.processes.conftest import Fly, FlyToEnd

pytestmark = pytest.mark.timing

FAULTS = {
    "two heads killed within three slots": ["kill head @10", "kill head @12"],
    "head frozen and resumed": ["freeze head @10 for 10s"],
    "nobody has a quorum": ["partition halves @10 for 10"],
    "cut off and healed": ["partition head|rest @10", "heal @16"],
    "restarted, one of them without memory": ["kill u003 @6", "restart u003 @12", "restart u005 lose-memory @4.2s"],
    "links bad, clock off, GPS changed, solver slow": [
        "link *>* delay 10 jitter 10 loss 0.1 duplicate 0.1 reorder 0.1 @4 for 15",
        "clock u002 offset 5 @6",
        "gps u003 white @6",
        "slow head 40 @8 for 5",
    ],
}
SAFE = ("G1", "G2", "G3", "G4", "G5")


@pytest.mark.parametrize("faults", FAULTS.values(), ids=FAULTS)
def test_guarantees_hold(run: FlyToEnd, faults: list[str]) -> None:
    """In one trial no message is missing, no guarantee is broken, and the fault is recorded."""
    ended = run(*(word for fault in faults for word in ("--fault", fault)))
    verdicts = {verdict["guarantee"]: verdict for verdict in ended.json["guarantees"]}
    assert [verdicts[name]["status"] for name in SAFE] == ["held"] * len(SAFE), ended.stdout
    assert verdicts["G7"]["status"] != "broken"
    told = [event.detail for event in ended.recording.events if event.kind == "fault"]
    assert len(told) == len(faults)


def test_freezes_that_overlap(run: FlyToEnd) -> None:
    """The longest freeze counts: the end of a shorter one inside it resumes no UAV."""
    ended = run("--fault", "freeze u003 @6 for 9", "--fault", "freeze u003 @8 for 2")
    said = {fix.slot for fix in ended.recording.fixes if fix.uav == "u003"}
    assert not said & set(range(8, 14))
    assert max(said) >= 15


def test_router_restarted(run: FlyToEnd) -> None:
    """Messages inside the router die with it; their publishers are alive and retransmit them."""
    ended = run("--fault", "restart router @10")
    verdicts = {verdict["guarantee"]: verdict["status"] for verdict in ended.json["guarantees"]}
    assert [verdicts[name] for name in SAFE] == ["held"] * len(SAFE), ended.stdout
    assert ended.json["arrived"] == 10


def test_what_a_killed_uav_said_last_stays_unknown(run: FlyToEnd) -> None:
    """The check names the streams of a dead publisher as unknown; requests to it delay no other process."""
    ended = run("--fault", "kill u003 @10")
    (notes,) = (verdict["notes"] for verdict in ended.json["guarantees"] if verdict["guarantee"] == "G5")
    (instance,) = {fix.instance for fix in ended.recording.fixes if fix.uav == "u003"}
    assert [note for note in notes if note.startswith("end unknown") and note.endswith(instance)] == notes


def test_recorder_killed_loses_at_most_the_last_second(start: Fly) -> None:
    """A second is eight slots here; two more are for messages on their way. Status 3: most is not judged."""
    ended = start("run", "--json", "--time-scale", "4", "--fault", "kill recorder @16").end()
    assert "the recorder died; recovered" in ended.stderr
    last_slot = max(fix.slot for fix in ended.recording.fixes)
    assert last_slot >= 16 - 8 - 2
    assert (ended.status, ended.json["gaps"], ended.json["potential_collisions"]) == (3, None, None)


def test_a_late_joiner_learns_of_faults_in_force(run: FlyToEnd) -> None:
    """A UAV that restarts inside a partition stays cut off."""
    ended = run("--fault", "partition u003|rest @6 for 20", "--fault", "restart u003 @10")
    fixes = [fix for fix in ended.recording.fixes if fix.uav == "u003" and 12 <= fix.slot < 25]
    assert not any(fix.executing for fix in fixes)
    assert ended.json["potential_collisions"] == 0
