"""The documentation of the mission's fields: complete, current, and a mission file that flies."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from msgspec import Struct

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.declarations import declarations
from edc_swarm.mission.link import Link
from edc_swarm.mission.power_models import EnergyModel, HeadModel
from edc_swarm.mission.reference import EXAMPLE, ZONE, mission_page, reference_mission
from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.mission.validation import load_mission
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.recording.schemas import json_schema
from processes.cli.main import main

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "scenarios" / "reference.toml"
PROMISED = {
    "uavs", "area", "gps-error", "gps-model", "seed", "slot", "speed-max", "planner", "minimise", "elect", "fault",
    "delay-ms", "jitter-ms", "loss", "time-scale", "max-slots",
}  # fmt: skip
"""The options of `run` and `sim` for a mission, whose names stay."""
MADE = {ROOT / "docs" / "mission.md": mission_page, REFERENCE: reference_mission}
WITH_UNIT = re.compile(r"_(m|m2|s|ms|us|mps|w|j|db|deg|slots|kgpm3|kbps|bytes|j_per_message)$")
"""Names of fields that end with a unit."""


@pytest.mark.parametrize("path", MADE, ids=lambda path: path.name)
def test_the_reference_is_current(path: Path, request: pytest.FixtureRequest) -> None:
    """`--rewrite` writes it anew."""
    if request.config.getoption("--rewrite"):
        path.write_text(MADE[path](), encoding="utf-8")
    assert path.read_text(encoding="utf-8") == MADE[path](), f"write it anew: pytest {__file__} --rewrite"


@pytest.mark.parametrize("kind", [Mission, EnergyModel, HeadModel, RosterEntry, Link])
def test_every_field_is_documented(kind: type[Struct]) -> None:
    """With a summary in one line, limits and a source; a unit where the name has one."""
    found = declarations(kind)
    assert tuple(found) == kind.__struct_fields__
    page = mission_page()
    for name, field in found.items():
        assert field.summary
        assert field.source
        assert field.allowed != "of another type"
        assert bool(field.unit[0]) == bool(WITH_UNIT.search(name))
        assert f"\n| `{name}` |" in page


def test_the_reference_states_the_defaults() -> None:
    """Every field is in it, those of the empty lists in comments."""
    assert load_mission(REFERENCE) == Mission()
    text = REFERENCE.read_text(encoding="utf-8")
    for kind in (Mission, EnergyModel, HeadModel, RosterEntry, Link, Zone):
        for name in kind.__struct_fields__:
            assert re.search(rf"^(# )?(\[\[?)?{name}( = |\])", text, re.MULTILINE), name


def test_the_lists_of_the_reference_are_valid(tmp_path: Path) -> None:
    """Without the number signs they are a link with its defaults, and a UAV."""
    file = tmp_path / "all.toml"
    text = REFERENCE.read_text(encoding="utf-8").replace("uavs = 10\n", "")
    file.write_text(re.sub(r"^# (\[\[\w+\]\]|\w+ = )", r"\1", text, flags=re.MULTILINE), encoding="utf-8")
    mission = load_mission(file)
    assert mission.link == [Link()]
    assert mission.zone == [Zone(**ZONE)]
    assert mission.roster == [RosterEntry(**EXAMPLE)]


def test_the_reference_flies(tmp_path: Path) -> None:
    """With fewer UAVs and a planner that needs no compiler."""
    out = tmp_path / "a.mcap"
    assert main(["sim", str(REFERENCE), "--uavs", "2", "--planner", "straight", "--json", "--out", str(out)]) == 0


def test_the_documentation_is_not_recorded() -> None:
    """The schema of the mission message has names and types alone, so that recordings stay as they are."""
    keys = {key for field in json_schema(MissionMessage)["properties"].values() for key in field}
    assert keys <= {"title", "type", "enum", "properties", "items"}


@pytest.mark.parametrize("command", ["run", "sim"])
def test_help_says_what_the_declaration_says(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every field with an option, in the words of its declaration."""
    monkeypatch.setenv("COLUMNS", "1000")
    assert main([command, "--help"]) == 0
    said = re.sub(r"[\s│]+", " ", capsys.readouterr().out)
    options = [field for kind in (Mission, Link) for field in declarations(kind).values() if field.option]
    assert {field.option for field in options} >= PROMISED
    for field in options:
        assert re.search(rf"--{field.option} \S+ {re.escape(field.help)}", said), field.option
