"""Commands in environments that lack something: one line and a status, never a traceback, never an endless wait."""

from __future__ import annotations

import os
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from cyclopts import App

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.emulation.energy import check_batteries, stranded
from edc_swarm.errors import MissionError, SwarmError
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner import just_in_time, registry
from edc_swarm.planner.registry import make_planner
from edc_swarm.recording.reader import read_recording
from processes.cli.compiled_code import VARIABLE, choose_code_folder
from processes.cli.main import app, main

MAIN = "import sys; from processes.cli.main import main; sys.exit(main())"
WITHIN_S = 60
READERS = ["metrics", "check", "report", "recover", "visualise", "replay", "replay --verify"]
MISSION_READERS = ["sim", "run", "certs", "latency", "latency --mission"]
SMALL = ["--uavs", "2", "--planner", "straight"]
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount")


def command(*words: str | bytes, cwd: Path, shell: str = "", **environment: str) -> subprocess.CompletedProcess[bytes]:
    """The command as it ends when it is run as a process of its own; `shell` redirects its streams."""
    start: list[str | bytes] = [sys.executable, "-c", MAIN]
    if shell:
        start = ["sh", "-c", f'exec "$@" {shell}', "sh", *start]
    return subprocess.run(
        [*start, *words], cwd=cwd, env={**os.environ, **environment}, capture_output=True, timeout=WITHIN_S, check=False
    )


def refused(ended: subprocess.CompletedProcess[bytes], *said: str) -> None:
    """It ended with status 2 and one line that says `said`."""
    _refused(ended.returncode, ended.stderr.decode(errors="replace"), *said)


def refused_here(capsys: pytest.CaptureFixture[str], *words: str | bytes, said: str) -> None:
    """The same of a command that is run in this process, which must end in time too."""
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("the command waits"))
    signal.alarm(WITHIN_S)
    try:
        status = main([os.fsdecode(word) for word in words])
    finally:
        signal.alarm(0)
    _refused(status, capsys.readouterr().err, said)


