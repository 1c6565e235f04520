"""Overload: what a swarm loses while its machine is short of processors, and how soon it is normal again.

    python benchmarks/overload.py                                   busy loops beside 50 UAVs, then 150 ... 400 UAVs
    python benchmarks/overload.py --uavs 50 --loads 90 --plot docs/figures/overload.svg    the first run of each case
    python benchmarks/overload.py --uavs 150 200 300 400 --loads 0
    python benchmarks/overload.py --checkout FOLDER                 the same with the code of another checkout, from
                                                                    `git worktree add FOLDER COMMIT`

With a load of P %, one loop per core takes P % of it from slot 20 on, for 20 s, in turns of 10 ms. A row has, of all
slots, those without commands (after the first command) and the late ticks; after the end of the load the slots until
`NORMAL_SLOTS` in a row had a command for every UAV that flew; the processor time of the whole run per UAV and slot, and
the memory of a UAV (PSS). "-" is unknown: nothing was recorded of it. Run it on a machine that does nothing else.

Nobody need watch it: a run that has not ended long after its last slot is ended, the reason why a run has no recording
goes to standard error, the other runs follow, and the plot is drawn anew after each. Then the status is 1.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from edc_swarm.errors import SwarmError
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording

AREA_M2 = 800.0
"""Area for each UAV, the density of 50 UAVs on 40 000 m2."""
SLOT_S = 0.5
LOAD_FROM_SLOT, LOAD_S = 20, 20.0
TURN_S = 0.01
"""Length of a busy loop's turn: work, then rest."""
NORMAL_SLOTS = 3
AFTER_SLOTS = 30
LOOK_S = 0.5
SPARE_S = 300.0
"""Time of a run beyond its slots, for start and end: hundreds of UAVs connect, and a recorder may be behind."""
END_S = 60.0
"""Time in which a run ends after Ctrl-C."""


@dataclass(frozen=True)
class Slot:
    """What became of one slot: UAVs that said a fix of it, and those of them that flew a command, or ticked late."""

    fixes: int
    flew: int
    late: int


@dataclass(frozen=True)
class Row:
    """Results of one run."""

    uavs: int
    load_pct: float
    slots: list[Slot]
    load_slots: range
    cpu_s: float
    pss_mb: float | None

    @property
    def without(self) -> int | None:
        """Slots without any command flown, after the first that had one; None if none had."""
        first = next((number for number, slot in enumerate(self.slots) if slot.flew), None)
        return None if first is None else sum(slot.flew == 0 for slot in self.slots[first:])

    @property
    def cost_ms(self) -> float | None:
        """Processor time of the whole run per UAV and slot."""
        return 1e3 * self.cpu_s / self.uavs / len(self.slots) if self.slots else None

    @property
    def late_pct(self) -> float | None:
        """Late ticks per hundred."""
        fixes = sum(slot.fixes for slot in self.slots)
        return 100 * sum(slot.late for slot in self.slots) / fixes if fixes else None

    @property
    def flown_pct(self) -> float | None:
        """UAV-slots with a command per hundred, after the first command."""
        first = next((number for number, slot in enumerate(self.slots) if slot.flew), None)
        if first is None:
            return None
        return 100 * sum(slot.flew for slot in self.slots[first:]) / (self.uavs * len(self.slots[first:]))

    @property
    def back_slots(self) -> int | None:
        """Slots from the load's end until `NORMAL_SLOTS` in a row were normal; None without load, or if never."""
        if not self.load_slots:
            return None
        for start in range(self.load_slots.stop, len(self.slots) - NORMAL_SLOTS + 1):
            if all(slot.flew == self.uavs for slot in self.slots[start : start + NORMAL_SLOTS]):
                return start - self.load_slots.stop
        return None


def swarm_command(checkout: Path) -> list[str]:
    """Return the command that flies a mission with the code of a checkout, whatever its machine carries.

    Raises
    ------
    SwarmError
        The checkout has no command `run`.
    """
    command = [sys.executable, "-m", "processes.cli.main", "run"]
    told = subprocess.run([*command, "--help"], cwd=checkout, capture_output=True, text=True, check=False)
    if told.returncode:
        raise SwarmError(f"{checkout}: `run --help` ended with status {told.returncode}")
    # Versions before this option flew without asking.
    return [*command, "--no-viz", "--force", *(["--overload", "fly"] if "--overload" in told.stdout else [])]


