"""The reference of mission files, made from the declarations: a page, and a mission file with every field.

`pytest tests/unit/test_mission_reference.py --rewrite` writes docs/mission.md and scenarios/reference.toml anew;
without `--rewrite` it checks that they are current.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import Struct

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declarations import Declaration, declarations
from edc_swarm.mission.link import Link
from edc_swarm.mission.power_models import EnergyModel, HeadModel
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.vehicle_model import VehicleModel
from edc_swarm.mission.wind_model import WindModel
from edc_swarm.mission.zone import Zone

TABLES: dict[str, type[Struct]] = {"energy": EnergyModel, "head": HeadModel, "vehicle": VehicleModel, "wind": WindModel}
"""Tables of a mission file, by key."""
LISTS: dict[str, type[Struct]] = {"link": Link, "zone": Zone, "roster": RosterEntry}
"""Lists of tables of a mission file, by key."""
EXAMPLE: dict[str, Any] = {
    "uav": "north",
    "start_x_m": 50.0,
    "start_y_m": 90.0,
    "target_x_m": 50.0,
    "target_y_m": 10.0,
}
"""Values of the keys whose default says nothing."""
ZONE: dict[str, Any] = {"name": "tower", "kind": "exclusion", "centre": [75.0, 50.0], "radius_m": 12.0}
"""A zone, which is a polygon or a circle, so that its defaults alone would be no zone."""
EXAMPLES: dict[type[Struct], dict[str, Any]] = {RosterEntry: EXAMPLE, Zone: ZONE}
PAGE = """\
# Mission file

<!-- Made by `pytest tests/unit/test_mission_reference.py --rewrite` from the structs of edc_swarm/mission. -->

A mission file is TOML. A file states only what differs from the defaults; [scenarios/reference.toml][reference] states
every field. An unknown field, a value of another type or beyond its limits, and a number that is not finite are
rejected with the field, the value and what is allowed. An option of `edc-swarm run` and `sim` replaces the value of the
file.

Zones, and how a mission with them is checked before take-off: [zones.md](zones.md).

"Wall time" is the time of a clock on the wall; all other times are time of the mission, `time_scale` times as fast.

[reference]: ../scenarios/reference.toml
"""
FILE = """\
# Every field of a mission with its default. `edc-swarm sim scenarios/reference.toml` flies the default mission.
# docs/mission.md says more of each field. Both files are made from the structs of edc_swarm/mission.
"""


def mission_page() -> str:
    """Return docs/mission.md."""
    titles = {
        "": "Mission",
        **{key: f"Table `[{key}]`" for key in TABLES},
        **{key: f"Tables `[[{key}]]`" for key in LISTS},
    }
    kinds: dict[str, type[Struct]] = {"": Mission, **TABLES, **LISTS}
    return PAGE + "".join(f"\n## {title}\n\n{_table(kinds[key])}" for key, title in titles.items())


def reference_mission() -> str:
    """Return scenarios/reference.toml; the lists, which are empty by default, are comments."""
    plain = [name for name in Mission.__struct_fields__ if name not in {**TABLES, **LISTS}]
    parts = [FILE, *_lines(Mission, plain)]
    for key, kind in TABLES.items():
        parts += [f"\n[{key}]\n", *_lines(kind, kind.__struct_fields__)]
    for key, kind in LISTS.items():
        summary = declarations(Mission)[key].summary
        parts += [f"\n# {summary}; by default there is none:\n#\n# [[{key}]]\n"]
        parts += [f"# {line}".replace("# \n", "#\n") for line in _lines(kind, kind.__struct_fields__)]
    return "".join(parts)


def _table(kind: type[Struct]) -> str:
    rows = (
        ["field", "value", "unit", "default", "meaning", "source", "option"],
        ["---"] * 7,
        *map(_row, declarations(kind).values()),
    )
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _row(field: Declaration) -> list[str]:
    meaning = f"{field.summary}. {field.effect}".strip()
    option = f"`--{field.option}`" if field.option else ""
    cells = [
        f"`{field.name}`",
        field.allowed,
        field.unit[0],
        field.default or "must be given",
        meaning,
        field.source,
        option,
    ]
    return [cell.replace("|", "\\|").replace("*", "\\*") for cell in cells]


def _lines(kind: type[Struct], names: tuple[str, ...] | list[str]) -> Iterator[str]:
    """Yield a blank line, a comment and a line of TOML for each field."""
    fields = {field.name: field for field in msgspec.structs.fields(kind)}
    for name in names:
        field = declarations(kind)[name]
        facts = "; ".join(fact for fact in (field.unit[1], field.allowed) if fact)
        value = EXAMPLES.get(kind, {}).get(name, fields[name].default)
        text = msgspec.json.encode(value if value is not msgspec.NODEFAULT else []).decode()
        yield "\n"
        yield f"# {field.summary} ({facts}).\n"
        yield f"{name} = {text}\n"
