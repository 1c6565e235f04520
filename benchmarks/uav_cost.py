"""What a UAV's process costs, and where: processor time, wake-ups and memory, beside a bare Zenoh process.

    python benchmarks/uav_cost.py [--uavs 50] [--seconds 20] [--runs 3]
    python benchmarks/uav_cost.py --only swarm --checkout FOLDER     the swarm with the code of another checkout

A row is one process of its kind in flight, the median of all such processes and runs. The *bare* process is the floor:
it is forked from this script, which has imported and run what the fork source has, and opens a session like that of a
UAV. Once in a slot it wakes and puts as many bytes as a fix has; Zenoh hands it as many as a command has. The other
rows are the processes of a mission with lifelong goals, in the same slots of 0.5 s.

Processor time is what Linux counts for each thread, in ms per slot: "python" is the thread of the process's loop, and
"zenoh" all others. A wake-up is a wait of a thread that ends. PSS is the memory, in which a page that n processes share
counts 1/n; "own" is what no other process shares. The last line has the processor time of the whole run with its start
and its end, as `benchmarks/overload.py` counts it.
"""

from __future__ import annotations

import argparse
import gc
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import zenoh
from overload import AREA_M2, swarm_command

import processes.host.fork_source  # noqa: F401  (what a UAV's process has imported when it is forked)
from edc_swarm.errors import SwarmError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.protocol.messages import Report
from edc_swarm.recording.reader import read_recording
from processes.bus.address import free_endpoint
from processes.experiments.baseline_process import COMMAND_BYTES, FIX_BYTES
from processes.host.packing import pack_memory
from processes.runtime.parent import die_with_parent
from processes.runtime.priority import come_first, give_way
from processes.uav.planner_loader import warm_planner

SLOT_S = 0.5
SETTLE_S = 10.0
"""Time before the first look, in which a swarm elects its head and reaches its usual ways."""
SPARE_SLOTS = 20
CONNECT_S = 120.0
KINDS = ("bare", "bare head", "bare router", "UAV", "standby", "head", "router", "recorder", "operator")


@dataclass(frozen=True)
class Look:
    """What Linux has counted of a process until now: processor time of its threads, and their waits."""

    at_s: float
    python_s: float
    zenoh_s: float
    waits: int


@dataclass(frozen=True)
class Cost:
    """What a process took per slot, and its memory; `own_mb` is the part that no other process shares."""

    python_ms: float
    zenoh_ms: float
    waits: float
    pss_mb: float
    own_mb: float

    @property
    def whole_ms(self) -> float:
        """Processor time of all threads."""
        return self.python_ms + self.zenoh_ms


@dataclass
class Costs:
    """The costs of processes by kind, and the processor time of each run until its UAVs were connected, and in all."""

    of: dict[str, list[Cost]] = field(default_factory=dict)
    starts_s: list[float] = field(default_factory=list)
    wholes_s: list[float] = field(default_factory=list)
    slots: int = 0

    def add(self, kind: str, cost: Cost) -> None:
        """Add what one process took."""
        self.of.setdefault(kind, []).append(cost)


def look(process: int) -> Look | None:
    """Look at a process; None if it has ended."""
    python_s = zenoh_s = 0.0
    waits = 0
    try:
        for task in Path(f"/proc/{process}/task").iterdir():
            ran_s = int((task / "schedstat").read_text().split()[0]) / 1e9
            if task.name == str(process):
                python_s = ran_s
            else:
                zenoh_s += ran_s
            (given_up,) = re.findall(r"^voluntary_ctxt_switches:\s+(\d+)", (task / "status").read_text(), re.MULTILINE)
            waits += int(given_up)
    except (OSError, ValueError):
        return None
    return Look(time.monotonic(), python_s, zenoh_s, waits)


def cost(process: int, before: Look | None) -> Cost | None:
    """Return what a process took since `before`; None if it has ended."""
    after = look(process)
    try:
        rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
    except OSError:
        return None
    if before is None or after is None:
        return None
    slots = (after.at_s - before.at_s) / SLOT_S
    sizes = {name: int(kb) / 1024 for name, kb in re.findall(r"^(\w+):\s+(\d+) kB", rollup, re.MULTILINE)}
    return Cost(
        1e3 * (after.python_s - before.python_s) / slots,
        1e3 * (after.zenoh_s - before.zenoh_s) / slots,
        (after.waits - before.waits) / slots,
        sizes["Pss"],
        sizes["Private_Dirty"] + sizes["Private_Clean"],
    )


