"""The command line: one line for bad input, JSON alone, help of every command."""

from __future__ import annotations

import json
import os
import shlex
import socket
import sys
from pathlib import Path

import pytest

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.mission.link import Link
from edc_swarm.protocol.events import EventKind
from edc_swarm.recording.reader import read_recording
from processes.cli import start
from processes.cli.main import app, main
from processes.cli.options import MissionOptions

COMMANDS = [name for name in app if not name.startswith("-")]


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What is said about bad input: exit status 2, one line, nothing on standard output."""
    assert main(list(arguments)) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("error: ")
    assert "must be" in line
    return line


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in an empty folder, which bad input leaves empty."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", ["run", "sim"])
@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("--uavs 0", "uavs = 0"),
        ("--uavs -3", "uavs = -3"),
        ("--uavs ten", "--uavs = 'ten'"),
        ("--uavs 10.5", "--uavs = '10.5'"),
        ("--gps-error -1", "--gps-error = -1.0"),
        ("--gps-error inf", "--gps-error = inf"),
        ("--gps-error nan", "--gps-error = nan"),
        ("--area 0", "--area = 0.0"),
        ("--slot 0", "--slot = 0.0"),
        ("--speed-max -5", "--speed-max = -5.0"),
        ("--seed -1", "seed = -1"),
        ("--time-scale 0", "--time-scale = 0.0"),
        ("--loss 1.5", "--loss = 1.5"),
        ("--gps-model good", "--gps-model = 'good'"),
        ("--minimise money", "--minimise = 'money'"),
        ("--elect luck", "--elect = 'luck'"),
        ("--planner best", "planner = 'best'"),
        ("--fault explode", "fault = 'explode'"),
        ("--bogus 1", "option = '--bogus'"),
        ("--los 0.1", "do you mean --loss?"),
        ("--uavs", "--uavs = ''"),
        ("--seed 1 --seed 2", "--seed = '2'"),
        ("missing.toml", "mission file = 'missing.toml'"),
        ("one.toml two.toml", "arguments = 'two.toml'"),
        ("--out old.txt", "--out = 'old.txt'"),
    ],
)
def test_bad_options_are_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str, options: str, named: str
) -> None:
    """Field, value and what is allowed, before anything is started or written."""
    assert named in complaint(capsys, command, *options.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("uavs = 'many'", "uavs = 'many'"),
        ("colour = 'red'", "colour = 'red'"),
        ("uavs = ", "mission file"),
        ("r_m = inf", "r_m = inf"),
        ("fault = ['kill nobody @3']", "fault = 'kill nobody @3'"),
        ("[energy]\nrotors = 4", "energy.rotors = 4"),
    ],
)
def test_bad_mission_files_are_named(capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str, named: str) -> None:
    """The same for a file as for options."""
    file = tmp_path / "mission.toml"
    file.write_text(text)
    assert named in complaint(capsys, "sim", str(file))
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("--delays -5", "--delays = -5"),
        ("--delays 0,50,0", "--delays = [0.0, 50.0, 0.0]"),
        ("--delays 0,ten", "--delays = '0,ten'"),
        ("--delays nan", "--delays = nan"),
        ("--losses 0.5,2", "--losses = 2"),
        ("--jitters ,", "--jitters = ','"),
        ("--slots 0", "--slots = 0"),
        ("--uavs 10.5", "--uavs = 10.5"),
        ("--repeats 0", "repeats = 0"),
        ("--engine cloud", "--engine = 'cloud'"),
        ("--jobs 0", "--jobs = 0"),
        ("--mission missing.toml", "--mission = 'missing.toml'"),
        ("missing.toml", "sweep file = 'missing.toml'"),
    ],
)
def test_bad_latency_options_are_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, options: str, named: str
) -> None:
    """Before anything is flown or written."""
    assert named in complaint(capsys, "latency", *options.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("delays = [0]", "delays = [0]"),
        ("delays_ms = [-1]", "delays_ms[0] = -1"),
        ("[link]\ndistribution = 'pareto'", "link.distribution = 'pareto'"),
        ("[link]\nsender = 'u099'", "link[0].sender = 'u099'"),
        ("[[mission.link]]\nloss = 1.5", "mission.link[0].loss = 1.5"),
        ("[[mission.link]]\nreceiver = 'u099'", "link[1].receiver = 'u099'"),
    ],
)
def test_bad_sweep_files_are_named(capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str, named: str) -> None:
    """The same for a file as for options."""
    file = tmp_path / "sweep.toml"
    file.write_text(text)
    assert named in complaint(capsys, "latency", str(file))
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("command", ["run", "sim"])
def test_an_existing_recording_needs_force(capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str) -> None:
    """It is left as it was."""
    kept = tmp_path / "old.mcap"
    kept.write_bytes(b"old")
    assert "--force" in complaint(capsys, command, "--out", str(kept))
    assert kept.read_bytes() == b"old"


@pytest.mark.parametrize("command", ["run", "sim"])
def test_a_folder_that_cannot_be_written(capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str) -> None:
    """A file stands where a folder must be: that stops root too."""
    (tmp_path / "file").write_text("")
    assert "--out = " in complaint(capsys, command, "--out", str(tmp_path / "file" / "x.mcap"))


def test_a_port_in_use(capsys: pytest.CaptureFixture[str]) -> None:
    """Told before anything is started."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        assert f"--listen = '{endpoint}'" in complaint(capsys, "run", "--listen", endpoint)
    assert "--listen = 'nowhere'" in complaint(capsys, "run", "--listen", "nowhere")


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("run --remote 11", "--remote = 11"),
        ("run --remote -1", "--remote = -1"),
        ("run --operate nowhere", "--operate = 'nowhere'"),
        ("run --operate tcp/a:1 --remote 2", "--remote = 2"),
        ("run --operate tcp/a:1 --listen tcp/127.0.0.1:1", "--listen = "),
        ("run --operate tcp/a:1 --fault 'kill router @3'", "fault = "),
        ("join nowhere", "address = 'nowhere'"),
        ("join tcp/a:99999", "address = 'tcp/a:99999'"),
        ("join tcp/a:1 --uavs 0", "--uavs = 0"),
        ("join tcp/a:1 --uavs 2.5", "--uavs = '2.5'"),
        ("join tcp/a:1 --state file", "--state = 'file'"),
        ("join tcp/a:1 --cluster 'a b'", "--cluster = 'a b'"),
        ("join tcp/a:1 --record file", "--record = 'file'"),
        ("join tls/a:1 --router --certs file", "--certs = 'file': must be a folder made by `edc-swarm certs`"),
        ("join", "ADDRESS = ''"),
    ],
)
def test_bad_offers_to_share_a_mission(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, named: str
) -> None:
    """Told before anybody is connected to; nobody is at the router that would hear the abort notice."""
    monkeypatch.setattr("processes.bus.abort_notice.CONNECT_TIMEOUT_S", 0.0)
    (tmp_path / "file").write_text("")
    assert named in complaint(capsys, *shlex.split(command)).lower() or named in complaint(
        capsys, *shlex.split(command)
    )
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("command", ["metrics", "check"])
@pytest.mark.parametrize("content", [None, b"", b"not MCAP", b"\x89MCAP0\r\n"])
def test_files_that_are_no_recordings(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str, content: bytes | None
) -> None:
    """Missing, empty, something else, torn."""
    file = tmp_path / "x.mcap"
    if content is not None:
        file.write_bytes(content)
    assert f"'{file}'" in complaint(capsys, command, str(file))


