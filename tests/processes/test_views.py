"""Recordings with a view, replayed and recovered; and one line for a bad file."""

from __future__ import annotations

import json
import socket
import threading
from collections import Counter
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest
import zenoh
from mcap.reader import make_reader

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import mission_message
from edc_swarm.recording.mcap_file import Channel, McapFile
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.writer import RecordingWriter
from processes.bus.address import free_endpoint
from processes.bus.session import open_client, open_router
from processes.cli.main import main
from processes.runtime.run_facts import run_facts
from processes.services.live import HOST, PORT, live_port

MISSION_MESSAGE = mission_message(complete_mission(Mission(uavs=2)))
GOLDEN = Path(__file__).parents[2] / "recordings" / "golden.mcap"
MISSION = ("--uavs", "4", "--area", "2500", "--fault", "kill head @6")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a simulated mission with its view."""
    path = tmp_path_factory.mktemp("sim") / "run.mcap"
    assert main(["sim", *MISSION, "--json", "--out", str(path)]) == 1  # the killed head is not home
    return path


def topics(path: Path) -> Counter[str]:
    """Return the number of messages per topic."""
    return Counter(channel.topic for channel, *_ in McapFile(path).messages())


def test_same_seed_same_bytes_with_the_view(simulated: Path) -> None:
    """G6 holds for scenes too."""
    again = simulated.with_name("again.mcap")
    assert main(["sim", *MISSION, "--json", "--out", str(again)]) == 1
    assert again.read_bytes() == simulated.read_bytes()


def test_a_view_added_later_is_the_view_recorded_at_once(simulated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A view does not change any metric; it has the plan times of a simulation if these are beside the recording."""
    bare = simulated.with_name("bare.mcap")
    assert main(["sim", *MISSION, "--no-viz", "--json", "--out", str(bare)]) == 1
    assert not any(topic.startswith("/viz") for topic in topics(bare))
    capsys.readouterr()
    timed = bare.with_name("timed.mcap")
    assert main(["visualise", str(bare), "-o", str(timed)]) == 0
    statuses = [json.loads(payload) for c, *_, payload in McapFile(timed).messages() if c.topic == "/viz/status"]
    assert statuses
    assert all(status["plan_ms"] > 0 for status in statuses)
    bare.with_suffix(".timings.json").unlink()
    capsys.readouterr()
    assert main(["visualise", str(bare)]) == 0
    seen = Path(capsys.readouterr().out.strip())
    assert list(McapFile(seen).messages()) == list(McapFile(simulated).messages())
    assert compute_metrics(read_recording(seen)) == compute_metrics(read_recording(bare))
    with seen.open("rb") as stream:
        layout = next(a for a in make_reader(stream).iter_attachments() if a.name == "foxglove-layout.json")
    assert "3D!swarm" in json.loads(layout.data)["configById"]


def test_replay_gives_the_bus_back_byte_for_byte(simulated: Path) -> None:
    """Every key and payload comes in the order of the record, scenes under their keys of the bus."""
    endpoint = free_endpoint()
    heard: list[tuple[str, bytes]] = []
    done = threading.Event()
    expected = list(McapFile(simulated).messages())
    root = Keys(read_recording(simulated).mission.name).root

    def take(sample: zenoh.Sample) -> None:
        heard.append((str(sample.key_expr), sample.payload.to_bytes()))
        if len(heard) == len(expected):
            done.set()

    router = open_router(endpoint)
    listener = open_client(endpoint)
    listener.declare_subscriber("swarm/**", zenoh.handlers.Callback(take, indirect=False))
    assert main(["replay", str(simulated), "--connect", endpoint, "--speed", "1000"]) == 0
    assert done.wait(60)
    listener.close()
    router.close()
    keys = [c.topic if c.topic.startswith("swarm/") else f"{root}{c.topic}" for c, *_ in expected]
    assert heard == list(zip(keys, (payload for *_, payload in expected), strict=True))