def _refused(status: int, text: str, *said: str) -> None:
    assert status == 2, text
    (line,) = text.splitlines()
    assert line.startswith("error: ")
    for each in said:
        assert each in line


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording."""
    out = tmp_path_factory.mktemp("recorded") / "a.mcap"
    assert main(["sim", *SMALL, "--json", "--out", str(out)]) == 0
    return out


def _unreadable(kind: str, folder: Path) -> Path:
    path = folder / "x.mcap"
    match kind:
        case "folder":
            path.mkdir()
        case "pipe":
            os.mkfifo(path)
        case "device":
            path = Path("/dev/zero")
        case "socket":
            with socket.socket(socket.AF_UNIX) as listener:
                listener.bind(str(path))
        case "loop":
            path.symlink_to(path)
        case "long name":
            path = folder / ("x" * 260 + ".mcap")
        case "empty":
            path.touch()
    return path


@pytest.mark.parametrize("kind", ["missing", "folder", "pipe", "device", "socket", "loop", "long name", "empty"])
@pytest.mark.parametrize("reader", [*READERS, *MISSION_READERS])
def test_what_is_no_file_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], reader: str, kind: str
) -> None:
    """Nobody waits for a pipe, and nobody reads a device without end."""
    if kind == "empty" and reader in MISSION_READERS:
        pytest.skip("an empty file is a mission: all defaults")
    words = {"pipe": "it is a pipe", "device": "it is a device", "socket": "it is a socket", "folder": "it is a folder"}
    monkeypatch.chdir(tmp_path)
    refused_here(capsys, *reader.split(), str(_unreadable(kind, tmp_path)), said=words.get(kind, ""))


@pytest.mark.parametrize("shell", [">/dev/full", ">&-"])
@pytest.mark.parametrize("words", ["metrics X", "metrics --json X", "check X", "check --json X", "--help", "sim --help",
                                   "--version", "report X --force --out y.html"])  # fmt: skip
def test_results_that_cannot_be_written(tmp_path: Path, recording: Path, words: str, shell: str) -> None:
    """Told, whether the disk is full or standard output is closed."""
    ended = command(*words.replace("X", str(recording)).split(), cwd=tmp_path, shell=shell)
    refused(ended, "standard output cannot be written")


def test_a_recording_never_gets_what_is_printed(tmp_path: Path) -> None:
    """With standard output closed, its number is free for the next file: that must not be the recording."""
    refused(command("sim", *SMALL, "--out", "a.mcap", cwd=tmp_path, shell="<&- >&-"), "standard output")
    assert read_recording(tmp_path / "a.mcap").message_count > 0


@pytest.mark.parametrize("shell", ["2>&-", "2>/dev/full", "<&-"])
def test_nobody_need_be_told(tmp_path: Path, shell: str) -> None:
    """A mission ends well when standard error or input is not there."""
    assert command("sim", *SMALL, "--json", "--out", "a.mcap", cwd=tmp_path, shell=shell).returncode == 0


def test_a_reader_that_has_left(tmp_path: Path, recording: Path) -> None:
    """As a shell tells of SIGPIPE, and without a word."""
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run(
        [sys.executable, "-c", MAIN, "check", recording],
        stdout=write,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        timeout=60,
        check=False,
    )
    os.close(write)
    assert (ended.returncode, ended.stderr) == (141, b"")


@pytest.mark.parametrize(
    "environment",
    [
        {"PYTHONIOENCODING": "ascii", "TERM": "dumb", "COLUMNS": "1"},
        {
            "LANG": "C",
            "LC_ALL": "C",
            "PYTHONUTF8": "0",
            "PYTHONCOERCECLOCALE": "0",
            "HOME": "/nonexistent",
            "TMPDIR": "/nonexistent",
        },
    ],
    ids=lambda given: next(iter(given)),
)
def test_poor_environments(tmp_path: Path, environment: dict[str, str]) -> None:
    """What cannot be shown is shown otherwise; results are the same."""
    named = tmp_path / "Übung"
    named.mkdir()
    ended = command("sim", *SMALL, "--out", str(named / "a.mcap"), cwd=tmp_path, **environment)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert b"held" in ended.stdout
    assert command("sim", "--help", cwd=tmp_path, **environment).returncode == 0


@pytest.mark.parametrize("words", ["sim", "run", "report X", "recover X", "visualise X"])
@pytest.mark.parametrize(
    ("out", "said"),
    [(b"\xff.mcap", "UTF-8"), (b"x" * 260 + b".mcap", "file name too long"), (b"x" * 250 + b".mcap", "name too long")],
    ids=["bytes", "260", "250"],
)
def test_names_that_no_file_can_have(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    recording: Path,
    words: str,
    out: bytes,
    said: str,
) -> None:
    """Refused by option before anything is flown; 250 characters leave no room for the name until the file is whole."""
    given = words.replace("X", str(recording)).split()
    out = out.replace(b".mcap", b".html") if given[0] == "report" else out
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    refused_here(capsys, *given, "--out", out, said=said)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    ["sim", "run", "join tcp/localhost:1", "fuzz --runs 1", "figures --runs 1 --only 4a", "latency", "certs",
     "replay --verify X", "metrics a.mcap", "check a.mcap", "report a.mcap", "recover a.mcap", "visualise a.mcap",
     "report X --out a.html", "visualise X --out a.mcap"],
)  # fmt: skip
def test_a_working_folder_that_was_removed(tmp_path: Path, recording: Path, words: str) -> None:
    """One line."""
    gone = tmp_path / "gone"
    gone.mkdir()
    given = words.replace("X", str(recording)).split()
    ended = subprocess.run(
        ["sh", "-c", 'rmdir "$PWD"; exec "$@"', "sh", sys.executable, "-c", MAIN, *given],
        cwd=gone, capture_output=True, timeout=WITHIN_S, check=False,
    )  # fmt: skip
    refused(ended)


def test_a_recording_is_read_from_a_folder_that_was_removed(tmp_path: Path, recording: Path) -> None:
    """It is named by its whole path."""
    code = "import os, sys; os.rmdir(os.getcwd()); from processes.cli.main import main; sys.exit(main())"
    gone = tmp_path / "gone"
    gone.mkdir()
    ended = subprocess.run(
        [sys.executable, "-c", code, "check", recording], cwd=gone, capture_output=True, timeout=WITHIN_S, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, b"")


def _filled(words: str, **paths: Path) -> list[str]:
    """The words, with each path in place of its letter."""
    return [
        next(
            (word.replace(letter, str(path), 1) for letter, path in paths.items() if word.partition("/")[0] == letter),
            word,
        )
        for word in words.split()
    ]


@needs_root
@pytest.mark.parametrize(
    "words",
    ["sim --uavs 8 --planner straight --out F/a.mcap", "visualise X --out F/a.mcap", "recover X --out F/a.mcap",
     "report X --out F/a.html", "certs --out F/certs", "figures --runs 1 --only 4a --jobs 1 --out F/figures",
     "latency --delays 0 --jitters 0 --losses 0 --uavs 2 --repeats 1 --jobs 1 --mission M --out F/latency"],
)  # fmt: skip
def test_a_full_disk(tmp_path: Path, recording: Path, words: str) -> None:
    """What could not be written is named, with the reason and a way out, and no torn file is left."""
    full, straight = tmp_path / "full", tmp_path / "straight.toml"
    full.mkdir()
    straight.write_text('planner = "straight"\n')
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", full], check=True)
    try:
        if not words.startswith("sim"):
            (full / "filler").write_bytes(bytes(65536))
        ended = command(*_filled(words, X=recording, M=straight, F=full), cwd=tmp_path)
        last = ended.stderr.decode().splitlines()[-1]
        assert ended.returncode == 2
        assert last.startswith(f"error: --out = '{full}/")
        assert "no space left on device: free some of that disk, or write to another one" in last
        assert b"Traceback" not in ended.stderr
        assert not list(full.glob("*.mcap*")) + list(full.glob("*.tmp"))
    finally:
        subprocess.run(["umount", "-l", full], check=True)


def test_through_a_link(tmp_path: Path, recording: Path) -> None:
    """`--out` writes where a symbolic link leads, and leaves the link."""
    (tmp_path / "disk").mkdir()
    target, link = tmp_path / "disk" / "target.mcap", tmp_path / "link.mcap"
    target.write_bytes(b"old")
    link.symlink_to(target)
    assert main(["sim", *SMALL, "--json", "--out", str(link), "--force"]) == 0
    assert link.is_symlink()
    assert read_recording(target).message_count
    assert main(["visualise", str(recording), "--out", str(link), "--force"]) == 0
    assert link.is_symlink()
    page, link = tmp_path / "page.html", tmp_path / "link.html"
    link.symlink_to(page)
    assert main(["report", str(recording), "--out", str(link)]) == 0
    assert link.is_symlink()
    assert page.stat().st_size > 1000


# --- the compiled planner ------------------------------------------------------------------------


def test_compiled_code_goes_to_a_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the usual places cannot be written; told in one line, also when that one cannot."""
    monkeypatch.setenv(VARIABLE, "/proc/nowhere")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    choose_code_folder()
    folder = tmp_path / f"edc-swarm-compiled-{os.getuid()}"
    assert os.environ[VARIABLE] == str(folder)
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"note: the compiled planner is kept in {folder}, since /proc/nowhere cannot be written"
    choose_code_folder()
    assert capsys.readouterr().err == "", "it is a usual place now"
    monkeypatch.setenv(VARIABLE, "/proc/nowhere")
    folder.chmod(0o777)
    choose_code_folder()
    assert os.environ[VARIABLE] == "/proc/nowhere", "others could put code there"
    assert "compiled anew at every start" in capsys.readouterr().err


