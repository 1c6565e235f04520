"""`edc-swarm fuzz`: random missions under random faults in the simulator, every guarantee checked."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

from cyclopts import Parameter
from msgspec import Struct

from edc_swarm.errors import InputError
from processes.experiments.workers import workers
from processes.runtime.console import note, print_json
from processes.runtime.run_count import run_count

MAX_FUZZ_RUNS = 10_000_000
MAX_FAILURES_SHOWN = 20
RUNS_AHEAD = 8
"""Runs that each worker gets ahead of time."""


class Found(Struct):
    """One failure, with as few faults as reproduce it."""

    seed: int
    kept: list[int]
    faults: list[str]
    broken: list[str]
    command: str


class FuzzReport(Struct):
    """The result of a search over seeds."""

    first_seed: int
    runs: int
    failures: list[Found]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FuzzOptions:
    """Options of `fuzz`.

    Parameters
    ----------
    runs
        Number of runs (100); run i has seed SEED + i.
    seed
        First seed (0).
    jobs
        Processes that simulate at the same time (the number of processors).
    keep
        Fly only these faults of each schedule: indices joined by commas, or "none".
    clusters
        Fly missions with two to four clusters.
    json
        Print the result as JSON alone on standard output.
    """

    runs: int = 100
    seed: int = 0
    jobs: int | None = None
    keep: str | None = None
    clusters: bool = False
    json: bool = False


def fuzz(*, options: FuzzOptions | None = None) -> int:
    """Search random fault schedules for a broken guarantee; print a command that replays each failure."""
    options = options or FuzzOptions()
    _check(options)
    kept = _kept(options.keep)
    failures: list[Found] = []
    with run_count("fuzz", options.runs) as end_run:
        for found in _search(options, kept):
            if found is not None:
                failures.append(found)
                _tell(found)
            end_run(f"{len(failures)} broken")
    _conclude(options, failures)
    return 1 if failures else 0


def _check(options: FuzzOptions) -> None:
    if not 1 <= options.runs <= MAX_FUZZ_RUNS:
        raise InputError("--runs", options.runs, f"between 1 and {MAX_FUZZ_RUNS}")
    if not 0 <= options.seed < 1 << 62:
        raise InputError("--seed", options.seed, "at least 0 and less than 2^62")
    if options.jobs is not None and not 1 <= options.jobs <= 1024:
        raise InputError("--jobs", options.jobs, "between 1 and 1024")


def _kept(keep: str | None) -> tuple[int, ...] | None:
    if keep is None:
        return None
    try:
        return () if keep == "none" else tuple(sorted({int(index) for index in keep.split(",")}))
    except ValueError:
        raise InputError("--keep", keep, 'fault indices joined by commas, or "none"') from None


def _search(options: FuzzOptions, kept: tuple[int, ...] | None) -> Iterator[Found | None]:
    """Yield results in the order of the seeds; a bounded number of runs is under way."""
    jobs = min(options.jobs or os.cpu_count() or 1, options.runs)
    seeds = range(options.seed, options.seed + options.runs)
    if jobs == 1:
        yield from (_run((seed, kept, options.clusters)) for seed in seeds)
        return
    with workers(jobs) as pool:
        waiting = iter(seeds)
        ahead = deque(pool.submit(_run, (seed, kept, options.clusters)) for seed in islice(waiting, jobs * RUNS_AHEAD))
        while ahead:
            yield ahead.popleft().result()
            ahead.extend(pool.submit(_run, (seed, kept, options.clusters)) for seed in islice(waiting, 1))


def _run(job: tuple[int, tuple[int, ...] | None, bool]) -> Found | None:
    from edc_swarm.experiments.fuzz_scenarios import scenario  # noqa: PLC0415 - as below
    from edc_swarm.experiments.fuzzing import search, smallest  # noqa: PLC0415 - heavy, and only the workers need it

    seed, kept, clusters = job
    finding = search(seed, kept, clusters=clusters)
    if finding is None:
        return None
    if kept is None:
        finding = smallest(finding)
    faults = list(scenario(seed, finding.kept, clusters=clusters).fault)
    return Found(seed, list(finding.kept), faults, list(finding.broken), finding.command)


def _tell(found: Found) -> None:
    note(f"seed {found.seed}: {found.broken[0]}")
    for fault in found.faults:
        note(f"    --fault {fault!r}")
    note(f"    replay: {found.command}")


def _conclude(options: FuzzOptions, failures: list[Found]) -> None:
    if options.json:
        print_json(FuzzReport(options.seed, options.runs, failures))
        return
    last = options.seed + options.runs - 1
    print(f"{options.runs} runs (seeds {options.seed} to {last}): {len(failures)} broke a guarantee")
    for found in failures[:MAX_FAILURES_SHOWN]:
        print(f"  {found.command}")
