"""Mission files and other plain data, read and checked.

Unknown keys, wrong types and non-finite numbers are rejected with the field, the value and what is allowed.
"""

from __future__ import annotations

import hashlib
import math
import re
from codecs import BOM_UTF8
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from itertools import count
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Struct

from edc_swarm.errors import InputError, MissionError, SpacingError
from edc_swarm.files import open_regular
from edc_swarm.mission.configuration import AREA_M2, Mission
from edc_swarm.mission.inheritance import with_radii
from edc_swarm.mission.link import Link, check_link
from edc_swarm.mission.plug_ins import check_names
from edc_swarm.mission.roles import RESERVED_IDS
from edc_swarm.mission.roster_entry import LACKS_TARGET, RosterEntry
from edc_swarm.mission.trace import Trace, check_traces, pack
from edc_swarm.mission.trace_file import MAX_TRACE_BYTES, read_trace
from edc_swarm.mission.vehicle_model import FIGURES, IDEAL
from edc_swarm.mission.wording import in_words, type_at
from edc_swarm.mission.zone_shapes import check_shapes

MAX_MISSION_BYTES = 4 << 20
T = TypeVar("T", bound=Struct)
_MISSING = re.compile(r"Object missing required field `(\w+)`")
"""The message of msgspec for a table that lacks a key."""


def load_mission(path: str | Path, what: str = "mission file") -> Mission:
    """Read and validate a mission file; `what` names it to the user.

    Raises
    ------
    MissionError
        The file is missing, too large, not TOML, or a field is not acceptable.
    """
    raw = read_toml(what, path, MissionError)
    refuse_idle(raw.get("vehicle"))
    return with_traces(mission_from_dict(raw), Path(path).parent)


def with_traces(mission: Mission, folder: Path) -> Mission:
    """Return the mission with the trace files of its links, relative to `folder`, read into its tables `trace`.

    Links that read the same file in the same way share a table. A link that names a table is left as it is.

    Raises
    ------
    MissionError
        A file cannot be read, is too large, or does not hold what its link says.
    """
    traces, links, known = list(mission.trace), list[Link](), dict[Any, str]()
    for index, link in enumerate(mission.link):
        reading = (link.trace, tuple(link.trace_columns.items()), link.trace_unit, link.round_trip)
        if link.trace and reading not in known and link.trace not in {trace.name for trace in mission.trace}:
            traces.append(_trace(link, f"link[{index}]", folder, {trace.name for trace in traces}))
            known[reading] = traces[-1].name
        links.append(msgspec.structs.replace(link, trace=known.get(reading, link.trace)))
    check_traces(traces)
    return msgspec.structs.replace(mission, link=links, trace=traces)


