"""`edc-swarm export`: the flown tracks of a recording, for other programs."""

from __future__ import annotations

import math
from itertools import groupby
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from edc_swarm.analysis.guarantees.evidence import gather
from edc_swarm.analysis.living import alive_in, living_at_end
from edc_swarm.analysis.tracks import Tracks
from edc_swarm.errors import InputError
from edc_swarm.foreign_text import listed
from edc_swarm.formats.tracks import Track, TrackPoint, csv_tracks, geojson_tracks, kml_tracks
from edc_swarm.geodesy import to_wgs84
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from processes.runtime.console import note
from processes.runtime.output import SUFFIX, check_new, is_same_file, new_file


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
        geojson, a line per UAV; kml, a track with times per UAV; csv, a row per UAV and slot (geojson).
    out
        The file to write (FILE with the suffix of the format, beside the recording).
    force
        Overwrite an existing file.
    """
    path = out or recording.with_name(f"{recording.name.removesuffix(SUFFIX)}.{format}")
    check_new(path, f".{format}", force=force)
    if is_same_file(path, recording):
        raise InputError("--out", str(path), "another file than the recording")
    whole = read_recording(recording)
    tracks = tracks_of(whole)
    unknown = [track.uav for track in tracks if not track.runs]
    if len(unknown) == len(tracks):
        raise InputError("recording", str(recording), "one that has the way of a UAV")
    if unknown:
        note(f"warning: the way of {listed(unknown)} is not known")
    if parted := [track.uav for track in tracks if len(track.runs) > 1]:
        note(f"warning: the way of {listed(parted)} is known in parts only")
    text = {
        "geojson": lambda: geojson_tracks(tracks),
        "kml": lambda: kml_tracks(tracks, whole.mission.name),
        "csv": lambda: csv_tracks(tracks),
    }[format]()
    with new_file(path) as stream:
        stream.write(text.encode())
    print(path)
    return 0


def tracks_of(recording: Recording) -> list[Track]:
    """Return the track of every UAV: while it lives and has a disc, and where its way is known."""
    found = gather(recording).tracks
    alive = alive_in(found, living_at_end(recording, found))
    told = alive & ~(found.lost | found.astray)
    known = np.zeros((found.slots + 1, len(found.uavs)), dtype=bool)
    known[:-1] |= told
    known[1:] |= told
    tracks = []
    for k, uav in enumerate(found.uavs):
        slots = np.flatnonzero(known[:, k]).tolist()
        runs = [[slot for _, slot in run] for _, run in groupby(enumerate(slots), lambda pair: pair[1] - pair[0])]
        tracks.append(Track(uav, [[_point(found, recording.mission, slot, k) for slot in run] for run in runs]))
    return tracks


def _point(tracks: Tracks, mission: MissionMessage, slot: int, k: int) -> TrackPoint:
    x_m, y_m = tracks.centre_m[slot, k].tolist()
    lat_deg, lon_deg = to_wgs84(x_m, y_m, mission.origin_lat_deg, mission.origin_lon_deg)
    clock_ns = mission.epoch_ns + slot * mission.slot_ns
    ends_m = [*tracks.true_from_m[slot : slot + 1, k].tolist(), *tracks.true_to_m[max(slot - 1, 0) : slot, k].tolist()]
    true_m = next(((x_m, y_m) for x_m, y_m in ends_m if not math.isnan(x_m)), None)
    return TrackPoint(slot, slot * mission.dt_s, clock_ns, lat_deg, lon_deg, x_m, y_m, true_m)