COMPILED = """
from edc_swarm.planner.guidance_kernel import compiled
scope = {}
exec(compile("def twice(x):\\n    return 2 * x", FILE, "exec"), scope)
assert compiled(scope["twice"])(3) == 6
"""


def _compile(file: str, **environment: str) -> None:
    code = COMPILED.replace("FILE", repr(file))
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, env={**os.environ, **environment}, timeout=120, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, b"")


def test_compiled_code_is_kept_in_memory_where_no_folder_is() -> None:
    """A source file in a folder that nobody can write, no home, no cache."""
    _compile("/proc/version", HOME="/proc/nowhere", XDG_CACHE_HOME="/proc/nowhere", NUMBA_CACHE_DIR="/proc/nowhere")


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_torn_compiled_code_is_compiled_again(tmp_path: Path, suffix: str) -> None:
    """And kept again."""
    source = tmp_path / "source.py"
    source.write_text("")
    for _ in range(2):
        _compile(str(source), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
        (kept,) = (tmp_path / "cache").rglob(f"*.{suffix}")
        kept.write_bytes(kept.read_bytes()[:-9])


def test_code_of_other_sources_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code holds functions of other files, whose change numba does not see."""
    source = tmp_path / "source.py"
    source.write_text("")
    scope: dict[str, Any] = {"__name__": __name__}
    exec(compile("def twice(x):\n    return 2 * x", str(source), "exec"), scope)
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    for digest, loaded in (("one", 0), ("one", 1), ("other", 0)):
        monkeypatch.setattr(just_in_time, "SOURCES_DIGEST", digest)
        twice: Any = just_in_time.compiled(scope["twice"])
        assert (twice(3), sum(twice.stats.cache_hits.values())) == (6, loaded)


def test_an_import_that_fails_is_no_unknown_planner(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cause is told, and nobody is asked for another name."""
    monkeypatch.setitem(registry.BUILT_IN, "edc", "edc_swarm.planner.missing:Edc")
    with pytest.raises(SwarmError, match="cannot be imported: ModuleNotFoundError: No module named") as caught:
        make_planner("edc", complete_mission(mission_from_dict({"uavs": 2})))
    assert "must be" not in str(caught.value)


# --- missions ------------------------------------------------------------------------------------


def _two(way_m: float, apart_m: float = 500_000.0, **fields: object) -> dict[str, object]:
    radii = {"r_m": 2.0, "body_m": 0.2, "energy_j": 60000.0}
    starts = {"v00": (0.0, 1.0), "v01": (apart_m, -1.0)}
    roster = [
        {"uav": uav, "start_x_m": x_m, "start_y_m": 0.0, "target_x_m": x_m + sign * way_m, "target_y_m": 0.0, **radii}
        for uav, (x_m, sign) in starts.items()
    ]
    return {"name": "m", "roster": roster, **fields}


def _toml(raw: dict[str, object]) -> str:
    def lines(table: dict[str, object]) -> list[str]:
        return [f"{key} = {value!r}".replace("'", '"') for key, value in table.items() if key != "roster"]

    entries = [f"[[roster]]\n{chr(10).join(lines(entry))}" for entry in raw["roster"]]  # type: ignore[attr-defined]
    return "\n".join([*lines(raw), *entries])


def test_a_byte_order_mark(tmp_path: Path) -> None:
    """Editors of some systems put one there."""
    file = tmp_path / "bom.toml"
    file.write_bytes(b'\xef\xbb\xbfname = "bom"\nuavs = 3\n')
    assert main(["sim", str(file), "--planner", "straight", "--json", "--out", str(tmp_path / "a.mcap")]) == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('name = "a b"', "name = 'a b': must be 1 to 64 of the letters a-z and A-Z, digits, - and _"),
        ('[[roster]]\nuav = "ü"', "roster[0].uav = 'ü': must be 1 to 32 of the letters a-z and A-Z, digits, - and _"),
    ],
)
def test_names_are_explained_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str) -> None:
    """Not by a regular expression."""
    (tmp_path / "m.toml").write_text(text)
    assert main(["sim", str(tmp_path / "m.toml")]) == 2
    assert capsys.readouterr().err.strip() == f"error: {said}"


