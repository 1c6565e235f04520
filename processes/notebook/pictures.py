"""Pictures of flights and sweeps for notebooks, with matplotlib (extra `notebook`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from edc_swarm.analysis.columns import Columns
from edc_swarm.errors import InputError
from edc_swarm.extras import install_command
from edc_swarm.mission.zone import Zone
from edc_swarm.recording.model import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ZONE_COLOUR = {"inclusion": "0.4", "exclusion": "tab:red"}


def new_axes(ax: Axes | None) -> Axes:
    """Return `ax`, or the axes of a new figure.

    Raises
    ------
    InputError
        matplotlib is not installed.
    """
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError("plot", "matplotlib", f"installed: {install_command('notebook')}") from None
    return plt.subplots(layout="constrained")[1]


def draw_paths(recording: Recording, columns: Columns, ax: Axes | None = None) -> Axes:
    """Draw the way of every disc's centre, the starts, targets and zones, in metres; return the axes.

    Where the record lacks the motion of a UAV, its line is broken.
    """
    ax = new_axes(ax)
    mission = recording.mission
    for zone in mission.zone:
        _draw_zone(zone, ax)
    known = np.concatenate([~columns.lost, np.ones((1, len(columns.uavs)), bool)])
    for k, uav in enumerate(columns.uavs):
        x_m, y_m = np.where(known[:, k, None], columns.centre_m[:, k], np.nan).T
        ax.plot(x_m, y_m, linewidth=1, label=uav)
    for entry in mission.roster:
        ax.plot(entry.start_x_m, entry.start_y_m, "o", markersize=3, color="0.2")
        ax.plot(entry.target_x_m, entry.target_y_m, "x", markersize=5, color="0.2")
    ax.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    ax.set_title(f"{mission.uavs} UAVs, planner {mission.planner}, seed {mission.seed}")
    return ax


def _draw_zone(zone: Zone, ax: Axes) -> None:
    from matplotlib import patches  # noqa: PLC0415 - an extra

    style: dict[str, Any] = {"fill": zone.kind == "exclusion", "alpha": 0.25 if zone.kind == "exclusion" else 1.0}
    colour = ZONE_COLOUR[zone.kind]
    if zone.polygon:
        ax.add_patch(patches.Polygon(np.array(zone.polygon), color=colour, **style))
    elif zone.centre is not None:
        ax.add_patch(patches.Circle((zone.centre[0], zone.centre[1]), zone.radius_m, color=colour, **style))
