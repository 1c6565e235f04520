"""`edc-swarm run` from start to end, with real processes."""

from __future__ import annotations

import json
import os
import signal

import pytest

from processes.cli.main import main
from tests.processes.conftest import Ended, Fly, FlyToEnd, start_command


@pytest.fixture(scope="module")
def default_flight(tmp_path_factory: pytest.TempPathFactory) -> Ended:
    """Fly the default mission once for several tests."""
    path = tmp_path_factory.mktemp("default") / "run.mcap"
    return start_command("run", "--json", "--time-scale", "4", path=path).end()


def test_default_mission_arrives_without_a_collision(default_flight: Ended) -> None:
    """The default mission is the first thing that a user sees."""
    said = default_flight.json
    assert default_flight.status == 0, default_flight.stderr
    assert said["arrived"] == said["uavs"] == 10
    assert said["potential_collisions"] == said["true_collisions"] == said["gaps"] == 0
    verdicts = {guarantee["guarantee"]: guarantee["status"] for guarantee in said["guarantees"]}
    assert verdicts.pop("G6") == "not-applicable"
    assert verdicts.pop("G8") in {"held", "not-applicable"}, "the latter without a fence"
    assert verdicts == {f"G{number}": "held" for number in (1, 2, 3, 4, 5, 7)}


def test_ten_distinct_processes_published(default_flight: Ended) -> None:
    """The process id is part of the instance."""
    pids = {fix.instance.split("-")[0] for fix in default_flight.recording.fixes}
    assert len(pids) == 10


def test_one_head_per_term_and_first_commands_by_slot_three(default_flight: Ended) -> None:
    """Listen, grant, plan, fly: three slots, unless the machine was too slow."""
    heads = default_flight.json["heads"]
    assert len({head["term"] for head in heads}) == len(heads)
    flown = [fix.slot for fix in default_flight.recording.fixes if fix.executing]
    overloaded = default_flight.json["ticks_late_pct"] > 1
    assert min(flown) <= 3 or overloaded
    assert "connected" in default_flight.stderr


def test_summary_is_what_metrics_says(default_flight: Ended, capsys: pytest.CaptureFixture[str]) -> None:
    """Every figure comes from the recording."""
    assert main(["metrics", str(default_flight.path), "--json"]) == 0
    metrics = json.loads(capsys.readouterr().out)
    assert metrics.items() <= default_flight.json.items()


def test_every_publisher_said_its_last_word(default_flight: Ended) -> None:
    """The last messages prove the end of every stream."""
    completeness = default_flight.json["guarantees"][4]
    assert completeness["guarantee"] == "G5"
    assert completeness["notes"] == []


def test_run_metadata_and_nothing_else_is_left(default_flight: Ended) -> None:
    """Empty logs, state files and the part are removed."""
    run = default_flight.recording.run
    assert {"command", "commit", "machine", "python", "version edc-swarm"} <= run.keys()
    assert run["clock"] == "wall"
    assert [entry.name for entry in default_flight.path.parent.iterdir()] == ["run.mcap"]


@pytest.mark.long
def test_straight_planner_collides_and_check_names_the_pairs(run: FlyToEnd, capsys: pytest.CaptureFixture[str]) -> None:
    """A run that breaks a guarantee has that exit status."""
    ended = run("--planner", "straight", "--uavs", "30")
    assert ended.status == 1
    assert ended.json["potential_collisions"] > 10
    assert main(["check", str(ended.path)]) == 1
    shown = capsys.readouterr().out
    assert "G3 Separation: broken" in shown
    assert "discs overlap by up to" in shown


@pytest.mark.long
def test_a_process_killed_by_hand_is_told_and_the_others_finish(start: Fly) -> None:
    """The run reports and records a death that no fault caused."""
    command = start("run", "--json", "--time-scale", "4")
    command.await_flight(10)
    os.kill(command.uav_pids()[6], signal.SIGKILL)
    ended = command.end()
    assert ended.json["potential_collisions"] == ended.json["gaps"] == 0
    assert len(ended.json["not_living"]) == 1
    assert f"{ended.json['not_living'][0]} was ended by SIGKILL" in ended.stderr
    assert any(event.kind == "exited" for event in ended.recording.events)
    assert ended.status == 1
    assert not ended.json["completed"]
    (dead,) = [who for who in ended.json["not_home"] if who["uav"] in ended.json["not_living"]]
    assert (dead["cause"], "was ended by SIGKILL" in dead["reason"]) == ("process-gone", True)


@pytest.mark.long
def test_a_process_frozen_for_good_by_hand_is_not_home(start: Fly) -> None:
    """Only its silence shows the freeze; all others arrive, and the status says that one UAV did not."""
    command = start("run", "--json", "--time-scale", "4", "--uavs", "4", "--max-slots", "60")
    command.await_flight(4)
    os.kill(command.uav_pids()[2], signal.SIGSTOP)
    ended = command.end()
    assert ended.status == 1
    (silent,) = [who for who in ended.json["not_home"] if who["uav"] in ended.json["not_living"]]
    assert (silent["cause"], ended.json["completed"]) == ("silent", False)


@pytest.mark.long
def test_two_missions_side_by_side(start: Fly) -> None:
    """Each mission has its own id and port."""
    flights = [
        start("run", "--json", "--time-scale", "4", "--uavs", "5", "--seed", str(seed), name=f"{seed}.mcap")
        for seed in (1, 2)
    ]
    for ended in [flight.end() for flight in flights]:
        assert ended.json["potential_collisions"] == ended.json["gaps"] == 0
        assert ended.json["uavs"] == len({fix.uav for fix in ended.recording.fixes}) == 5
    assert len({flight.path for flight in flights}) == 2


def test_response_times_are_measured_at_the_start(run: FlyToEnd) -> None:
    """Each UAV measures its response time before it connects."""
    ended = run("--elect", "response-time", "--uavs", "5")
    assert ended.json["arrived"] == 5
    assert all(fix.response_ms > 0 for fix in ended.recording.fixes)
