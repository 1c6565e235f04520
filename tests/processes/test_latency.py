"""The `latency` command with both engines, its baseline, and radio range with real processes."""

from __future__ import annotations

import csv
import json
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from edc_swarm.analysis.latency_sample import Sample, sample_of
from edc_swarm.recording.reader import read_recording
from processes.cli.main import main
from tests.processes.conftest import Ended, Fly

pytestmark = pytest.mark.timing

SWEEP = """
delays_ms = [0, 300]
jitters_ms = [40]
losses = [0, 0.3]
uavs = [3]
repeats = 2
hold_slots = 20
[link]
distribution = "normal"
[mission]
area_m2 = 2500.0
"""
MISSION = "time_scale = 4.0\narea_m2 = 400.0\nr_m = 1.0\n"
QUICK = ("--uavs", "3", "--jitters", "0", "--losses", "0", "--repeats", "1", "--jobs", "1")
FLYING_AWAY = """
v_max_mps = 20.0
gps_model = "none"
max_slots = 40
link = [{ range_m = 100.0, shadowing_db = 0.0 }]
roster = [
  { uav = "u1", start_x_m = 0, start_y_m = 0, target_x_m = 0, target_y_m = 0, r_m = 5, body_m = 1, energy_j = 5e4 },
  { uav = "u2", start_x_m = 0, start_y_m = 20, target_x_m = 0, target_y_m = 20, r_m = 5, body_m = 1, energy_j = 5e4 },
  { uav = "u3", start_x_m = 40, start_y_m = 0, target_x_m = 200, target_y_m = 0, r_m = 5, body_m = 1, energy_j = 4e4 },
]
"""


def made(folder: Path) -> list[dict[str, Any]]:
    """Return the lines of the file of results."""
    return [json.loads(line) for line in (folder / "runs.jsonl").read_text(encoding="utf-8").splitlines()]


def test_a_simulated_sweep(tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Table, plots, page and JSON exist; a second call executes no run; the command of each line repeats its run."""
    file, out = tmp_path / "sweep.toml", tmp_path / "out"
    file.write_text(SWEEP, encoding="utf-8")
    assert main(["latency", str(file), "--jobs", "1", "--json", "--out", str(out)]) == 0
    report = json.loads(capfd.readouterr().out)
    assert [found["kept"] for found in report["findings"]] == [True, True, None]
    with (out / "cells.csv").open(newline="", encoding="utf-8") as stream:
        cells = list(csv.DictReader(stream))
    assert [(cell["delay_ms"], cell["loss"], cell["only_holds"]) for cell in cells] == [
        ("0.0", "0.0", "False"),
        ("300.0", "0.0", "True"),
        ("0.0", "0.3", "False"),
        ("300.0", "0.3", "True"),
    ]
    page = (out / "index.html").read_text(encoding="utf-8")
    for stem in ("held_pct-by-delay", "completed_pct-by-loss", "makespan_s-by-delay"):
        assert (out / f"{stem}.png").read_bytes().startswith(b"\x89PNG")
        assert f'src="{stem}.svg"' in page
    lines = made(out)
    assert len(lines) == 4 * 2
    fly_again(lines[3], tmp_path / "again.mcap")
    monkeypatch.setattr("processes.cli.commands.latency.QUANTITIES", ())
    assert main(["latency", str(file), "--jobs", "1", "--out", str(out)]) == 0
    assert made(out) == lines
    assert report["findings"][0]["text"] in capfd.readouterr().out


def fly_again(line: dict[str, Any], path: Path) -> None:
    """Assert that the command in a line of the results gives the sample in that line."""
    words = shlex.split(line["command"])
    command = [sys.executable, "-m", "processes.cli.main", *words[1:], "--out", str(path), "--no-viz", "--json"]
    subprocess.run(command, capture_output=True, check=False)
    assert msgspec.convert(line["result"], Sample) == sample_of(read_recording(path))


def test_a_sweep_with_real_processes(start: Fly, tmp_path: Path) -> None:
    """Each mission is recorded and simulated too, the baseline is measured, and no process is left."""
    mission, out = tmp_path / "mission.toml", tmp_path / "out"
    mission.write_text(MISSION, encoding="utf-8")
    options = ("--engine", "processes", "--delays", "0,20", "--mission", str(mission), "--json", "--out", str(out))
    ended = start("latency", *QUICK, *options).end()
    assert ended.status == 0, ended.stderr
    assert [(cell["engine"], cell["delay_ms"]) for cell in ended.json["cells"]] == [
        ("sim", 0.0),
        ("sim", 20.0),
        ("processes", 0.0),
        ("processes", 20.0),
    ]
    floor = ended.json["floor"]
    assert 0 < floor["put_to_answer_ms"]["p50"] <= floor["round_trip_ms"]["p50"]
    samples = {line["command"]: line["result"] for line in made(out / "processes")}
    (at_once, delayed) = samples.values()
    assert at_once["delay_error"] is None
    assert delayed["delay_error"]["messages"] > 0
    assert delayed["delay_error"]["p50_ms"] > 0
    assert delayed["fix_to_command_ms"] >= 20.0
    for recording in sorted((out / "processes" / "recordings").glob("*.mcap")):
        assert msgspec.to_builtins(sample_of(read_recording(recording))) in samples.values()
    assert len(list((out / "processes" / "recordings").glob("*.mcap"))) == 2


def test_interrupted_while_flying(start: Fly, tmp_path: Path) -> None:
    """Ctrl-C ends every process; an unfinished run leaves no result."""
    out = tmp_path / "out"
    command = start("latency", *QUICK, "--engine", "processes", "--delays", "0", "--slots", "0.1", "--out", str(out))
    command.await_file(lambda: len(command.uav_pids()) == 3)
    command.process.send_signal(signal.SIGINT)
    ended = command.end()
    assert ended.status == 1
    assert "interrupted" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert made(out / "processes") == []
    assert list((out / "processes" / "recordings").glob("*.mcap*")) == []


def test_radio_range(run: Callable[..., Ended], tmp_path: Path) -> None:
    """A UAV out of range is neither heard nor commanded, by the true positions."""
    file = tmp_path / "away.toml"
    file.write_text(FLYING_AWAY, encoding="utf-8")
    ended = run(str(file), "--no-viz")
    (last,) = [fix for fix in ended.recording.fixes if fix.uav == "u3"][-1:]
    assert 90.0 < last.waypoint_x_m < 130.0
    assert any("u3" in report.heard for report in ended.recording.reports[:6])
    assert ended.recording.reports[-1].unheard == ["u3"]
    assert ended.status == 1


def netem() -> str:
    """Return the reason why this machine cannot delay packets in a network namespace, "" if it can."""
    add = "ip link set lo up && tc qdisc add dev lo root netem delay 1ms"
    try:
        tried = subprocess.run(["unshare", "-rn", "sh", "-c", add], capture_output=True, text=True, check=False)
    except OSError as error:
        return str(error)
    return tried.stderr.strip() if tried.returncode else ""


def test_netem_as_documented(start: Fly) -> None:
    """Two hops of 25 ms each way: the record shows the kernel's delay like an emulated one of 50 ms."""
    if why := netem():
        pytest.skip(f"no netem in a network namespace: {why}")
    delayed = 'ip link set lo up && tc qdisc add dev lo root netem delay 25ms && exec "$@"'
    ended = start(
        "run", "--uavs", "3", "--json", "--no-viz", prefix=("unshare", "-rn", "sh", "-c", delayed, "sh")
    ).end()
    assert ended.json["fix_to_command_ms"]["p50"] >= 50.0
