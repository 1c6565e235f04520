"""The report page of a flight inside a notebook."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

from edc_swarm.analysis.guarantees.verdict import GuaranteeResult
from edc_swarm.analysis.metrics import Metrics
from edc_swarm.analysis.timings import Timing
from edc_swarm.recording.model import Recording
from edc_swarm.report_page.assets import page_assets
from edc_swarm.report_page.data import Page
from edc_swarm.report_page.render import Shown, render_all


@dataclass(frozen=True, slots=True)
class EmbeddedPage:
    """A page of HTML that a notebook shows in a frame of its own."""

    document: str
    height_px: int

    @classmethod
    def of(
        cls,
        recording: Recording,
        metrics: Metrics,
        verdicts: list[GuaranteeResult],
        timings: Sequence[Timing],
        height_px: int,
    ) -> EmbeddedPage:
        """Return the page of a recording, as `edc-swarm report` makes it."""
        shown = Shown(Page.of(recording, metrics.heads, timings), metrics, verdicts, recording.run)
        return cls(render_all([shown], page_assets()), height_px)

    def _repr_html_(self) -> str:
        """Return the frame; its scripts reach nothing outside of it."""
        source = html.escape(self.document)
        style = f"width:100%;height:{self.height_px}px;border:0"
        return f'<iframe sandbox="allow-scripts" style="{style}" srcdoc="{source}"></iframe>'