def test_replay_verifies_the_plans(simulated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The planner gives every command again."""
    assert main(["replay", str(simulated), "--verify", "--json"]) == 0
    said = capsys.readouterr()
    verdict = json.loads(said.out)
    assert verdict["commands"] == verdict["identical"] > 50
    assert verdict["differences"] == []
    assert said.err == ""


def test_replay_says_what_else_made_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Differences from the plans of another numpy prove nothing about this record; equal versions are not reported."""
    path = tmp_path / "old.mcap"
    facts = {**run_facts("wall"), "version numpy": "1.2.3"}
    with path.open("w+b") as stream:
        writer = RecordingWriter(stream, facts)
        for channel, _, log_ns, _, payload in McapFile(GOLDEN).messages():
            if channel.topic.startswith("swarm/"):
                writer.write(channel.topic, payload, log_ns)
        writer.finish({})
    main(["replay", str(path), "--verify", "--json"])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("note: the recording was made with numpy 1.2.3; this is numpy ")
    assert "commit" not in line


@pytest.mark.parametrize("command", ["metrics", "check", "report", "replay", "visualise", "recover"])
@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (None, "cannot be read"),
        (b"", "is empty"),
        (b"\x7fELF not a recording", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "no `run` metadata"),
    ],
)
def test_bad_files_are_one_line(
    command: str, data: bytes | None, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 2, a line with file and problem, and no file left behind."""
    path = tmp_path / "bad.mcap"
    if data is not None:
        path.write_bytes(data)
    before = set(tmp_path.iterdir())
    assert main([command, str(path)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "bad.mcap" in said.err
    assert reason in said.err or (reason.startswith("no `run`") and "torn" in said.err)
    assert set(tmp_path.iterdir()) == before


def test_what_is_no_message_is_told_and_the_rest_is_read(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command reads the valid messages despite garbage and foreign messages."""
    file, path = McapFile(simulated), tmp_path / "garbage.mcap"
    messages = list(file.messages())
    with path.open("wb") as stream:
        writer = RecordingWriter(stream, file.metadata["run"])
        for channel, _, log_ns, sent_ns, payload in messages:
            writer.write_as(channel, payload, log_ns, sent_ns)
        log_ns, topic = messages[-1][2], next(each[0].topic for each in messages if each[0].topic.endswith("/fix"))
        for name, payload in ((topic, b"\xff garbage"), (topic, b'{"uav": 1}'), ("strange/topic", b"{}")):
            writer.write(name, payload, log_ns)
        writer.finish({})
    assert main(["metrics", str(path), "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == msgspec.to_builtins(compute_metrics(read_recording(simulated)))
    (warning,) = said.err.splitlines()
    assert warning.startswith(f"warning: 2 payloads are no messages and are left out; {topic}: ")
    assert main(["check", str(path)]) == 0
    assert f"not a message: {topic}" in capsys.readouterr().out
    for command in ("report", "visualise", "recover"):
        assert main([command, str(path)]) == 0


def test_recover_needs_the_mission_and_nothing_else(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The mission is attached before the first chunk; without it the command writes nothing and prints one line."""
    data, torn = simulated.read_bytes(), tmp_path / "torn.mcap.part"
    torn.write_bytes(data[: data.index(b"mission.json")])
    assert main(["recover", str(torn)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "torn.mcap.part" in line
    assert "holds no mission; torn: " in line
    assert list(tmp_path.iterdir()) == [torn]
    torn.write_bytes(data[: data.index(b"mission.json") + 6000])
    assert main(["recover", str(torn)]) == 1
    recovered = read_recording(tmp_path / "torn.recovered.mcap")
    assert recovered.message_count == 1
    assert recovered.mission.uavs == 4


def test_a_torn_recording_is_refused_and_recovered_when_asked(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command reads the complete part and reports what is missing."""
    torn = tmp_path / "torn.mcap.part"
    torn.write_bytes(simulated.read_bytes()[:-3000])
    assert main(["metrics", str(torn)]) == 2
    assert "edc-swarm recover" in capsys.readouterr().err
    assert main(["recover", str(torn), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    whole = tmp_path / "torn.recovered.mcap"
    assert said["recording"] == str(whole)
    assert said["messages"] == read_recording(whole).message_count
    assert said["unknown_tails"] > 0
    assert len(said["missing"]) == 1
    for command in ("metrics", "check", "report", "visualise"):
        assert main([command, str(whole)]) == 0, "only the index is lost, and no message"
    assert main(["recover", str(torn)]) == 2
    assert torn.exists()


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (["--speed", "0"], "--speed"),
        (["--speed", "inf"], "--speed"),
        (["--wait", "-1"], "--wait"),
        (["--connect", "tcp/127.0.0.1:1"], "--connect"),
        (["--listen", "nowhere"], "--listen"),
        (["--listen", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:1"], "--connect"),
    ],
)
def test_replay_names_a_bad_option(
    arguments: list[str],
    field: str,
    simulated: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One line has the option, its value and the allowed values."""
    monkeypatch.setattr("processes.cli.commands.replay.CONNECT_TIMEOUT_MS", 100)
    assert main(["replay", str(simulated), *arguments]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {field} = ")
    assert said.count("\n") == 1


def test_replay_leaves_out_what_no_bus_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A topic of another program is reported, and the rest is replayed."""
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        writer = RecordingWriter(stream, {})
        writer.write(Keys(MISSION_MESSAGE.name).mission, encode(MISSION_MESSAGE), 1)
        for topic in ("a//b", "swarm/m/*"):
            writer.write_as(Channel(topic, "raw"), b"?", 2)
        writer.finish({})
    assert main(["replay", str(path), "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == {"messages": 1}
    assert said.err.count("is no key of a bus") == 2


def test_a_page_overwrites_nothing(simulated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command overwrites a file only if told so, and only a page by its name."""
    page = simulated.with_name("page.html")
    page.write_text("mine")
    assert main(["report", str(simulated), "-o", str(page)]) == 2
    assert page.read_text() == "mine"
    assert main(["report", str(simulated), "-o", str(page), "--force"]) == 0
    assert page.read_text().startswith("<!doctype html>")
    assert main(["report", str(simulated), "-o", str(simulated)]) == 2
    assert "must be a name that ends in .html" in capsys.readouterr().err


def test_a_second_live_view_takes_a_port_of_its_own() -> None:
    """Viewers can show two simultaneous missions."""
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with suppress(OSError):
            taken.bind((HOST, PORT))
            taken.listen()
        assert live_port() not in {0, PORT}
