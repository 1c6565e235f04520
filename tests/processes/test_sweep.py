"""Sweeps in processes: resumed after a kill, on a cluster, and with the `figures` command."""

from __future__ import annotations

import csv
import fcntl
import json
import os
import shlex
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

import edc_swarm
from edc_swarm.errors import InputError
from edc_swarm.experiments.figures import catalogue
from edc_swarm.experiments.sweeps import Run
from edc_swarm.mission.configuration import Mission
from processes.cli.main import main
from processes.experiments.ledger import (
    MEASURING,
    RESULT_NEUTRAL_PACKAGES,
    RUNS_FILE,
    Ledger,
    Local,
    SweepError,
    code_fingerprint,
    file_digest,
    make,
    open_scheduler,
    sweep,
)
from processes.experiments.workers import WORKER_DIED, workers

RUNS = [Run("fly", Mission(uavs=3, seed=seed)) for seed in range(8)]
SWEEP = """
import sys
sys.path.insert(0, {tests!r})
from pathlib import Path
from test_sweep import RUNS
from processes.experiments.ledger import Ledger, Local, sweep
if __name__ == "__main__":
    with Ledger(Path({folder!r})) as ledger:
        sweep(RUNS, ledger, Local({jobs}))
"""
TIMES = ("plan_ms", "energy_compute_j")


def without_times(results: dict[str, Any]) -> dict[str, Any]:
    """Return results without measured times."""
    return {key: {k: v for k, v in result.items() if k not in TIMES} for key, result in results.items()}


@pytest.fixture(scope="module")
def expected() -> dict[str, Any]:
    """Return the results of the sweep in one undisturbed process."""
    return without_times({run.key: result for run, result, _ in Local(1).results(RUNS)})


def wait_for(condition: Any, what: str, timeout_s: float = 120.0) -> None:
    """Poll until `condition()` is true."""
    until_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until_s, f"never: {what}"
        time.sleep(0.02)


def lines(folder: Path) -> list[bytes]:
    """Return the lines of the file of results."""
    file = folder / RUNS_FILE
    return file.read_bytes().splitlines() if file.exists() else []


def children(pid: int) -> list[int]:
    """Return the child processes of `pid`."""
    said = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False)
    return [int(word) for word in said.stdout.split()]


def workers_of(pid: int) -> list[int]:
    """Return the worker processes of `pid`."""
    said = subprocess.run(["ps", "-wwo", "pid=,args=", "--ppid", str(pid)], capture_output=True, text=True, check=False)
    return [int(line.split()[0]) for line in said.stdout.splitlines() if "spawn_main" in line]


