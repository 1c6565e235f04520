"""`edc-swarm report`: a recording as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.timings import load_timings
from edc_swarm.recording.reader import read_recording
from edc_swarm.report_page.assets import page_assets
from edc_swarm.report_page.data import Page
from edc_swarm.report_page.render import Shown, render_all
from processes.experiments.judging import judged
from processes.runtime.console import note
from processes.runtime.output import SUFFIX, check_new, new_file

HTML = ".html"


def report(
    recording: Path,
    other: Path | None = None,
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    force: bool = False,
) -> int:
    """Make a self-contained page of a recording: the animated mission, its story, plots, metrics, guarantees.

    Parameters
    ----------
    recording
        The recording, FILE.mcap.
    other
        A second recording, which the page shows beside the first, with a table of differences.
    out
        The page to write (FILE.html beside the recording).
    force
        Overwrite an existing page.
    """
    path = out or recording.with_name(recording.name.removesuffix(SUFFIX) + HTML)
    check_new(path, HTML, force=force)
    document = render_all([_shown(each) for each in (recording, other) if each is not None], page_assets())
    with new_file(path) as stream:
        stream.write(document.encode())
    print(path)
    return 0


def _shown(path: Path) -> Shown:
    whole, timings = read_recording(path), load_timings(path, note)
    metrics = compute_metrics(whole, timings)
    page = Page.of(whole, metrics.heads, timings, name=path.name.removesuffix(SUFFIX))
    return Shown(page, metrics, judged(whole), whole.run)
