"""`edc-swarm import`: files of other programs as a mission file."""

from __future__ import annotations

import re
from collections.abc import Sized
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from edc_swarm.emulation.energy import check_batteries
from edc_swarm.errors import FormatError, InputError
from edc_swarm.files import open_regular
from edc_swarm.foreign_text import shown
from edc_swarm.formats.assemble import Imported, Settings, assemble
from edc_swarm.formats.content import MAX_FILE_BYTES, Options, Point
from edc_swarm.formats.registry import Source, read_files
from edc_swarm.formats.toml_text import mission_text, note_lines
from edc_swarm.mission.field_types import MAX_UAVS
from processes.cli.whole_number import WholeNumber
from processes.runtime.console import print_json
from processes.runtime.output import check_new, new_file

MAX_FILES = 100
TOML = ".toml"


def import_files(
    files: list[Path],
    /,
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("mission.toml"),
    force: bool = False,
    json: bool = False,
    origin: str | None = None,
    r: float | None = None,
    speed_max: float | None = None,
    slot: float | None = None,
    start: Literal["home", "first"] = "home",
    polygons: Literal["inclusion", "exclusion"] = "exclusion",
    cell: float = 10.0,
    agents: WholeNumber = 10,
    list_unknown: bool = False,
    mixed_altitudes: bool = False,
) -> int:
    """Make one mission file of files of other programs, and list what a mission does not express.

    Reads QGroundControl plans, MAVLink way points, ArduPilot fences, KML and KMZ, GeoJSON, CSV, MAPF maps with
    scenarios, and planar LSC missions (docs/formats.md). Every route is one UAV.

    Parameters
    ----------
    files
        The files to read.
    out
        The mission file to write (mission.toml).
    force
        Overwrite an existing file.
    json
        Print the result as JSON alone on standard output.
    origin
        Origin of the mission's plane, LAT,LON in degrees (home, or else the first point).
    r
        GPS error radius of every UAV, in metres (of the file, or else 5; MAPF: 0.2 of a cell).
    speed_max
        Largest speed of every UAV, in m/s (of the file, or else 5).
    slot
        Length of a slot, in seconds (0.5, or less where a step would be longer than a disc's radius).
    start
        Where UAVs start: at the home position of their file, or at their first way point (home).
    polygons
        Kind of a polygon of KML or GeoJSON that does not state one (exclusion).
    cell
        Side of a cell of a MAPF map, in metres (10).
    agents
        Number of agents of a MAPF scenario, from its first on (10).
    list_unknown
        List MAVLink commands that are not known, rather than refuse their file.
    mixed_altitudes
        Accept altitudes above sea level beside others: no altitude is flown.
    """
    check_new(out, TOML, force=force)
    _check_number("--r", r, 1e5)
    _check_number("--speed-max", speed_max, 1e4)
    _check_number("--slot", slot, 60.0, least=0.02)
    _check_number("--cell", cell, 1e4, least=0.01)
    if not 1 <= agents <= MAX_UAVS:
        raise InputError("--agents", agents, f"from 1 to {MAX_UAVS}")
    options = Options(start, polygons, cell, agents, list_unknown, mixed_altitudes)
    sources = read_files(_bytes_of(files), options)
    imported = assemble(sources, Settings(_name(out), _origin(origin), r, speed_max, slot, start == "home"))
    check_batteries(imported.flown)
    names = [str(file) for file in files]
    with new_file(out) as stream:
        stream.write(mission_text(imported, names).encode())
    if json:
        print_json(_facts(out, sources, imported))
    else:
        _print(out, sources, imported)
    return 0


def _check_number(option: str, value: float | None, most: float, least: float = 1e-3) -> None:
    if value is not None and not least <= value <= most:
        raise InputError(option, value, f"a number from {least:g} to {most:g}")


def _origin(text: str | None) -> Point | None:
    if text is None:
        return None
    try:
        lat_deg, lon_deg = (float(part) for part in text.split(","))
    except ValueError:
        lat_deg = lon_deg = float("nan")
    if not (-89 <= lat_deg <= 89 and -180 <= lon_deg <= 180):
        raise InputError("--origin", text, "LAT,LON: from -89 to 89 and from -180 to 180 degrees")
    return lat_deg, lon_deg


def _bytes_of(files: list[Path]) -> list[tuple[str, bytes]]:
    if len(files) > MAX_FILES:
        raise InputError("files", len(files), f"at most {MAX_FILES}")
    found: list[tuple[str, bytes]] = []
    for path in files:
        if str(path) in dict(found):
            raise FormatError("", "must be given once", str(path))
        try:
            with open_regular(path) as stream:
                data = stream.read(MAX_FILE_BYTES + 1)
        except OSError as error:
            raise FormatError("", f"must be a readable file ({error.strerror})", str(path)) from None
        if len(data) > MAX_FILE_BYTES:
            raise FormatError("", f"must be at most {MAX_FILE_BYTES} bytes", str(path))
        found.append((str(path), data))
    return found


def _name(out: Path) -> str:
    """Return the name of the mission: the name of its file, as far as a name may have its letters."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", out.stem)[:64] or "imported"


def _print(out: Path, sources: list[Source], imported: Imported) -> None:
    for source in sources:
        content = source.content
        found = f"{_count(content.routes, 'route')}, {_count(content.areas, 'zone')}"
        print(shown(f"{source.file}: {source.format}: {found}", 1000))
    for line in note_lines(imported):
        print(line)
    print(f"{out}: {_count(imported.mission['roster'], 'UAV')}, {_count(imported.mission['zone'], 'zone')}")


def _count(things: Sized, what: str) -> str:
    return f"{len(things)} {what}{'s' * (len(things) != 1)}"


def _facts(out: Path, sources: list[Source], imported: Imported) -> dict[str, object]:
    return {
        "mission": str(out),
        "uavs": len(imported.mission["roster"]),
        "zones": len(imported.mission["zone"]),
        "files": [
            {
                "file": source.file,
                "format": source.format,
                "routes": len(source.content.routes),
                "zones": len(source.content.areas),
                "not_expressed": [
                    {"what": what, "count": len(items), "items": items}
                    for what, items in imported.notes[source.file].items()
                ],
            }
            for source in sources
        ],
        "remarks": imported.remarks,
    }