def test_a_step_that_no_battery_covers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Refused before take-off, with the arithmetic; who starts at its target needs no battery."""
    file = tmp_path / "m.toml"
    file.write_text(_toml(_two(100_000.0, v_max_mps=10_000.0)))
    assert main(["sim", str(file), "--out", str(tmp_path / "a.mcap")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: roster[0].energy_j = 60000.0: must be at least 4.622e+09 J, ")
    assert "(9.244e+09 W at 10000 m/s for a slot of 0.5 s): it could never move" in said
    assert not (tmp_path / "a.mcap").exists()
    check_batteries(mission_from_dict(_two(0.0, v_max_mps=10_000.0)))
    with pytest.raises(MissionError, match="v00"):
        check_batteries(mission_from_dict(_two(100_000.0, v_max_mps=10_000.0)))


def test_a_way_that_no_battery_covers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Flown, for it is an experiment; who does not get home is named before."""
    raw = _two(5000.0, max_slots=3)
    assert {uav: round(energy_j) for uav, energy_j in stranded(mission_from_dict(raw)).items()} == {
        "v00": 143611, "v01": 143611,
    }  # fmt: skip
    (tmp_path / "m.toml").write_text(_toml(raw))
    main(["sim", str(tmp_path / "m.toml"), "--planner", "straight", "--json", "--out", str(tmp_path / "a.mcap")])
    first = capsys.readouterr().err.splitlines()[0]
    assert first == (
        "warning: no battery for the straight flight to the target at full speed: "
        "v00 (6e+04 of 1.436e+05 J), v01 (6e+04 of 1.436e+05 J)"
    )


