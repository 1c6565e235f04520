"""`edc-swarm export`: the flown tracks of a recording, for other programs."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from edc_swarm.analysis.columns import Columns, columns_of
from edc_swarm.formats.tracks import Track, TrackPoint, csv_tracks, geojson_tracks, kml_tracks
from edc_swarm.geodesy import to_wgs84
from edc_swarm.mission.configuration import NS_PER_S
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.recording.reader import read_recording
from processes.runtime.console import note
from processes.runtime.output import SUFFIX, check_new, new_file


def export(
    recording: Path,
    /,
    *,
    format: Annotated[Literal["geojson", "kml", "csv"], Parameter(show_choices=True)] = "geojson",
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    force: bool = False,
) -> int:
    """Write the flown tracks of a recording: the centres of the tracked discs, slot by slot.

    Altitudes are not written: the mission knows none. Where the recording lacks the way of a UAV, its track has a gap.

    Parameters
    ----------
    recording
        The recording, FILE.mcap.
    format
        geojson (a line per UAV), kml (a track with times per UAV), csv (a row per UAV and slot).
    out
        The file to write (FILE with the suffix of the format, beside the recording).
    force
        Overwrite an existing file.
    """
    path = out or recording.with_name(f"{recording.name.removesuffix(SUFFIX)}.{format}")
    check_new(path, f".{format}", force=force)
    whole = read_recording(recording)
    tracks = tracks_of(columns_of(whole), whole.mission)
    for track in tracks:
        if len(track.runs) != 1:
            note(f"warning: {track.uav}: its way is known in {len(track.runs)} parts only")
    text = {
        "geojson": lambda: geojson_tracks(tracks),
        "kml": lambda: kml_tracks(tracks, whole.mission.name),
        "csv": lambda: csv_tracks(tracks),
    }[format]()
    with new_file(path) as stream:
        stream.write(text.encode())
    print(path)
    return 0


def tracks_of(columns: Columns, mission: MissionMessage) -> list[Track]:
    """Return the track of every UAV, while it lives and where its way is known."""
    known = known_points(columns)
    tracks = []
    for k, uav in enumerate(columns.uavs):
        slots = np.flatnonzero(known[:, k]).tolist()
        runs = [[slot for _, slot in run] for _, run in groupby(enumerate(slots), lambda pair: pair[1] - pair[0])]
        tracks.append(Track(uav, [[_point(columns, mission, slot, k) for slot in run] for run in runs]))
    return tracks


def known_points(columns: Columns) -> NDArray[np.bool_]:
    """Return (S + 1, K) True where the place of a living UAV is known when a slot begins, and at the end."""
    told = ~columns.lost & columns.alive
    known = np.zeros((len(told) + 1, told.shape[1]), dtype=bool)
    known[:-1] |= told
    known[1:] |= told
    return np.asarray(known & ~np.isnan(columns.centre_m[..., 0]))


def _point(columns: Columns, mission: MissionMessage, slot: int, k: int) -> TrackPoint:
    x_m, y_m = columns.centre_m[slot, k].tolist()
    lat_deg, lon_deg = to_wgs84(x_m, y_m, mission.origin_lat_deg, mission.origin_lon_deg)
    clock_ns = mission.epoch_ns + slot * mission.slot_ns
    whole_s, rest_ns = divmod(clock_ns, NS_PER_S)
    utc = f"{datetime.fromtimestamp(whole_s, UTC):%Y-%m-%dT%H:%M:%S}.{rest_ns // 1_000_000:03d}Z"
    true_m = columns.true_from_m[slot, k] if slot < len(columns.true_from_m) else columns.true_to_m[-1, k]
    shown_m = None if np.isnan(true_m).any() else (float(true_m[0]), float(true_m[1]))
    return TrackPoint(slot, slot * mission.dt_s, utc, lat_deg, lon_deg, x_m, y_m, shown_m)