def fly(swarm: list[str], checkout: Path, uavs: int, load_pct: float, seed: int, slots: int, out: Path) -> Row:
    """Fly one mission, with a load beside it.

    Raises
    ------
    SwarmError
        The run has left no recording that can be read.
    """
    out.unlink(missing_ok=True)
    mission = out.with_suffix(".toml")
    fields = {"uavs": uavs, "area_m2": AREA_M2 * uavs, "dt_s": SLOT_S, "max_slots": slots, "seed": seed}
    mission.write_text("".join(f"{name} = {value}\n" for name, value in fields.items()) + 'goals = "lifelong"\n')
    command = [*swarm, str(mission), "--out", str(out)]
    log = out.with_suffix(".log")
    before_s = _children_s()
    with log.open("w") as said, subprocess.Popen(command, cwd=checkout, stdout=subprocess.DEVNULL, stderr=said) as run:
        while run.poll() is None and len(_uav_processes(run.pid)) < uavs:
            time.sleep(0.05)
        time.sleep(LOAD_FROM_SLOT * SLOT_S)
        began_s, loops = time.time(), _loops(load_pct)
        pss_mb = _watch(run, uavs, time.monotonic() + slots * SLOT_S + SPARE_S)
        used_s = _children_s() - before_s
        for loop in loops:
            loop.join()
    if not out.exists():
        raise SwarmError(f"no recording; run said: {_last_line(log)}")
    recording = read_recording(out)
    epoch_s = recording.mission.epoch_ns / 1e9
    first = round((began_s - epoch_s) / SLOT_S)
    loaded = range(first, first + round(LOAD_S / SLOT_S)) if load_pct else range(0)
    return Row(uavs, load_pct, slots_of(recording), loaded, used_s, pss_mb)


def slots_of(recording: Recording) -> list[Slot]:
    """Return what became of each slot."""
    last: dict[str, int] = {}
    fixes: dict[int, dict[str, bool]] = {}
    late: dict[int, int] = {}
    for fix in sorted(recording.fixes, key=lambda fix: (fix.uav, fix.slot, fix.seq)):
        fixes.setdefault(fix.slot, {})[fix.uav] = fix.executing
        late[fix.slot] = late.get(fix.slot, 0) + max(0, fix.late_ticks - last.get(fix.uav, 0))
        last[fix.uav] = fix.late_ticks
    end = max(fixes, default=-1) + 1
    return [Slot(len(of := fixes.get(slot, {})), sum(of.values()), late.get(slot, 0)) for slot in range(end)]


def _loops(load_pct: float) -> list[multiprocessing.Process]:
    count = len(os.sched_getaffinity(0)) if load_pct else 0
    loops = [multiprocessing.Process(target=_burn, args=(load_pct / 100, LOAD_S)) for _ in range(count)]
    for loop in loops:
        loop.start()
    return loops


def _burn(share: float, for_s: float) -> None:
    """Take a share of a core: work until so much processor time is used, then rest."""
    end_s = time.monotonic() + for_s
    while time.monotonic() < end_s:
        worked_s = time.process_time()
        while time.process_time() - worked_s < share * TURN_S and time.monotonic() < end_s:
            pass
        time.sleep((1 - share) * TURN_S)


def _last_line(log: Path) -> str:
    return (log.read_text(errors="replace").strip().splitlines() or ["nothing"])[-1]


def _watch(run: subprocess.Popen[bytes], uavs: int, until_s: float) -> float | None:
    """Wait for the end; return the median PSS of a UAV, when all were last there.

    A run that is still there at `until_s` is ended as by Ctrl-C, then killed; its processes die with it.
    """
    pss_mb = None
    while run.poll() is None and time.monotonic() < until_s:
        pss_mb = _pss_mb(run.pid, uavs) or pss_mb
        time.sleep(LOOK_S)
    if run.poll() is None:
        run.send_signal(signal.SIGINT)
        try:
            run.wait(END_S)
        except subprocess.TimeoutExpired:
            run.kill()
    run.wait()
    return pss_mb


def _children_s() -> float:
    """Return the processor time of all children that have ended, and of theirs."""
    used = os.times()
    return used.children_user + used.children_system


def _pss_mb(command: int, uavs: int) -> float | None:
    """Return the median memory of the UAV processes; shared memory counts once.

    None unless all of them live: the fewer share memory, the more of it counts for each.
    """
    found = []
    for uav in _uav_processes(command):
        try:
            rollup = Path(f"/proc/{uav}/smaps_rollup").read_text()
        except OSError:
            continue
        if match := re.search(r"^Pss:\s+(\d+) kB", rollup, re.MULTILINE):
            found.append(int(match[1]) / 1024)
    return statistics.median(found) if len(found) >= uavs else None