def alive(pid: int) -> bool:
    """Return True if a process runs (a zombie does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def deaf(pid: int) -> bool:
    """Return True if a process blocks or ignores Ctrl-C."""
    words = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").split()
    masks = [int(words[words.index(name) + 1], 16) for name in ("SigBlk:", "SigIgn:")]
    return any(mask >> (signal.SIGINT - 1) & 1 for mask in masks)


def die(_mission: Mission) -> None:
    """Die like a worker that the kernel kills when memory is exhausted."""
    os._exit(9)


def test_killed_sweep_continues(tmp_path: Path, expected: dict[str, Any]) -> None:
    """After kill -9 in mid-sweep no worker is left, and a resumed sweep gives the same results, each executed once."""
    code = SWEEP.format(tests=str(Path(__file__).parent), folder=str(tmp_path), jobs=2)
    script = tmp_path.with_name("run_sweep.py")
    script.write_text(code, encoding="utf-8")
    process = subprocess.Popen([sys.executable, str(script)], stderr=subprocess.DEVNULL)
    wait_for(lambda: len(lines(tmp_path)) >= 2, "two results")
    workers = children(process.pid)
    process.kill()
    process.wait()
    wait_for(lambda: not any(map(alive, workers)), "workers gone", 10)
    before = lines(tmp_path)
    with (tmp_path / RUNS_FILE).open("ab") as torn:
        torn.write(before[0][: len(before[0]) // 2])
    with Ledger(tmp_path) as ledger:
        assert len(ledger.results) == len(before)
        results = sweep(RUNS, ledger, Local(1))
    assert without_times(results) == expected
    keys = [json.loads(line)["key"] for line in lines(tmp_path) if line.endswith(b"}")]
    assert sorted(keys) == sorted(run.key for run in RUNS)


def test_printed_command_flies_the_run_again(tmp_path: Path, expected: dict[str, Any]) -> None:
    """The command in a line of the results gives the metrics in that line."""
    words = shlex.split(RUNS[5].command)
    assert words[0] == "edc-swarm"
    out = tmp_path / "again.mcap"
    said = subprocess.run(
        [sys.executable, "-m", "processes.cli.main", *words[1:], "--out", str(out), "--json"],
        capture_output=True,
        check=True,
    )
    metrics = msgspec.json.decode(said.stdout)
    wanted = expected[RUNS[5].key]
    assert {name: metrics[name] for name in wanted} == wanted


def test_results_of_other_code_are_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A result is on disk at once, and only the code that wrote it uses it."""
    with Ledger(tmp_path) as ledger:
        sweep(RUNS[:1], ledger, Local(1))
        assert len(lines(tmp_path)) == 1
    monkeypatch.setattr("processes.experiments.ledger.code_fingerprint", lambda: "other")
    with Ledger(tmp_path) as ledger:
        assert (ledger.results, ledger.outdated) == ({}, 1)


def test_results_of_a_planner_that_was_edited_are_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user's planner can change a result, as the library can."""
    file = tmp_path / "edited_planner.py"
    file.write_text("from edc_swarm.planner.straight import Straight as Mine\n")
    monkeypatch.syspath_prepend(tmp_path)
    run = Run("fly", Mission(uavs=3, planner="edited_planner:Mine"))
    with Ledger(tmp_path / "sweep") as ledger:
        sweep([RUNS[0], run], ledger, Local(2))
    with Ledger(tmp_path / "sweep") as ledger:
        assert (len(ledger.results), ledger.outdated) == (2, 0)
    file.write_text("from edc_swarm.planner.edc import Edc as Mine\n")
    file_digest.cache_clear()
    with Ledger(tmp_path / "sweep") as ledger:
        assert (list(ledger.results), ledger.outdated) == ([RUNS[0].key], 1)


