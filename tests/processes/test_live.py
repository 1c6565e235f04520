"""The live view shows the swarm to every viewer, also to a late one."""

from __future__ import annotations

import json
import queue
import socket
import struct
import time
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from edc_swarm.viz.scenery import Shown
from processes.cli.main import main
from processes.services.live import Live, Subscribed
from tests.processes.conftest import Fly

websocket = pytest.importorskip("websocket", reason="no WebSocket client (pip install edc-swarm[dev])")
pytest.importorskip("foxglove", reason="no live view (pip install edc-swarm[live])")

PATIENCE_S = 60
MESSAGE_DATA = 1
"""Opcode of the Foxglove WebSocket protocol."""


def connected(port: int) -> tuple[Any, dict[str, dict[str, Any]]]:
    """Return a viewer and the channels that the server offers, by topic."""
    viewer = websocket.create_connection(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], timeout=PATIENCE_S)
    channels: dict[str, dict[str, Any]] = {}
    while "/viz/area" not in channels:
        said = viewer.recv()
        if isinstance(said, str) and (advert := json.loads(said))["op"] == "advertise":
            channels.update({channel["topic"]: channel for channel in advert["channels"]})
    return viewer, channels


def first_scene(viewer: Any, channel: dict[str, Any]) -> SceneUpdate:
    """Return the first scene of a topic."""
    viewer.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}))
    while True:
        said = viewer.recv()
        if isinstance(said, bytes) and said[0] == MESSAGE_DATA:
            assert struct.unpack_from("<I", said, 1) == (7,)
            return SceneUpdate.FromString(said[13:])


@pytest.mark.long
def test_a_late_viewer_sees_what_does_not_move(start: Fly) -> None:
    """The area was sent once, before the viewer connected; the discs are sent twice a second."""
    command = start("run", "--live", "--uavs", "3", "--area", "10000", "--seed", "4", "--speed-max", "3")
    line = ""
    assert command.process.stderr is not None
    while "ws://localhost:" not in line:
        line = command.process.stderr.readline()
        assert line, "the command said nothing about its live view"
    port = int(line.rpartition(":")[2])
    command.await_flight(3)
    viewer, channels = connected(port)
    assert channels["/viz/uavs"]["schemaName"] == "foxglove.SceneUpdate"
    assert {entity.id for entity in first_scene(viewer, channels["/viz/area"]).entities} == {"zone area"}
    viewer.close()
    viewer, channels = connected(port)
    assert len(first_scene(viewer, channels["/viz/uavs"]).entities) == 3
    viewer.close()
    assert command.end().status == 0


def log_lines(viewer: Any, count: int) -> list[str]:
    """Return the next lines of the log."""
    heard: list[str] = []
    while len(heard) < count:
        said = viewer.recv()
        if isinstance(said, bytes) and said[0] == MESSAGE_DATA:
            heard.append(Log.FromString(said[13:]).message)
    return heard


def test_the_log_reaches_each_viewer_once_and_their_leaving_is_no_error(capfd: pytest.CaptureFixture[str]) -> None:
    """Each of three viewers gets the lines that came before it, those that come after, and none twice."""
    told: queue.Queue[Subscribed] = queue.Queue()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    live = Live("127.0.0.1", port, told.put)

    def say(words: str) -> None:
        live.show(Shown("/viz/log", 1, Log(message=words, level=Log.INFO).SerializeToString()))

    live.show(Shown("/viz/area", 1, SceneUpdate().SerializeToString()))
    viewers = []
    for n in range(3):
        viewer, channels = connected(port)
        channel = channels["/viz/log"]["id"]
        viewer.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel}]}))
        viewers.append(viewer)
        live.repeat(told.get(timeout=PATIENCE_S))
        say(f"line {n}")
    for viewer in viewers:
        assert log_lines(viewer, 3) == ["line 0", "line 1", "line 2"]
        viewer.sock.shutdown(socket.SHUT_RDWR)
        viewer.sock.close()
    time.sleep(0.3)
    live.stop()
    assert "WebSocket protocol error" not in capfd.readouterr().err


def test_live_without_a_view_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, before any process starts."""
    assert main(["run", "--live", "--no-viz", "--out", str(tmp_path / "a.mcap")]) == 2
    assert capsys.readouterr().err.startswith("error: --live = True: must be absent where --no-viz is given")
    assert list(tmp_path.iterdir()) == []


def test_a_live_view_that_is_not_installed_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The extra is optional; the line contains the command that installs it."""
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    assert main(["run", "--live", "--out", str(tmp_path / "a.mcap")]) == 2
    assert "pip install" in capsys.readouterr().err
