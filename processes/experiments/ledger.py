"""Execution of a declared sweep: in parallel, with progress, and resumable after a kill.

The ledger writes one JSON line per finished run to `runs.jsonl` in the sweep's folder; readers need no other file. A
sweep repeats a run if a kill tore its line, or if other code wrote it. Runs whose result is a time execute last, one
after the other, on this machine.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Protocol

import msgspec
from msgspec import Struct

import edc_swarm
from edc_swarm.errors import InputError, SwarmError
from edc_swarm.experiments.sweeps import Run
from edc_swarm.extras import install_command, version_of
from processes.experiments.workers import workers
from processes.runtime.output import unwritten
from processes.runtime.run_count import run_count

RUNS_FILE = "runs.jsonl"
MAX_LINE_BYTES = 16 << 20
MAX_JOBS = 1024
IN_FLIGHT = 4
"""Runs that are queued for each worker."""
CONNECT_S = 5.0
WORKER_DIED = (
    'a worker process died: out of memory, or of a script whose sweep is not below `if __name__ == "__main__":`; '
    "run the command again to resume"
)
OWN = frozenset({"edc_swarm", "processes"})
PACKAGES = ("numpy", "scipy", "numba", "osqp")
RESULT_NEUTRAL_PACKAGES = ("experiments", "report_page", "viz")
"""Packages of the library that cannot change a result: they declare runs, judge results or display them."""
MEASURES = "processes.experiments.measures"
"""Module of the measurements whose names have no module."""
MEASURING = ("measures.py", "timed_planner.py")
"""Files of this package that can change a result."""


class SweepError(SwarmError):
    """A run of a sweep failed; the ledger keeps the results so far."""


class Line(Struct, kw_only=True):
    """The line of one run in the file of results."""

    key: str
    command: str
    code: str
    cpu_s: float
    result: Any


class Ledger:
    """The results of a sweep in a folder, locked by one process at a time.

    Attributes
    ----------
    results
        Results of the present code, by key.
    outdated
        Number of lines from other code.
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
        with suppress(OSError):  # On a full disk `close` raises the error of `add` again.
            self._file.close()

    def add(self, run: Run, result: Any, cpu_s: float) -> None:
        """Write a result. When this returns, the result survives the death of the process."""
        code = self.code + user_code_digest(run.key)
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
                code = self.code + user_code_digest(line.key)
            except (msgspec.DecodeError, UnicodeDecodeError):
                continue
            if line.code == code:
                self.results[line.key] = line.result
            else:
                self.outdated += 1
        if not whole:
            self._file.write(b"\n")


def _claimed(folder: Path) -> BinaryIO:
    """Return the file of results, locked, and open at its beginning for reading and appending."""
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
    """Return a digest of everything that can change a result: sources of library and measures, package versions."""
    library = Path(edc_swarm.__file__).parent
    digest = hashlib.sha256("".join(f"{name}={version_of(name)};" for name in PACKAGES).encode())
    for path in sorted(library.rglob("*.py")):
        if path.relative_to(library).parts[0] not in RESULT_NEUTRAL_PACKAGES:
            digest.update(path.read_bytes())
    for name in MEASURING:
        digest.update((Path(__file__).parent / name).read_bytes())
    return digest.hexdigest()[:16]


def code_of(run: Run) -> str:
    """Return the digest of all code that can change the result of `run`."""
    return code_fingerprint() + user_code_digest(run.key)


def user_code_digest(key: str) -> str:
    """Return the digest of the user's own files for the run with this key: its measure and its planner."""
    measure, _, fields = key.partition(" ")
    names = (measure, str(msgspec.json.decode(fields or "{}").get("planner", "")))
    modules = {name.partition(":")[0] for name in names if ":" in name}
    digests = [file_digest(module) for module in sorted(modules) if module.partition(".")[0] not in OWN]
    return "".join(f"-{digest}" for digest in digests)


@lru_cache(maxsize=64)
def file_digest(module: str) -> str:
    """Return the digest of a module's file, "missing" without one; it is computed once."""
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        spec = None
    if spec is None or spec.origin is None or not spec.has_location:
        return "missing"
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()[:8]


