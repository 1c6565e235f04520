"""`edc-swarm metrics`: every metric of a recording, from the recording alone."""

from __future__ import annotations

from pathlib import Path

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.timings import load_timings
from edc_swarm.foreign_text import shown
from edc_swarm.recording.reader import read_recording
from processes.cli.summary import print_metrics
from processes.experiments.network_plots import draw_ages, draw_links
from processes.experiments.plots import check_plots
from processes.runtime.console import note, print_json, stdout_console


def metrics(recording: Path, /, *, json: bool = False, plots: Path | None = None) -> int:
    """Compute every metric of a recording.

    Parameters
    ----------
    recording
        The recording, FILE.mcap.
    json
        Print JSON.
    plots
        Folder for plots: distributions of the ages of information, and of the delays of each emulated link.
    """
    if plots is not None:
        check_plots()
    whole = read_recording(recording)
    if whole.garbage:
        first = whole.garbage[0]
        what = f"{shown(first.topic)}: {shown(first.reason)}"
        note(f"warning: {whole.garbage_count} payloads are no messages and are left out; {what}")
    found = compute_metrics(whole, load_timings(recording, note))
    if plots is not None:
        draw_ages(whole, plots / "age-of-information")
        draw_links(whole, plots / "link-delays")
    if json:
        print_json(found)
    else:
        print_metrics(found, stdout_console())
    return 0
