"""`edc-swarm metrics`: every metric of a recording, from the recording alone."""

from __future__ import annotations

from pathlib import Path

import msgspec

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.own_metrics import own_metrics
from edc_swarm.analysis.timings import load_timings
from edc_swarm.foreign_text import shown
from edc_swarm.recording.reader import read_recording
from processes.cli.summary import print_metrics
from processes.runtime.console import note, print_json, stdout_console
from processes.runtime.output import unwritten
from processes.runtime.run_facts import source_hash


def metrics(
    recording: Path, /, *, json: bool = False, plots: Path | None = None, metric: list[str] | None = None
) -> int:
    """Compute every metric of a recording.

    Parameters
    ----------
    recording
        The recording, FILE.mcap.
    json
        Print JSON.
    plots
        Folder for plots: distributions of the ages of information, and of the delays of each emulated link.
    metric
        Metric of your own, package.module:Class; may be given several times.
    """
    if plots is not None:
        from processes.experiments.plots import check_plots  # noqa: PLC0415  (imports the statistics of scipy)

        check_plots()
        try:
            plots.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritten("--plots", plots, error) from None
    whole = read_recording(recording)
    if whole.garbage:
        first = whole.garbage[0]
        what = f"{shown(first.topic)}: {shown(first.reason)}"
        note(f"warning: {whole.garbage_count} payloads are no messages and are left out; {what}")
    found = compute_metrics(whole, load_timings(recording, note))
    if plots is not None:
        from processes.experiments.network_plots import draw_ages, draw_links  # noqa: PLC0415  (the same)

        draw_ages(whole, plots / "age-of-information")
        draw_links(whole, plots / "link-delays")
    own = own_metrics(whole, metric or [])
    if json:
        told = {name: {"value": value, "sha256": source_hash(name)} for name, value in own.items()}
        print_json({**msgspec.to_builtins(found), "own": told} if own else found)
        return 0
    print_metrics(found, stdout_console())
    for name, value in own.items():
        print(f"{name} (SHA-256 {source_hash(name)[:16] or 'unknown'}): {shown(msgspec.json.encode(value).decode())}")
    return 0
