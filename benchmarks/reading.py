"""Speed of reading recordings: container alone, with decoding, and with all metrics.

    python benchmarks/reading.py FILE.mcap [FILE.mcap ...]

Times are processor time, so that a busy machine disturbs less. Rates count the swarm's messages only; scenes, which
the reader skips, are extra work. This command makes a recording of ten minutes with 50 UAVs:

    edc-swarm sim benchmarks/ten_minutes.toml --out FILE.mcap
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.timings import load_timings
from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.recording.reader import read_recording

REPEATS = 3


def best_s(work: Callable[[], object]) -> float:
    taken_s = []
    for _ in range(REPEATS):
        begun_s = time.process_time()
        work()
        taken_s.append(time.process_time() - begun_s)
    return min(taken_s)


def measure(path: Path) -> None:
    every = sum(1 for _ in McapFile(path).messages())
    bare_s = best_s(lambda: sum(1 for _ in McapFile(path).messages()))
    read_s = best_s(lambda: read_recording(path))
    recording, timings = read_recording(path), load_timings(path)
    compute_s = best_s(lambda: compute_metrics(recording, timings))
    count, duration_s = recording.message_count, compute_metrics(recording).duration_s
    size = f"{path.stat().st_size / 1e6:.1f} MB, {duration_s:g} s"
    print(f"{path}: {size}, {count} messages and {every - count} scenes and statuses")
    print(f"  container alone    {bare_s:6.2f} s  {count / bare_s:9.0f} messages/s")
    print(f"  read and decoded   {read_s:6.2f} s  {count / read_s:9.0f} messages/s")
    print(f"  read and computed  {read_s + compute_s:6.2f} s  {count / (read_s + compute_s):9.0f} messages/s")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        measure(Path(name))