def _uav_processes(command: int) -> list[int]:
    """Return the grandchildren of the command: the fork source makes the UAVs."""
    return [uav for child in _children(command) for uav in _children(child)]


def _children(process: int) -> list[int]:
    try:
        tasks = Path(f"/proc/{process}/task").iterdir()
        return [int(child) for task in tasks for child in (task / "children").read_text().split()]
    except OSError:
        return []


def plot(rows: list[Row], path: Path) -> None:
    """Draw the share of UAVs that fly a command, slot by slot."""
    from matplotlib.figure import Figure  # noqa: PLC0415  (only with --plot)

    figure = Figure(figsize=(8, 1.9 * len(rows)), layout="constrained")
    for number, row in enumerate(rows):
        axes = figure.add_subplot(len(rows), 1, number + 1)
        share = [100 * slot.flew / row.uavs for slot in row.slots]
        axes.step([SLOT_S * slot for slot in range(len(share))], share, where="post", color="#1f6f8b")
        if row.load_slots:
            axes.axvspan(SLOT_S * row.load_slots.start, SLOT_S * row.load_slots.stop, color="#f2c14e", alpha=0.35)
        load = f", {row.load_pct:g} % of the processors taken in the shaded time" if row.load_pct else ""
        axes.set_title(f"{row.uavs} UAVs{load}", fontsize=9, loc="left")
        axes.set(ylim=(-5, 105), xlim=(0, SLOT_S * max(len(share), 1)))
    figure.supylabel("UAVs that fly a command, %", fontsize=9)
    figure.supxlabel("time, s", fontsize=9)
    figure.savefig(path)


def _text(value: float | None, form: str = ".0f") -> str:
    return "-" if value is None else format(value, form)


def main() -> int:
    """Fly all cases, and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uavs", type=int, nargs="+", default=[])
    parser.add_argument("--loads", type=float, nargs="+", default=[], help="per cent of every core")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--slots", type=int, default=0, help="of a run; by default as many as the load needs")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--checkout", type=Path, default=Path(__file__).parents[1], metavar="FOLDER")
    options = parser.parse_args()
    cases = [(uavs, load) for uavs in options.uavs or [50] for load in options.loads or [50, 90, 99]]
    cases += [(uavs, 0.0) for uavs in (150, 200, 300, 400) if not options.uavs and not options.loads]
    swarm = swarm_command(options.checkout)
    rows: list[Row] = []
    failed = 0
    if not options.json:
        print("UAVs  load %  without commands  flown %  late ticks %  normal after  ms per UAV and slot  PSS MB")
    with tempfile.TemporaryDirectory() as folder:
        for (uavs, load), seed in itertools.product(cases, range(options.runs)):
            slots = options.slots or (LOAD_FROM_SLOT + round(LOAD_S / SLOT_S) * bool(load) + AFTER_SLOTS)
            try:
                row = fly(swarm, options.checkout, uavs, load, seed, slots, Path(folder) / "run.mcap")
            except SwarmError as error:
                failed += 1
                print(f"error: {uavs} UAVs, load {load:g} %: {error}", file=sys.stderr, flush=True)
                continue
            rows.append(row)
            if not options.json:
                print(_line(row), flush=True)
            if options.plot is not None:
                plot(list({(row.uavs, row.load_pct): row for row in reversed(rows)}.values())[::-1], options.plot)
    if options.json:
        fields = ("uavs", "load_pct", "without", "flown_pct", "late_pct", "back_slots", "cost_ms", "pss_mb")
        print(json.dumps([{name: getattr(row, name) for name in fields} for row in rows]))
    return 1 if failed else 0


def _line(row: Row) -> str:
    flown, late = _text(row.flown_pct), _text(row.late_pct, ".2f")
    back, cost, memory = _text(row.back_slots), _text(row.cost_ms, ".2f"), _text(row.pss_mb, ".1f")
    without = f"{_text(row.without):>9} of {len(row.slots):3}"
    return f"{row.uavs:4}  {row.load_pct:6g}  {without}  {flown:>7}  {late:>12}  {back:>12}  {cost:>19}  {memory:>6}"


if __name__ == "__main__":
    sys.exit(main())