def test_no_ratio_is_below_one(tmp_path: Path) -> None:
    """Steps smaller than what counts as arrived: the least way ends where the UAV was when it arrived."""
    (tmp_path / "m.toml").write_text(_toml(_two(0.2, 20.0, v_max_mps=0.001, max_slots=300)))
    out = tmp_path / "a.mcap"
    main(["sim", str(tmp_path / "m.toml"), "--planner", "straight", "--json", "--out", str(out)])
    found = compute_metrics(read_recording(out))
    assert found.arrived == 2
    assert found.makespan_ratio == pytest.approx(1.0, abs=0.01)
    assert found.makespan_ratio is not None
    assert found.makespan_ratio >= 1
    assert (found.extra_distance_pct, found.extra_distance_mean_pct) == (pytest.approx(0), pytest.approx(0))


# --- options -------------------------------------------------------------------------------------

ANY = None
"""An option that takes whatever is said: a flag, a folder, a text that is used later."""
BAD_VALUES: dict[str, dict[str, str | None]] = {
    "run": {"listen": "x", "remote": "99", "operate": "x", "certs": "x", "live": ANY, "secure": ANY,
            "mavlink": "x", "mavlink-commands": ANY, "arm": ANY, "overload": "x"},
    "join": {  # With certificates the address is wrong.
        "uavs": "0", "state": "/proc/x", "certs": ANY, "arm": ANY, "cluster": "a b", "router": ANY, "record": "x",
        "force": ANY,
    },
    "certs": {"uavs": "0", "out": "/proc/x", "host": "a b", "joined": "x", "days": "0", "force": ANY, "json": ANY},
    "fuzz": {"runs": "0", "seed": "-1", "jobs": "0", "keep": "x", "clusters": ANY, "json": ANY},
    "figures": {"runs": "0", "only": "x", "jobs": "0", "out": "/proc/x", "scheduler": "x", "json": ANY},
    "latency": {
        "engine": "x", "delays": "-1", "jitters": "-1", "losses": "2", "slots": "0", "uavs": "1", "repeats": "0",
        "max-slots": "-1", "hold-slots": "1", "mission": "x", "jobs": "0", "scheduler": "x", "out": "/proc/x",
        "json": ANY,
    },
    "replay": {"speed": "0", "listen": "x", "connect": "x", "wait": "-1", "verify": ANY, "load-planner": ANY,
               "mavlink": "x", "mavlink-commands": ANY, "json": ANY},
    "recover": {"out": "x", "force": ANY, "json": ANY},
    "merge": {"out": "x", "force": ANY, "json": ANY},
    "visualise": {"out": "x", "force": ANY},
    "report": {"out": "x", "force": ANY},
    "events": {"json": ANY, "verbose": ANY},
    "faults": {},
    "metrics": {"json": ANY, "plots": "/proc/x", "metric": "x"},
    "check": {"load-planner": ANY, "json": ANY},
    "import": {  # The file is wrong before its origin is.
        "out": ANY, "force": ANY, "json": ANY, "origin": ANY, "r": "0", "speed-max": "0", "slot": "0", "start": "x",
        "polygons": "x", "cell": "0", "agents": "0", "list-unknown": ANY, "mixed-altitudes": ANY,
    },
    "export": {"format": "x", "out": ANY, "force": ANY},
    "sim": {
        "uavs": "0", "area": "0", "area-x": "-1", "area-y": "-1", "fence": "x", "failsafe": "x", "land-after": "-1",
        "quiet": ANY, "verbose": ANY, "vehicle": "x", "autopilot": "x", "resends": "-1",
        "wind-mps": "-1", "gust-mps": "-1", "clusters": "0",
        "gps-error": "-1", "gps-model": "x", "seed": "-1", "slot": "0", "speed-max": "0",
        "planner": "x", "control": "x", "minimise": "x", "responses": "0", "elect": "x", "fault": "x",
        "fault-help": ANY,
        "delay-ms": "-1", "jitter-ms": "-1", "loss": "1.5", "time-scale": "0", "max-slots": "-1", "out": "x",
        "no-viz": ANY, "json": ANY, "force": ANY,
    },
}  # fmt: skip
BAD_VALUES["run"] |= BAD_VALUES["sim"]
ARGUMENTS = {
    "merge": ["X", "X"],
    "join": ["tcp/localhost:1"],
    **{name: ["X"] for name in ("metrics", "replay", "recover", "visualise", "report", "import", "export")},
}
CASES = [(name, option, bad) for name, bads in BAD_VALUES.items() for option, bad in bads.items() if bad is not None]


