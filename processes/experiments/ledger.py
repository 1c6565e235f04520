"""Making a declared sweep: in parallel, with progress, and going on where a killed one stopped.

Results are one JSON line per run in `runs.jsonl` of the sweep's folder, written when the run is over;
whoever reads them needs nothing else. A line that was torn by a kill is made again, and so is one
that other code has made. Runs whose result is a time are made one after the other on this machine,
when all others are done.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib
import importlib.util
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from importlib.metadata import version
from itertools import islice
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Protocol

import msgspec
from msgspec import Struct
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

import edc_swarm
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.experiments.sweeps import Run
from processes.runtime.output import unwritten
from processes.runtime.parent import die_with_parent

RUNS_FILE = "runs.jsonl"
MAX_LINE_BYTES = 16 << 20
MAX_JOBS = 1024
IN_FLIGHT = 4
"""Runs given to each worker ahead of time."""
CONNECT_S = 5.0
OWN = frozenset({"edc_swarm", "processes"})
PACKAGES = ("numpy", "scipy", "numba", "osqp")
DECIDE_NO_RESULT = ("experiments", "report_page", "viz")
"""Packages of the library that declare runs, judge results or show them, and decide none."""
MEASURES = "processes.experiments.measures"
"""Module with the measurements that are named without a module."""
MEASURING = ("measures.py", "timed_planner.py")
"""Files beside this one that decide results."""


class SweepError(SwarmError):
    """A run of a sweep cannot be made; what was made before is kept."""


class Line(Struct, kw_only=True):
    """One run in the file of results."""

    key: str
    command: str
    code: str
    cpu_s: float
    result: Any


class Ledger:
    """The results of a sweep in a folder, held by one process at a time.

    Attributes
    ----------
    results
        By key, those of the present code.
    outdated
        Number of lines that other code has made.
    """

    def __init__(self, folder: Path, code: str | None = None) -> None:
        self.folder, self.code = folder, code or code_fingerprint()
        self.results: dict[str, Any] = {}
        self.outdated = 0
        self._file = _claimed(folder)
        self._load()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):  # On a full disk it tries once more to write what `add` has complained of.
            self._file.close()

    def add(self, run: Run, result: Any, cpu_s: float) -> None:
        """Keep a result; it is on disk when this returns, as far as a killed process is concerned."""
        code = self.code + strangers_fingerprint(run.key)
        line = Line(key=run.key, command=run.command, code=code, cpu_s=round(cpu_s, 3), result=result)
        try:
            self._file.write(msgspec.json.encode(line) + b"\n")
            self._file.flush()
        except OSError as error:
            raise unwritten("--out", self.folder, error) from None
        self.results[run.key] = result

    def _load(self) -> None:
        decoder, whole = msgspec.json.Decoder(Line), True
        for raw in iter(lambda: self._file.readline(MAX_LINE_BYTES), b""):
            whole = raw.endswith(b"\n")
            try:
                line = decoder.decode(raw)
                code = self.code + strangers_fingerprint(line.key)
            except (msgspec.DecodeError, UnicodeDecodeError):
                continue
            if line.code == code:
                self.results[line.key] = line.result
            else:
                self.outdated += 1
        if not whole:
            self._file.write(b"\n")


def _claimed(folder: Path) -> BinaryIO:
    """The file of results, open at its beginning for reading, appending, and nobody else."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / RUNS_FILE).exists() and any(folder.iterdir()):
            raise InputError("--out", str(folder), f"a new or empty folder, or one with the {RUNS_FILE} of a sweep")
        file = (folder / RUNS_FILE).open("a+b")
        _lock(file)
    except BlockingIOError:
        raise InputError("--out", str(folder), "a folder that no other sweep is writing") from None
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise InputError("--out", str(folder), f"a folder that can be written ({why})") from None
    file.seek(0)
    return file


def _lock(file: BinaryIO) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """What decides results: the library's and the measures' source, and the versions below them."""
    library = Path(edc_swarm.__file__).parent
    digest = hashlib.sha256("".join(f"{name}={version(name)};" for name in PACKAGES).encode())
    for path in sorted(library.rglob("*.py")):
        if path.relative_to(library).parts[0] not in DECIDE_NO_RESULT:
            digest.update(path.read_bytes())
    for name in MEASURING:
        digest.update((Path(__file__).parent / name).read_bytes())
    return digest.hexdigest()[:16]


def code_of(run: Run) -> str:
    """What decides the result of `run`."""
    return code_fingerprint() + strangers_fingerprint(run.key)


def strangers_fingerprint(key: str) -> str:
    """What decides the result of the run with this key besides: the files of a user's measure and planner."""
    measure, _, fields = key.partition(" ")
    names = (measure, str(msgspec.json.decode(fields or "{}").get("planner", "")))
    modules = {name.partition(":")[0] for name in names if ":" in name}
    digests = [_file_digest(module) for module in sorted(modules) if module.partition(".")[0] not in OWN]
    return "".join(f"-{digest}" for digest in digests)


@lru_cache(maxsize=64)
def _file_digest(module: str) -> str:
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        spec = None
    if spec is None or spec.origin is None or not spec.has_location:
        return "missing"
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()[:8]


class Scheduler(Protocol):
    """Makes runs somewhere."""

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Any, float]]:
        """Each run with its result and the processor time it took, in the order in which they end."""
        ...