def _trace(link: Link, where: str, folder: Path, taken: Collection[str]) -> Trace:
    """Return the content of the file of a link as a table of its own name."""
    try:
        with open_regular(folder / link.trace) as opened:
            data = opened.read(MAX_TRACE_BYTES + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise MissionError(f"{where}.trace", link.trace, f"a readable file ({why})") from None
    if len(data) > MAX_TRACE_BYTES:
        raise MissionError(f"{where}.trace", link.trace, f"a file of at most {MAX_TRACE_BYTES} bytes; cut it")
    kind, rows = read_trace(data, link, where)
    own = Path(link.trace).name[-100:]
    name = next(name for k in count(1) if (name := own if k == 1 else f"{own} {k}") not in taken)
    return Trace(
        name=name,
        kind=kind,
        rows=len(rows.at_us),
        period_us=rows.period_us,
        sha256=hashlib.sha256(data).hexdigest(),
        packed=pack(rows),
    )


RECORDING_BEGINS = b"\x89MCAP"
"""First bytes of a recording."""


def read_toml(what: str, path: str | Path, refused: type[InputError] = InputError) -> dict[str, Any]:
    """Return the content of a TOML file of moderate size, not yet checked; `what` names it to the user.

    Raises
    ------
    InputError
        Of type `refused`: the file cannot be read, is too large, or is not TOML.
    """
    file = Path(path)
    try:
        with open_regular(file) as opened:
            text = opened.read(MAX_MISSION_BYTES + 1)
        if text.startswith(RECORDING_BEGINS):
            raise refused(what, str(file), "a TOML file; it is a recording, which `edc-swarm events` and `check` read")
        if len(text) > MAX_MISSION_BYTES:
            raise refused(what, str(file), f"at most {MAX_MISSION_BYTES} bytes, not {file.stat().st_size}")
        return cast("dict[str, Any]", msgspec.toml.decode(text.removeprefix(BOM_UTF8)))
    except OSError as error:
        raise refused(what, str(file), f"a readable file ({error.strerror})") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        found = "it looks like JSON" if text.lstrip().startswith(b"{") else error
        raise refused(what, str(file), f"valid TOML ({found})") from None


def mission_from_dict(raw: Mapping[str, Any]) -> Mission:
    """Validate plain data and return it as a mission.

    Raises
    ------
    MissionError
        With the field, the value and what is allowed.
    """
    refuse_unknown(raw, Mission)
    refuse_non_finite(raw)
    roster = raw.get("roster")
    if isinstance(roster, list) and roster:
        raw = {"uavs": len(roster), **raw}
    mission = convert(raw, Mission)
    validate_mission(mission)
    return mission


def with_options(mission: Mission, options: Mapping[str, Any]) -> Mission:
    """Return `mission` with the given fields replaced, validated as a whole."""
    return mission_from_dict({**msgspec.to_builtins(mission), **options})


def convert(raw: Any, kind: type[T]) -> T:
    """Convert plain data to a `kind`; an error names the field, the value and, in words, what is allowed.

    Raises
    ------
    MissionError
    """
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        message, _, path = str(error).partition(" - at `$")
        path = path.rstrip("`").removeprefix(".")
        missing = _MISSING.fullmatch(message)
        said = LACKS_TARGET if message == LACKS_TARGET else f"a table with {missing[1]}" if missing else ""
        allowed = said or in_words(type_at(kind, path))
        raise MissionError(path or "mission", _at(raw, path), allowed) from None


def refuse_unknown(raw: Any, kind: Any, where: str = "") -> None:
    """Raise `MissionError` for a key of `raw` that `kind` (a Struct type) does not have."""
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) is list and isinstance(raw, list):
        for index, item in enumerate(raw):
            refuse_unknown(item, get_args(kind)[0], f"{where}[{index}]")
    elif isinstance(kind, type) and issubclass(kind, Struct) and isinstance(raw, Mapping):
        hints = get_type_hints(kind, include_extras=True)
        for key, value in raw.items():
            name = f"{where}.{key}" if where else str(key)
            if key not in hints:
                near = get_close_matches(str(key), hints, 1)
                meant = f" (do you mean {near[0]}?)" if near else ""
                raise MissionError(name, value, f"one of the known keys: {', '.join(sorted(hints))}{meant}")
            refuse_unknown(value, hints[key], name)


def refuse_non_finite(raw: Any, where: str = "") -> None:
    """Raise `MissionError` for any infinite or NaN number inside plain data."""
    if isinstance(raw, float) and not math.isfinite(raw):
        raise MissionError(where, raw, "a finite number")
    if isinstance(raw, Mapping):
        for key, value in raw.items():
            refuse_non_finite(value, f"{where}.{key}" if where else str(key))
    elif isinstance(raw, list):
        for index, value in enumerate(raw):
            refuse_non_finite(value, f"{where}[{index}]")


def refuse_idle(vehicle: Any) -> None:
    """Raise `MissionError` for a table `vehicle` of the user that states 0 for a figure of a vehicle with inertia.

    Such a vehicle cannot fly. In a `Mission` 0 stands for the figure of the parameter set, so only what the user states
    can be judged.
    """
    if isinstance(vehicle, Mapping) and vehicle.get("model") != IDEAL:
        for name in FIGURES:
            if vehicle.get(name) == 0:
                raise MissionError(f"vehicle.{name}", vehicle[name], "above 0, or left out for the figure of the model")


def validate_mission(mission: Mission) -> None:
    """Raise `MissionError` unless the fields fit together."""
    if mission.roster and mission.uavs != len(mission.roster):
        raise MissionError("uavs", mission.uavs, f"the length of the roster ({len(mission.roster)})")
    if 2 * mission.guard_s >= mission.dt_s:
        raise MissionError("guard_s", mission.guard_s, f"less than half of dt_s ({mission.dt_s})")
    if mission.tau_s >= mission.dt_s:
        raise MissionError("tau_s", mission.tau_s, f"less than dt_s ({mission.dt_s})")
    if mission.body_m > mission.r_m:
        raise MissionError("body_m", mission.body_m, f"at most r_m ({mission.r_m})")
    if mission.energy.initial_min_j > mission.energy.initial_max_j:
        raise MissionError("energy.initial_min_j", mission.energy.initial_min_j, "at most initial_max_j")
    _validate_area(mission)
    check_shapes(mission.zone)
    check_traces(mission.trace)
    check_names(mission)
    for index, link in enumerate(mission.link):
        check_link(link, f"link[{index}]")
    _validate_roster(with_radii(mission))