def test_a_truncated_recording(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Refused by name, with the way out."""
    whole, torn = tmp_path / "a.mcap", tmp_path / "b.mcap"
    main(["sim", "--uavs", "3", "--planner", "straight", "--json", "--out", str(whole)])
    torn.write_bytes(whole.read_bytes()[:-200])
    capsys.readouterr()
    assert "recover" in complaint(capsys, "metrics", str(torn))


def test_without_a_terminal_a_metric_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """However long, so that programs find it."""
    golden = Path(__file__).parents[2] / "recordings" / "golden.mcap"
    assert main(["metrics", str(golden)]) == 0
    rows = metric_rows(compute_metrics(read_recording(golden)))
    said = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert said == [f"{name} {value}" for name, value in rows]
    assert max(map(len, said)) > 80


def test_an_unknown_command(capsys: pytest.CaptureFixture[str]) -> None:
    """The known ones are named."""
    assert "run, join, sim, metrics, check" in complaint(capsys, "fly")


def test_json_stands_alone_and_equals_metrics(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Also with a planner that collides; its exit status says so."""
    out = tmp_path / "s.mcap"
    assert main(["sim", "--uavs", "30", "--planner", "straight", "--json", "--out", str(out)]) == 1
    said = json.loads(capsys.readouterr().out)
    assert main(["metrics", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out).items() <= said.items()
    assert main(["check", str(out), "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == said["guarantees"]


PLANNER = """
from edc_swarm.planner.interface import Plan

class Tiring:
    def __init__(self, mission, stopwatch):
        pass

    def plan(self, request):
        if request.slot > 4:
            raise LookupError("no more ideas")
        return Plan(request.target_m, "planned")
"""


def test_a_planner_beside_the_mission_is_found_and_its_failure_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """One file in the current folder is enough; when it fails all hold, the record says why, and so does the end."""
    (tmp_path / "tiring_planner.py").write_text(PLANNER)
    options = ["--planner", "tiring_planner:Tiring", "--uavs", "3", "--max-slots", "9", "--out", "own.mcap"]
    assert main(["sim", *options, "--json"]) == 1
    said = capsys.readouterr()
    assert said.err.startswith("warning: 5 plans failed, and all held; first in slot 4: LookupError: no more ideas")
    assert json.loads(said.out)["path_m"] == pytest.approx(3 * 3 * 2.5)
    events = [event for event in read_recording("own.mcap").events if event.kind == EventKind.PLANNER_FAILED]
    assert [event.slot for event in events] == [4], "once, not in every slot"


def test_a_planner_too_slow_for_its_slots_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Virtual time has room for it; real UAVs would hold."""
    busy = "until_s = time.thread_time() + 0.03\n        while time.thread_time() < until_s: pass\n        if False:"
    slow = PLANNER.replace("if request.slot > 4:", busy)
    (tmp_path / "slow_planner.py").write_text(f"import time\n{slow}")
    main(["sim", "--planner", "slow_planner:Tiring", "--uavs", "2", "--slot", "0.02", "--max-slots", "3", "--json"])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warning: a plan took ")
    assert "a slot is 20 ms" in line


def test_same_seed_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """G6, with the command line in it: where the file is to be, and whether the summary is JSON, are not."""
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    for words in (["--json", "--out", str(a)], ["--force", f"--out={b}"]):
        monkeypatch.setattr(sys, "argv", ["edc-swarm", "sim", *words, "--uavs", "4", "--seed", "3", "--loss", "0.1"])
        assert main() == 0
    assert a.read_bytes() == b.read_bytes()
    assert read_recording(a).run["command"] == "edc-swarm sim --uavs 4 --seed 3 --loss 0.1"


def test_ctrl_c_ends_what_gives_up(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """While it looks for its router: what was wrong has been said."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("processes.bus.session.try_client", interrupted)
    monkeypatch.setattr("processes.bus.abort_notice.signal.signal", lambda *_: None)
    assert main(["run", "--operate", "tcp/localhost:7447", "--planner", "nonsense"]) == 2
    assert capsys.readouterr().err.startswith("error: --planner = 'nonsense'")


def test_link_options_are_about_every_link_of_the_file(tmp_path: Path) -> None:
    """What they do not say stays as it is in the file, also for single links and for a while."""
    file = tmp_path / "m.toml"
    file.write_text('[[link]]\ndelay_ms = 40\nloss = 0.1\n[[link]]\nsender = "u001"\nloss = 1\nend_s = 9\n')
    links = MissionOptions(jitter_ms=20.0, loss=0.5).mission(file).link
    assert links == [
        Link(jitter_ms=20, loss=0.5),
        Link(delay_ms=40, jitter_ms=20, loss=0.5),
        Link(sender="u001", jitter_ms=20, loss=0.5, end_s=9),
    ]
    assert MissionOptions().mission(file).link == [
        Link(delay_ms=40, loss=0.1), Link(sender="u001", loss=1.0, end_s=9),
    ]  # fmt: skip


def test_default_name_does_not_collide(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A second run of the same seed gets a number."""
    for _ in range(2):
        main(["sim", "--uavs", "2", "--planner", "straight"])
    assert sorted(os.listdir(tmp_path / "recordings")) == [
        "mission-straight-0-2.mcap",
        "mission-straight-0-2.timings.json",
        "mission-straight-0.mcap",
        "mission-straight-0.timings.json",
    ]
    assert "recordings/mission-straight-0.mcap" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(capsys: pytest.CaptureFixture[str], command: str) -> None:
    """With what it does in the first lines."""
    assert main([command, "--help"]) == 0
    assert f"edc-swarm {command}" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["run", "sim"])
def test_the_fault_vocabulary_is_printed(capsys: pytest.CaptureFixture[str], command: str) -> None:
    """The page of the docs, and nothing is flown."""
    assert main([command, "--fault-help"]) == 0
    assert capsys.readouterr().out == (Path(__file__).parents[2] / "docs" / "faults.md").read_text()


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    """A name and a number."""
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("edc-swarm ")


class _CtrlC:
    """A finder of modules that is interrupted when the command line is loaded."""

    def find_spec(self, name: str, *_: object) -> None:
        if name == "processes.cli.main":
            raise KeyboardInterrupt


def test_ctrl_c_while_the_command_line_loads_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The entry point prints no traceback, and tells failure."""
    monkeypatch.delitem(sys.modules, "processes.cli.main")
    monkeypatch.setattr(sys, "meta_path", [_CtrlC(), *sys.meta_path])
    assert start.main() == 1
    assert capsys.readouterr().err == "interrupted\n"