def _options(name: str) -> set[str]:
    found: App = app[name]
    names = {arg.name for arg in found.assemble_argument_collection() if arg.name.startswith("--")}
    return {option.removeprefix("--") for option in names} - {"help", "version"}


@pytest.mark.parametrize("name", [name for name in app if not name.startswith("-")])
def test_every_option_is_in_the_table(name: str) -> None:
    """A new option needs a bad value there."""
    assert _options(name) == BAD_VALUES[name].keys()


def _refusal(name: str, words: Sequence[str], recording: Path, capsys: pytest.CaptureFixture[str]) -> str:
    arguments = [word.replace("X", str(recording)) for word in ARGUMENTS.get(name, [])]
    assert main([name, *arguments, *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize(("name", "option", "bad"), CASES)
def test_an_error_names_the_option(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    recording: Path,
    name: str,
    option: str,
    bad: str,
) -> None:
    """As it was written, not the field of a mission that it sets."""
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    line = _refusal(name, [f"--{option}", bad], recording, capsys)
    assert line.startswith(f"error: --{option} = "), line
    assert ": must be " in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("sim --gps-error 0.1", "body_m = 0.25: must be at most --gps-error (0.1)"),
        ("sim --area 100", "uavs = 10: must be few enough for --area = 100 and r_m = 5"),
        ("sim --uavs 500", "--uavs = 500: must be few enough for area_m2 = 10000 and r_m = 5"),
        ("sim --fault 'kill u099 @3'", "--fault = 'kill u099 @3': must be about a UAV of the roster"),
        ("latency --delays 0,-7", "--delays = -7: must be"),
        ("latency --uavs 500", "--uavs = 500: must be"),
    ],
)
def test_what_does_not_fit_an_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: str, said: str
) -> None:
    """Also where the option is the reason and not the offender."""
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(words)) == 2
    assert capsys.readouterr().err.startswith(f"error: {said}")