def test_the_code_of_a_result_is_what_decides_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The digest covers the measures and the library, except existing packages that cannot change a result."""
    library = Path(edc_swarm.__file__).parent
    assert [name for name in RESULT_NEUTRAL_PACKAGES if not (library / name).exists()] == []
    monkeypatch.setattr(edc_swarm, "__file__", str(tmp_path / "library" / "__init__.py"))
    monkeypatch.setattr("processes.experiments.ledger.__file__", str(tmp_path / "ledger.py"))
    for folder in ("simulation", "experiments"):
        (tmp_path / "library" / folder).mkdir(parents=True)
    for name in MEASURING:
        (tmp_path / name).touch()
    for name, decides in (
        ("simulation/closed_loop.py", True),
        (f"{RESULT_NEUTRAL_PACKAGES[0]}/sweeps.py", False),
        *((f"../{name}", True) for name in MEASURING),
    ):
        before = code_fingerprint.__wrapped__()
        (tmp_path / "library" / name).write_text("more", encoding="utf-8")
        assert (code_fingerprint.__wrapped__() != before) is decides


def test_a_worker_with_other_code_makes_nothing() -> None:
    """The result of a worker with other code would not belong to the sweep."""
    with pytest.raises(SweepError, match="another version of edc-swarm"):
        make(RUNS[0], "other")


def test_a_worker_that_dies_ends_the_sweep_with_a_word() -> None:
    """The results so far are kept, so that the sweep can resume."""
    runs = [Run(f"{__name__}:die", Mission(seed=seed)) for seed in range(2)]
    with pytest.raises(SweepError, match="a worker process died"):
        list(Local(2).results(runs))


def test_a_worker_of_the_fuzzer_that_dies_ends_it_with_a_word(tmp_path: Path) -> None:
    """The kernel kills a worker when memory is exhausted: the user sees one line."""
    said = tmp_path / "said"
    with said.open("wb") as stream:
        command = [sys.executable, "-m", "processes.cli.main", "fuzz", "--runs", "1000", "--jobs", "2"]
        process = subprocess.Popen(command, stderr=stream)
    try:
        wait_for(lambda: workers_of(process.pid), "workers")
        os.kill(workers_of(process.pid)[0], signal.SIGKILL)
        assert process.wait(timeout=60) == 1
    finally:
        process.kill()
    assert said.read_text().splitlines()[-1] == f"error: {WORKER_DIED}"
    assert "Traceback" not in said.read_text()


def test_an_interrupt_ends_workers_in_mid_work() -> None:
    """Nobody waits for what they do, which may take minutes."""
    with pytest.raises(KeyboardInterrupt):
        _interrupted()
    assert not workers_of(os.getpid())


def _interrupted() -> None:
    with workers(2, SweepError("died")) as pool:
        calls = [pool.submit(time.sleep, 600.0) for _ in range(8)]
        wait_for(lambda: workers_of(os.getpid()) and any(call.running() for call in calls), "work")
        raise KeyboardInterrupt


def test_a_script_that_sweeps_in_every_worker_ends_with_a_word(tmp_path: Path) -> None:
    """Workers import the script again; they end without a traceback of their own."""
    script = tmp_path / "unguarded.py"
    script.write_text("import edc_swarm as es\nes.sweep(uavs=3, planner='straight', seeds=2, jobs=2)\n")
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.count("Traceback") == 1
    assert '`if __name__ == "__main__":`' in ended.stderr.splitlines()[-1]


def test_failed_run_is_named_and_others_are_kept(tmp_path: Path) -> None:
    """A run that fails ends the sweep with its command; finished results stay."""
    crowded = Run("fly", Mission(uavs=50, area_m2=100.0))
    with Ledger(tmp_path) as ledger, pytest.raises(SweepError, match="edc-swarm sim --uavs 50 --area 100"):
        sweep([RUNS[0], crowded], ledger, Local(1))
    assert len(lines(tmp_path)) == 1


@pytest.fixture
def cluster() -> Iterator[str]:
    """Yield the address of a Dask scheduler with two worker processes of one thread each."""
    distributed = pytest.importorskip("distributed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as local:
            yield local.scheduler_address


@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
def test_dask_cluster_gives_the_same(cluster: str, tmp_path: Path, expected: dict[str, Any]) -> None:
    """Two Dask workers give the results of one process."""
    with open_scheduler(cluster, None) as scheduler, Ledger(tmp_path) as ledger:
        results = sweep(RUNS, ledger, scheduler)
    assert without_times(results) == expected


BAD = [
    (["--only", "7a"], "--only"),
    (["--runs", "0"], "--runs"),
    (["--jobs", "0"], "--jobs"),
    (["--scheduler", "tcp://127.0.0.1:9"], "--scheduler"),
    (["--scheduler", "nonsense"], "--scheduler"),
    (["--out", "/proc/figures"], "--out"),
    (["--out", "/dev/null"], "--out"),
]


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("words", "field"), BAD, ids=lambda value: " ".join(value) if isinstance(value, list) else value
)
def test_bad_input_is_one_line(
    words: list[str], field: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Exit status 2, one line that names the option, nothing on standard output, no run."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("processes.experiments.ledger.CONNECT_S", 0.5)
    assert main(["figures", "--runs", "1", *words] if "--runs" not in words else ["figures", *words]) == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"error: {field} = ")
    assert len(said.err.splitlines()) == 1


def test_folder_of_others_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The sweep does not write to a folder with other content, nor to one that another sweep locks."""
    (tmp_path / "thesis.tex").touch()
    assert main(["figures", "--out", str(tmp_path)]) == 2
    (tmp_path / RUNS_FILE).touch()
    with (tmp_path / RUNS_FILE).open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert main(["figures", "--out", str(tmp_path)]) == 2
    assert "no other sweep" in capfd.readouterr().err
    with Ledger(tmp_path / "mine"), pytest.raises(InputError, match="no other sweep"):
        Ledger(tmp_path / "mine")


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make all figures small, with few UAVs in a small area."""
    axes = {
        "uavs": (Mission(area_m2=2500.0), (3.0, 6.0)),
        "area_m2": (Mission(uavs=4), (2500.0, 6400.0)),
        "r_m": (Mission(uavs=4, area_m2=2500.0), (2.0, 5.0)),
    }
    figures = tuple(
        replace(f, base=axes[f.axis.field][0], axis=replace(f.axis, values=axes[f.axis.field][1]))
        for f in catalogue.FIGURES
    )
    monkeypatch.setattr(catalogue, "FIGURES", figures)


@pytest.mark.long
@pytest.mark.usefixtures("small")
def test_figures_command(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The command makes every figure as PNG, SVG and CSV, a page with all of them, and JSON on standard output."""
    assert main(["figures", "--runs", "2", "--jobs", "1", "--json", "--out", str(tmp_path)]) == 0
    report = json.loads(capfd.readouterr().out)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    for name in catalogue.NAMES:
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert f'src="{name}.svg"' in page
        assert (tmp_path / f"{name}.svg").exists()
    for name, found in report["findings"].items():
        assert found["claim"] in page.replace("&quot;", '"').replace("&#x27;", "'")
        assert found["found"], name
    check_tables(tmp_path, report["rows"])
    made = len(lines(tmp_path))
    assert main(["figures", "--runs", "2", "--jobs", "1", "--only", "4a", "--out", str(tmp_path)]) == 0
    assert len(lines(tmp_path)) == made