def _validate_area(mission: Mission) -> None:
    x_m, y_m = mission.area_x_m, mission.area_y_m
    if bool(x_m) != bool(y_m):
        field, value, other = ("area_y_m", y_m, "area_x_m") if x_m else ("area_x_m", x_m, "area_y_m")
        raise MissionError(field, value, f"above 0 beside {other}, or both are left out")
    if x_m and mission.area_m2 != AREA_M2:
        raise MissionError("area_m2", mission.area_m2, "left out beside area_x_m and area_y_m")


def check_links(mission: Mission) -> None:
    """Raise `MissionError` for a link that names a UAV which is not in the roster, or a trace that is not read."""
    known = {"*", *(entry.uav for entry in mission.roster)}
    traces = {"", *(trace.name for trace in mission.trace)}
    for index, link in enumerate(mission.link):
        for end in ("sender", "receiver"):
            value = getattr(link, end)
            if value not in known:
                raise MissionError(f"link[{index}].{end}", value, 'the id of a UAV of the roster, or "*"')
        if link.trace not in traces:
            raise MissionError(f"link[{index}].trace", link.trace, "a file beside a mission file, or a table trace")


def _validate_roster(roster: list[RosterEntry]) -> None:
    seen: set[str] = set()
    for index, entry in enumerate(roster):
        if entry.uav in seen:
            raise MissionError(f"roster[{index}].uav", entry.uav, "an id that no other UAV has")
        if entry.uav in RESERVED_IDS:
            raise MissionError(f"roster[{index}].uav", entry.uav, f"none of {', '.join(sorted(RESERVED_IDS))}")
        if entry.body_m > entry.r_m:
            raise MissionError(f"roster[{index}].body_m", entry.body_m, f"at most r_m ({entry.r_m})")
        _validate_route(f"roster[{index}]", entry)
        seen.add(entry.uav)
    _validate_separation(roster, "start")
    _validate_separation(roster, "target")


def _validate_route(where: str, entry: RosterEntry) -> None:
    target_m = (entry.target_x_m, entry.target_y_m)
    if entry.points[-1] != target_m:
        raise MissionError(f"{where}.target_x_m, target_y_m", target_m, f"the last point of route, {entry.points[-1]}")
    if len(entry.hover_s) not in {0, len(entry.route)}:
        raise MissionError(f"{where}.hover_s", entry.hover_s, f"empty, or as long as route ({len(entry.route)})")


def _validate_separation(roster: list[RosterEntry], which: str) -> None:
    """Raise `SpacingError` unless the discs at starts (or targets) are disjoint: else no plan is safe, or none ends."""
    points = sorted((getattr(e, f"{which}_x_m"), getattr(e, f"{which}_y_m"), e.r_m, i) for i, e in enumerate(roster))
    widest_m = 2 * max((e.r_m for e in roster), default=0.0)
    for position, (x_m, y_m, r_m, index) in enumerate(points):
        for other_x_m, other_y_m, other_r_m, other in points[position + 1 :]:
            if other_x_m - x_m >= widest_m:
                break
            gap_m = math.hypot(other_x_m - x_m, other_y_m - y_m)
            if gap_m < r_m + other_r_m:
                raise SpacingError(
                    f"roster[{index}].{which}_x_m, {which}_y_m",
                    (x_m, y_m),
                    f"at least {r_m + other_r_m:g} m from the {which} of {roster[other].uav}, not {gap_m:.3f} m",
                )


def _at(raw: Any, path: str) -> Any:
    """Return the value at a msgspec path such as `roster[2].r_m`, or None if there is none."""
    for part in re.findall(r"[^.\[\]]+", path):
        if isinstance(raw, Mapping):
            raw = raw.get(part)
        elif isinstance(raw, list) and part.isdigit():
            raw = raw[int(part)]
        else:
            return None
    return raw
