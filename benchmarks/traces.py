"""Delays of a measured network in real processes, beside those of its file.

    python benchmarks/traces.py [--trace scenarios/traces/cicv5g_stalls.txt] [--rounds 3]

Three UAVs fly for `--rounds` rounds of the trace, in slots of about one row, with `trace_offset = "none"`. The table
has quantiles of the file, of the delays that the newest row gave to what was sent (`model`), and of the delays that
the receivers measured (event `link-delays`), over all links. Run it on an idle machine: busy ones deliver late.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from bisect import bisect_right
from pathlib import Path

import numpy as np

from edc_swarm.analysis.latency_sample import sample_of
from edc_swarm.analysis.link_delays import link_delays_of
from edc_swarm.emulation.delay_log import LEVELS_PCT, quantiles
from edc_swarm.mission.trace import Rows, unpack
from edc_swarm.mission.validation import load_mission
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording

MISSION = """\
name = "traces"
uavs = 3
standbys = 2
dt_s = 0.055
max_slots = {slots}
goals = "lifelong"

[[link]]
trace = "{trace}"
trace_columns = {{ sent = 1, {other} }}
round_trip = true
trace_offset = "none"
"""


def main() -> int:
    """Fly, and print the table."""
    parser = argparse.ArgumentParser(description="Delays of a measured network in processes and in its file.")
    parser.add_argument("--trace", type=Path, default=Path("scenarios/traces/cicv5g_stalls.txt"))
    parser.add_argument("--other", default="received = 2", help="the second column, as in trace_columns")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder, "mission.toml"), Path(folder, "run.mcap")
        text = MISSION.format(slots=10, trace=options.trace.resolve(), other=options.other)
        file.write_text(text)
        mission = load_mission(file)
        rows = unpack(mission.trace[0])
        slots = round(options.rounds * rows.period_us / 1e6 / mission.dt_s)
        file.write_text(text.replace("max_slots = 10", f"max_slots = {slots}"))
        edc_swarm = Path(sys.executable).with_name("edc-swarm")
        subprocess.run([edc_swarm, "run", file, "--out", out, "--no-viz"], check=True, stdout=subprocess.DEVNULL)
        _show(read_recording(out), rows)
    return 0


def _show(recording: Recording, rows: Rows) -> None:
    told = link_delays_of(recording)
    heard = sum(found.arrived for found in told.values())
    measured = np.average(
        [found.delay_ms for found in told.values()], axis=0, weights=[found.arrived for found in told.values()]
    )
    sent_ns = [report.sent_ns for report in recording.reports] + [fix.sent_ns for fix in recording.fixes]
    sent_us = [(ns - recording.mission.epoch_ns) // 1000 for ns in sent_ns]
    places = [bisect_right(rows.at_us, at_us % rows.period_us) - 1 for at_us in sent_us if at_us >= 0]
    model = quantiles([rows.delay_us[place] for place in places])
    print(f"{heard} messages arrived on {len(told)} links")
    print("quantile     file      model   measured   [ms]")
    for level, of_file, of_model, found in zip(LEVELS_PCT, quantiles(rows.delay_us), model, measured, strict=True):
        print(f"{level:7} % {of_file / 1e3:9.2f} {of_model / 1e3:10.2f} {found:10.2f}")
    late = sample_of(recording).delay_error
    if late is not None:
        print(f"later than the model: {late.p50_ms:.2f} ms median, {late.p99_ms:.2f} ms p99, {late.max_ms:.2f} ms most")


if __name__ == "__main__":
    sys.exit(main())