def check_tables(folder: Path, rows: list[dict[str, Any]]) -> None:
    """Assert that the CSV files hold the rows of the report, with all columns."""
    read: list[dict[str, str]] = []
    for figure in dict.fromkeys(row["figure"] for row in rows):
        with (folder / f"{figure}.csv").open(newline="", encoding="utf-8") as stream:
            read += csv.DictReader(stream)
    assert [list(row) for row in read] == [list(row) for row in rows]
    for written, row in zip(read, rows, strict=True):
        assert (written["figure"], written["series"]) == (row["figure"], row["series"])
        assert float(written["mean"]) == row["mean"]
        assert (written["ci95_low"] == "") == (row["ci95_low"] is None)
    assert {row["largest"] for row in rows if row["series"] == "edc" and row["figure"] in {"4a", "4b", "4c"}} == {0.0}
    with (folder / "energy-long.csv").open(newline="", encoding="utf-8") as stream:
        assert len(list(csv.DictReader(stream))) == catalogue.LONG_MISSION.uavs


@pytest.mark.parametrize("flown", [0, 1])
def test_interrupt_ends_the_workers(tmp_path: Path, flown: int) -> None:
    """Ctrl-C, which a terminal sends to all, ends command and workers at once and without output, at any stage."""
    command = [
        sys.executable,
        "-m",
        "processes.cli.main",
        "figures",
        "--only",
        "4b",
        "--jobs",
        "2",
        "--out",
        str(tmp_path),
    ]
    said = tmp_path.with_name("said")
    with said.open("wb") as stream:
        process = subprocess.Popen(command, stderr=stream, start_new_session=True)
    wait_for(lambda: len(children(process.pid)) >= 2, "workers")
    workers = children(process.pid)
    wait_for(lambda: len(lines(tmp_path)) >= flown, "results")
    assert all(map(deaf, workers))
    os.killpg(process.pid, signal.SIGINT)
    process.wait(timeout=60)
    wait_for(lambda: not any(map(alive, workers)), "workers gone", 60)
    assert process.returncode == 1
    assert b"Traceback" not in said.read_bytes()