def watch(kinds: dict[int, str], seconds: float) -> dict[int, Cost]:
    """Return what each process takes in the next seconds."""
    before = {process: look(process) for process in kinds}
    time.sleep(seconds)
    found = {process: cost(process, before[process]) for process in kinds}
    return {process: one for process, one in found.items() if one is not None}


# --- the floor -------------------------------------------------------------------------------


def bare(endpoint: str, index: int, uavs: int) -> None:
    """Be a bare process: a UAV, or the head (index 0), which puts a command to each UAV a fifth of a slot later."""
    from processes.bus.session import hand_over, open_client, put  # noqa: PLC0415  (Zenoh opens after the fork)

    come_first() if index == 0 else give_way()
    session = open_client(endpoint)
    fixes: list[str] = []

    def take(sample: zenoh.Sample) -> None:
        fixes.append(str(sample.key_expr))

    session.declare_subscriber("bare/fix/*" if index == 0 else f"bare/command/{index}", hand_over(take))
    token = session.liveliness().declare_token(f"bare/alive/{index}")
    while token is not None:
        time.sleep(SLOT_S - time.time() % SLOT_S)
        if index:
            fixes.clear()
            put(session, f"bare/fix/{index}", bytes(FIX_BYTES))
        else:
            time.sleep(SLOT_S / 5)
            for number in range(1, uavs):
                put(session, f"bare/command/{number}", bytes(COMMAND_BYTES))
            fixes.clear()


def measure_bare(uavs: int, seconds: float, costs: Costs) -> None:
    """Measure a star of bare processes."""
    with bare_router() as (endpoint, router):
        children = [fork_bare(endpoint, index, uavs) for index in range(uavs)]
        try:
            time.sleep(SETTLE_S)
            kinds = dict.fromkeys(children, "bare") | {children[0]: "bare head", router: "bare router"}
            for process, one in watch(kinds, seconds).items():
                costs.add(kinds[process], one)
        finally:
            for child in children:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)


@contextmanager
def bare_router() -> Iterator[tuple[str, int]]:
    """Run a router; yield its address and its process id."""
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "processes.services.router", endpoint, str(os.getpid())]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as router:
        assert router.stdout is not None
        router.stdout.readline()
        try:
            yield endpoint, router.pid
        finally:
            router.terminate()


def fork_bare(endpoint: str, index: int, uavs: int) -> int:
    """Fork a bare process, and return its id."""
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        try:
            die_with_parent(parent)
            bare(endpoint, index, uavs)
        finally:
            os._exit(1)
    return child


# --- the swarm -------------------------------------------------------------------------------


def measure_swarm(checkout: Path, uavs: int, seconds: float, seed: int, costs: Costs) -> None:
    """Measure the processes of a mission, whose recording says who was head and who standby in the meantime."""
    slots = costs.slots = round((SETTLE_S + seconds) / SLOT_S) + SPARE_SLOTS
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run.mcap"
        mission = out.with_suffix(".toml")
        mission.write_text("".join(f"{name} = {value}\n" for name, value in fields(uavs, seed, slots).items()))
        log = out.with_suffix(".log")
        command = [*swarm_command(checkout), str(mission), "--out", str(out)]
        before = os.times()
        with log.open("w") as said, subprocess.Popen(command, cwd=checkout, stdout=said, stderr=said) as run:
            until_s = time.monotonic() + CONNECT_S
            while run.poll() is None and "connected" not in log.read_text() and time.monotonic() < until_s:
                time.sleep(0.1)
            looks = [look(process) for process in processes_of(run.pid)]
            time.sleep(SETTLE_S)
            names = processes_of(run.pid)
            began_ns = time.time_ns()
            found = watch(names, seconds)
            ended_ns = time.time_ns()
            with suppress(subprocess.TimeoutExpired):
                run.wait(CONNECT_S)
            if run.poll() is None:
                run.send_signal(signal.SIGINT)
        after = os.times()
        costs.starts_s.append(sum(one.python_s + one.zenoh_s for one in looks if one is not None))
        used_s = after.children_user - before.children_user + after.children_system - before.children_system
        costs.wholes_s.append(used_s)
        if not out.exists():
            raise SwarmError(f"no recording; run said: {log.read_text()[-500:]}")
        recording = read_recording(out)
        reports = [report for report in recording.reports if began_ns <= report.sent_ns <= ended_ns]
    for process, one in found.items():
        if kind := kind_of(names[process], reports):
            costs.add(kind, one)


