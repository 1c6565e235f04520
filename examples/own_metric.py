"""An example of a user's metric: how far the UAVs flew as a share of what the head commanded.

cd examples
edc-swarm sim --out flight.mcap && edc-swarm metrics flight.mcap --metric own_metric:Obedience
"""

from __future__ import annotations

import math

from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.recording.model import Recording


class Obedience:
    """100 x the way flown / the length of all commands."""

    def measure(self, recording: Recording) -> dict[str, float | None]:
        commanded_m = sum(
            math.dist((c.start_x_m, c.start_y_m), (c.target_x_m, c.target_y_m)) for c in recording.commands
        )
        flown_m = compute_metrics(recording).path_m
        return {"obedience_pct": 100 * flown_m / commanded_m if flown_m is not None and commanded_m else None}