def sweep(runs: Iterable[Run], ledger: Ledger, scheduler: Scheduler, title: str = "sweep") -> dict[str, Any]:
    """Make all runs that `ledger` does not hold yet; the results of all, by key.

    Raises
    ------
    SweepError
        A run failed; its command is in the error.
    """
    wanted = {run.key: run for run in runs}
    missing = [run for key, run in wanted.items() if key not in ledger.results]
    with _bar() as bar:
        task = bar.add_task(title, total=len(wanted), completed=len(wanted) - len(missing))
        for group, by in (
            ([run for run in missing if not run.alone], scheduler),
            ([run for run in missing if run.alone], Local(1)),
        ):
            for run, result, cpu_s in by.results(group):
                ledger.add(run, result, cpu_s)
                bar.advance(task)
    return {key: ledger.results[key] for key in wanted}


def make(run: Run, code: str) -> tuple[Any, float]:
    """Make one run, in whatever process; its result and the processor time it took.

    Raises
    ------
    SweepError
        The run failed, or this process has other code than the sweep.
    """
    if code != (own := code_of(run)):
        raise SweepError(f"a worker has another version of edc-swarm, or of what is flown ({own}, not {code})")
    module, _, function = run.measure.rpartition(":")
    measure: Callable[..., Any] = getattr(importlib.import_module(module or MEASURES), function)
    begun_s = time.process_time()
    try:
        result = measure(run.mission)
    except Exception as error:
        raise SweepError(f"{run.command}: {type(error).__name__}: {error}") from error
    return result, time.process_time() - begun_s


class Local:
    """Processes on this machine; with one job, this very process."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Any, float]]:
        """See `Scheduler`."""
        jobs = min(self._jobs, len(runs))
        if jobs <= 1:
            yield from ((run, *make(run, code_of(run))) for run in runs)
            return
        spawn = multiprocessing.get_context("spawn")
        before = set(multiprocessing.active_children())
        with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=begin_worker, initargs=(os.getpid(),)) as pool:
            try:
                yield from _windowed(lambda run: _submitted(pool, run), runs, jobs * IN_FLIGHT)
            except BrokenProcessPool:
                raise SweepError("a worker process died (out of memory?); run it again to go on") from None
            except BaseException:
                _end(pool, set(multiprocessing.active_children()) - before)
                raise


def _windowed(
    submit: Callable[[Run], Future[tuple[Any, float]]], runs: Sequence[Run], window: int
) -> Iterator[tuple[Run, Any, float]]:
    """Results as they come, with at most `window` runs under way."""
    waiting = iter(runs)
    pending = {submit(run): run for run in islice(waiting, window)}
    while pending:
        done, _ = wait(pending, return_when=FIRST_COMPLETED)
        for future in done:
            yield (pending.pop(future), *future.result())
            pending.update((submit(run), run) for run in islice(waiting, 1))


def _submitted(pool: ProcessPoolExecutor, run: Run) -> Future[tuple[Any, float]]:
    with interrupt_held_back():
        return pool.submit(make, run, code_of(run))


@contextmanager
def interrupt_held_back() -> Iterator[None]:
    """Hold Ctrl-C back: workers that are started meanwhile inherit that, and are deaf to it from their first moment."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_worker(parent_pid: int) -> None:
    """End with the command, which alone hears Ctrl-C."""
    die_with_parent(parent_pid)


def _end(pool: ProcessPoolExecutor, workers: Iterable[BaseProcess]) -> None:
    """Do not wait for runs that nobody wants any more."""
    pool.shutdown(wait=False, cancel_futures=True)
    for worker in workers:
        worker.kill()


class Dask:
    """A Dask cluster (extra `cluster`), whose workers have the same edc-swarm installed."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Any, float]]:
        """See `Scheduler`."""
        import distributed  # noqa: PLC0415 - an extra

        threads = sum(worker["nthreads"] for worker in self._client.scheduler_info(n_workers=-1)["workers"].values())
        waiting = iter(runs)
        pending = {self._submit(run): run for run in islice(waiting, max(1, threads) * IN_FLIGHT)}
        done = distributed.as_completed(list(pending), loop=self._client.loop)
        try:
            for future in done:
                yield (pending.pop(future), *future.result())
                for run in islice(waiting, 1):
                    following = self._submit(run)
                    pending[following] = run
                    done.add(following)
        finally:
            self._client.cancel(list(pending))

    def _submit(self, run: Run) -> Any:
        return self._client.submit(make, run, code_of(run), pure=False)


@contextmanager
def open_scheduler(address: str | None, jobs: int | None) -> Iterator[Scheduler]:
    """Local processes, or the Dask cluster at `address`.

    Raises
    ------
    InputError
        A number of jobs that makes no sense, or a scheduler that does not answer.
    """
    if jobs is not None and not 1 <= jobs <= MAX_JOBS:
        raise InputError("--jobs", jobs, f"between 1 and {MAX_JOBS}")
    with ExitStack() as stack:
        yield Local(jobs or os.cpu_count() or 1) if address is None else Dask(stack.enter_context(_client(address)))


def _client(address: str) -> Any:
    try:
        import distributed  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError("--scheduler", address, "left out, or: pip install 'edc-swarm[cluster]'") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        why = str(error).splitlines()[0]
        raise InputError("--scheduler", address, f"the address of a Dask scheduler that answers ({why})") from None
    if not client.scheduler_info()["workers"]:
        client.close()
        raise InputError("--scheduler", address, "a Dask scheduler that has workers")
    return client


def _bar() -> Progress:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=Console(stderr=True))