class Scheduler(Protocol):
    """An executor of runs."""

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Any, float]]:
        """Yield each run with its result and its processor time, in the order in which runs end."""
        ...


def sweep(runs: Iterable[Run], ledger: Ledger, scheduler: Scheduler, title: str = "sweep") -> dict[str, Any]:
    """Execute all runs that `ledger` does not hold yet, and return the results of all runs by key.

    Raises
    ------
    SweepError
        A run failed; the error contains its command.
    """
    wanted = {run.key: run for run in runs}
    missing = [run for key, run in wanted.items() if key not in ledger.results]
    with run_count(title, len(wanted), len(wanted) - len(missing)) as end_run:
        for group, by in (
            ([run for run in missing if not run.alone], scheduler),
            ([run for run in missing if run.alone], Local(1)),
        ):
            for run, result, cpu_s in by.results(group):
                ledger.add(run, result, cpu_s)
                end_run("")
    return {key: ledger.results[key] for key in wanted}


def make(run: Run, code: str) -> tuple[Any, float]:
    """Execute one run in this process, and return its result and its processor time.

    Raises
    ------
    SweepError
        The run failed, or the code of this process differs from that of the sweep.
    """
    if code != (own := code_of(run)):
        raise SweepError(f"a worker has another version of edc-swarm, or of the user's code ({own}, not {code})")
    module, _, function = run.measure.rpartition(":")
    measure: Callable[..., Any] = getattr(importlib.import_module(module or MEASURES), function)
    begun_s = time.process_time()
    try:
        result = measure(run.mission)
    except Exception as error:
        raise SweepError(f"{run.command}: {type(error).__name__}: {error}") from error
    return result, time.process_time() - begun_s


def end_if_imported_by_worker() -> None:
    """End this process if it is a worker that imports the user's script, which would begin the same sweep again.

    Workers import the script under the name `__mp_main__`, and one without `if __name__ == "__main__":` sweeps in each.
    They end without a word; the process that started them raises `SweepError`.
    """
    if any(frame.frame.f_globals.get("__name__") == "__mp_main__" for frame in inspect.stack(0)):
        sys.exit(1)


class Local:
    """Scheduler with worker processes on this machine, or with this process itself for one job."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Any, float]]:
        """See `Scheduler`."""
        jobs = min(self._jobs, len(runs))
        if jobs <= 1:
            yield from ((run, *make(run, code_of(run))) for run in runs)
            return
        end_if_imported_by_worker()
        with workers(jobs, SweepError(WORKER_DIED)) as pool:
            yield from _windowed(lambda run: pool.submit(make, run, code_of(run)), runs, jobs * IN_FLIGHT)


def _windowed(
    submit: Callable[[Run], Future[tuple[Any, float]]], runs: Sequence[Run], window: int
) -> Iterator[tuple[Run, Any, float]]:
    """Yield results in the order of completion, with at most `window` runs in progress."""
    waiting = iter(runs)
    pending = {submit(run): run for run in islice(waiting, window)}
    while pending:
        done, _ = wait(pending, return_when=FIRST_COMPLETED)
        for future in done:
            yield (pending.pop(future), *future.result())
            pending.update((submit(run), run) for run in islice(waiting, 1))


class Dask:
    """Scheduler on a Dask cluster (extra `cluster`), whose workers have the same edc-swarm installed."""

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
    """Yield a scheduler: local processes, or the Dask cluster at `address`.

    Raises
    ------
    InputError
        The number of jobs is out of range, or the Dask scheduler does not answer.
    """
    if jobs is not None and not (isinstance(jobs, int) and 1 <= jobs <= MAX_JOBS):
        raise InputError("--jobs", jobs, f"a whole number between 1 and {MAX_JOBS}")
    with ExitStack() as stack:
        yield Local(jobs or os.cpu_count() or 1) if address is None else Dask(stack.enter_context(_client(address)))


def _client(address: str) -> Any:
    try:
        import distributed  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError("--scheduler", address, f"left out, or: {install_command('cluster')}") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        why = str(error).splitlines()[0]
        raise InputError("--scheduler", address, f"the address of a Dask scheduler that answers ({why})") from None
    if not client.scheduler_info()["workers"]:
        client.close()
        raise InputError("--scheduler", address, "a Dask scheduler that has workers")
    return client