def fields(uavs: int, seed: int, slots: int) -> dict[str, object]:
    """Return the fields of a mission."""
    return {
        "uavs": uavs,
        "area_m2": AREA_M2 * uavs,
        "dt_s": SLOT_S,
        "max_slots": slots,
        "seed": seed,
        "goals": '"lifelong"',
    }


def processes_of(command: int) -> dict[int, str]:
    """Return the processes of a run by their ids, as far as they live: a UAV's has the name of its log."""
    names = {command: "operator"}
    with suppress(OSError):
        for child in children(command):
            words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
            names[child] = next((word.rpartition(".")[2] for word in words if word.startswith("processes.")), "")
            for uav in children(child):
                names[uav] = Path(os.readlink(f"/proc/{uav}/fd/1")).stem
    return names


def children(process: int) -> list[int]:
    """Return the children of a process."""
    tasks = Path(f"/proc/{process}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def kind_of(name: str, reports: list[Report]) -> str:
    """Return the kind of a process; "" for one that was of several kinds."""
    if name in KINDS:
        return name
    heads = {report.head for report in reports}
    if name in heads:
        return "head" if len(heads) == 1 else ""
    stood = sum(name in report.standby for report in reports)
    return "UAV" if stood == 0 else "standby" if stood == len(reports) else ""


# --- the table -------------------------------------------------------------------------------


def table(costs: Costs, uavs: int) -> Iterator[str]:
    """Yield the lines of the table."""
    yield f"{'process':12} {'ms per slot':>12} {'python':>8} {'zenoh':>8} {'wake-ups':>9} {'PSS MB':>7} {'own MB':>7}"
    for kind in KINDS:
        if found := costs.of.get(kind):

            def middle(name: str, found: list[Cost] = found) -> float:
                return float(statistics.median(getattr(one, name) for one in found))

            yield (
                f"{kind:12} {middle('whole_ms'):12.2f} {middle('python_ms'):8.2f} {middle('zenoh_ms'):8.2f}"
                f" {middle('waits'):9.1f} {middle('pss_mb'):7.1f} {middle('own_mb'):7.1f}"
            )
    if costs.wholes_s:
        whole_s, start_s = statistics.median(costs.wholes_s), statistics.median(costs.starts_s)
        each_ms, rest = 1e3 * whole_s / uavs / costs.slots, f"its start {start_s:.1f} s"
        yield f"a run of {costs.slots} slots: {whole_s:.1f} s, {each_ms:.2f} ms per UAV and slot; {rest}"


def prepare(uavs: int) -> None:
    """Import and run the planner as the fork source does, for the memory that forked processes share."""
    mission: Mission = complete_mission(mission_from_dict({"uavs": uavs, "area_m2": AREA_M2 * uavs, "seed": 0}))
    warm_planner(mission)
    gc.collect()
    pack_memory()
    gc.freeze()


def main() -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uavs", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", choices=("bare", "swarm"))
    parser.add_argument("--checkout", type=Path, default=Path(__file__).parents[1], metavar="FOLDER")
    options = parser.parse_args()
    costs = Costs()
    if options.only != "swarm":
        prepare(options.uavs)
    try:
        for seed in range(options.runs):
            if options.only != "swarm":
                measure_bare(options.uavs, options.seconds, costs)
            if options.only != "bare":
                measure_swarm(options.checkout, options.uavs, options.seconds, seed, costs)
    except SwarmError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print("\n".join(table(costs, options.uavs)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
