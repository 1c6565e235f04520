"""Mission files: defaults, limits, and one line that says what is wrong."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission, default_tau_s
from edc_swarm.mission.validation import MAX_MISSION_BYTES, load_mission, mission_from_dict, with_options

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden.mcap"


def entry(uav: str = "a", **fields: Any) -> dict[str, Any]:
    """A roster entry that is fine unless told otherwise."""
    basis = {"start_x_m": 0.0, "start_y_m": 0.0, "target_x_m": 50.0, "target_y_m": 0.0}
    return {"uav": uav, **basis, "r_m": 5.0, "body_m": 0.25, "energy_j": 1e4, **fields}


def refused(raw: dict[str, Any]) -> MissionError:
    """The error that `raw` gives, checked to be a single line of the promised shape."""
    with pytest.raises(MissionError) as caught:
        mission_from_dict(raw)
    text = str(caught.value)
    assert re.fullmatch(r"[^\n]+ = [^\n]+: must be [^\n]+", text), text
    assert text.startswith(f"{caught.value.field} = ")
    return caught.value


def test_defaults() -> None:
    """An empty mission is the documented one."""
    mission = mission_from_dict({})
    assert (mission.uavs, mission.area_m2, mission.r_m, mission.v_max_mps) == (10, 10_000.0, 5.0, 5.0)
    assert (mission.dt_s, mission.seed, mission.planner, mission.elect) == (0.5, 0, "edc", "energy")
    assert (mission.standbys, mission.lease_slots, mission.lag_slots, mission.guard_s) == (3, 2, 0, 0.0)
    assert (mission.body_m, mission.handover_margin, mission.gps_model) == (0.25, 0.1, "bias")
    assert default_tau_s(mission) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("field", "good", "bad"),
    [
        ("name", ["a", "A-b_9" * 12], ["", "a b", "a\n", "x" * 65, "a/b", 3, None]),
        ("seed", [0, (1 << 63) - 1], [-1, 1 << 63, 0.5, "1", True]),
        ("uavs", [1, 10_000], [0, 10_001, 1.5, "ten"]),
        ("area_m2", [1e-3, 1, 1e12], [0, -1, "big", 1.1e12]),
        ("r_m", [0.25, 1000.0], [0, -5.0]),
        ("body_m", [0.01, 5.0], [0, -0.1, 5.01]),
        ("v_max_mps", [0.1, 1e4], [0, -1, 10_001]),
        ("dt_s", [0.02, 60], [0.019, 60.1, 0, -1]),
        ("tau_s", [0, 0.49], [-0.1, 0.5]),
        ("guard_s", [0, 0.24], [-0.1, 0.25]),
        ("max_slots", [0, 1_000_000], [-1, 1_000_001, 2.5]),
        ("time_scale", [0.001, 1000], [0, -1, 1e-300, 1001]),
        ("planner", ["edc", "my.module:Planner"], ["", "x" * 201, 3]),
        ("minimise", ["distance", "energy", "time"], ["money", ""]),
        ("responses", [1, 8], [0, 9, 1.5]),
        ("elect", ["energy", "response-time"], ["luck", 1]),
        ("gps_model", ["none", "bias", "white", "gauss-markov"], ["good"]),
        ("standbys", [0, 100], [-1, 101]),
        ("lease_slots", [1, 1000], [0, 1001]),
        ("resends", [0, 1000], [-1, 1001]),
        ("lag_slots", [0, 1], [-1, 2]),
        ("handover_margin", [0, 10], [-0.1]),
        ("origin_lat_deg", [-89, 89], [-89.1, 90]),
        ("origin_lon_deg", [-180, 180], [-180.1, 181]),
        ("fault", [[], ["kill head @3"]], ["kill head @3", [3], ["heal @1"] * 1001]),
        ("roster", [[]], [{"uav": "a"}, ["a"], 7]),
        ("link", [[], [{}]], [{}, [3], [{}] * 1001]),
    ],
)
def test_limits(field: str, good: list[Any], bad: list[Any]) -> None:
    """Values at a limit are taken, values beyond it are refused with the name of the field."""
    for value in good:
        assert getattr(mission_from_dict({field: value}), field) is not None
    for value in bad:
        assert refused({field: value}).field.startswith(field)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("loss", 1.1),
        ("loss", -0.1),
        ("delay_ms", -1),
        ("jitter_ms", -1),
        ("distribution", "triangular"),
        ("burst_enter", 2),
        ("burst_leave", -1),
        ("burst_loss", 1.5),
        ("duplicate", 1.5),
        ("reorder", -0.5),
        ("distribution", "pareto"),
        ("range_m", -1),
        ("path_loss_exponent", 0),
        ("shadowing_db", -1),
        ("start_s", -1),
        ("end_s", -1),
    ],
)
def test_link_limits(field: str, value: Any) -> None:
    """A link's bad field is named with its place in the list."""
    error = refused({"link": [{}, {field: value}]})
    assert (error.field, error.value) == (f"link[1].{field}", value)


@pytest.mark.parametrize(
    ("raw", "field"),
    [
        ({"speed": 3}, "speed"),
        ({"energy": {"volts": 3}}, "energy.volts"),
        ({"head": {"watts": 3}}, "head.watts"),
        ({"link": [{"los": 0.1}]}, "link[0].los"),
        ({"roster": [entry(colour="red")]}, "roster[0].colour"),
    ],
)
def test_unknown_keys(raw: dict[str, Any], field: str) -> None:
    """A key that is misspelt is never ignored."""
    assert refused(raw).field == field


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        ({"link": [{"loss": 1.5}]}, "link[0].loss = 1.5: must be a number from 0 to 1"),
        ({"link": {}}, "link = {}: must be a list of at most 1000 tables"),
        ({"uavs": "ten"}, "uavs = 'ten': must be a whole number from 1 to 10000"),
        ({"area_m2": 0}, "area_m2 = 0: must be a number above 0 and at most 1e12"),
        ({"minimise": "money"}, "minimise = 'money': must be one of distance, energy, time"),
        ({"planner": ""}, "planner = '': must be a text of 1 to 200 characters"),
        ({"fault": [3]}, "fault[0] = 3: must be a text of at most 65536 characters"),
        ({"energy": 3}, "energy = 3: must be a table"),
        ({"roster": [{"uav": "a"}]}, "roster[0] = {'uav': 'a'}: must be a table with start_x_m"),
    ],
)
def test_what_is_allowed_is_said_in_words(raw: dict[str, Any], said: str) -> None:
    """Not in the terms of a programming language."""
    assert str(refused(raw)) == said


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize(
    ("path", "wrap"),
    [
        ("area_m2", lambda v: {"area_m2": v}),
        ("handover_margin", lambda v: {"handover_margin": v}),
        ("roster[0].start_x_m", lambda v: {"roster": [entry(start_x_m=v)]}),
        ("link[0].delay_ms", lambda v: {"link": [{"delay_ms": v}]}),
        ("energy.drag_ratio", lambda v: {"energy": {"drag_ratio": v}}),
    ],
)
def test_numbers_are_finite(value: float, path: str, wrap: Any) -> None:
    """NaN and infinities are refused wherever they stand."""
    error = refused(wrap(value))
    assert (error.field, error.allowed) == (path, "a finite number")


@pytest.mark.parametrize(
    ("roster", "field"),
    [
        ([entry("a"), entry("a", start_x_m=50, target_x_m=0)], "roster[1].uav"),
        ([entry("a b")], "roster[0].uav"),
        ([entry("a\n")], "roster[0].uav"),
        ([entry("x" * 33)], "roster[0].uav"),
        ([entry("a/b")], "roster[0].uav"),
        ([entry("*")], "roster[0].uav"),
        ([entry("operator")], "roster[0].uav"),
        ([entry("ca")], "roster[0].uav"),
        ([entry("join")], "roster[0].uav"),
        ([entry(start_x_m=1.1e7)], "roster[0].start_x_m"),
        ([entry(target_y_m=-1.1e7)], "roster[0].target_y_m"),
        ([entry(r_m=-1)], "roster[0].r_m"),
        ([entry(body_m=6.0)], "roster[0].body_m"),
        ([entry(energy_j=-1)], "roster[0].energy_j"),
        ([entry(v_max_mps=-1)], "roster[0].v_max_mps"),
        ([entry(compute_factor=0)], "roster[0].compute_factor"),
        ([{"uav": "a"}], "roster[0]"),
        ([entry("a"), entry("b", start_x_m=9.9, target_x_m=0)], "roster[0].start_x_m, start_y_m"),
        ([entry("a"), entry("b", start_y_m=30, target_y_m=9.9)], "roster[0].target_x_m, target_y_m"),
    ],
)
def test_roster(roster: list[dict[str, Any]], field: str) -> None:
    """Ids are unique and well-formed, discs at starts and at targets are disjoint."""
    assert refused({"roster": roster}).field == field


def test_discs_that_touch_are_fine() -> None:
    """At exactly R apart nothing overlaps; `uavs` follows the roster."""
    mission = mission_from_dict({"roster": [entry("a"), entry("b", start_x_m=10, target_x_m=40)]})
    assert (mission.uavs, mission.quorum) == (2, 2)


@pytest.mark.parametrize(("uavs", "quorum"), [(1, 1), (2, 2), (3, 2), (4, 3), (10, 6), (11, 6)])
def test_quorum_is_more_than_half(uavs: int, quorum: int) -> None:
    """Two quorums always share a UAV."""
    roster = [entry(f"u{k}", start_x_m=20.0 * k, target_x_m=20.0 * k, target_y_m=9) for k in range(uavs)]
    assert mission_from_dict({"roster": roster}).quorum == quorum


@pytest.mark.parametrize(
    ("raw", "field"),
    [
        ({"uavs": 3, "roster": [entry()]}, "uavs"),
        ({"guard_s": 0.3}, "guard_s"),
        ({"tau_s": 2.0, "dt_s": 1.0}, "tau_s"),
        ({"body_m": 6}, "body_m"),
        ({"energy": {"initial_min_j": 2e5}}, "energy.initial_min_j"),
    ],
)
def test_fields_that_do_not_fit_together(raw: dict[str, Any], field: str) -> None:
    """Limits that depend on another field name both."""
    assert refused(raw).field == field


def test_derived_values() -> None:
    """u_max leaves the guard out at both ends; a slot shrinks with the time scale."""
    mission = mission_from_dict({"dt_s": 1.0, "guard_s": 0.1, "v_max_mps": 10.0, "time_scale": 4.0})
    assert mission.u_max_m == pytest.approx(8.0)
    assert mission.slot_ns == 250_000_000
    flown = mission_from_dict({"roster": [entry()], "tau_s": 0.1})
    assert default_tau_s(flown) == 0.1


def test_options_are_validated_as_a_whole() -> None:
    """An option replaces a field and is checked together with the rest."""
    assert with_options(Mission(), {"uavs": 4}).uavs == 4
    with pytest.raises(MissionError, match=r"^guard_s = 0\.05: must be less than half"):
        with_options(Mission(guard_s=0.05), {"dt_s": 0.1})


def test_files(tmp_path: Path) -> None:
    """A good file is read; what is missing, no TOML, no text or too large is one line about the file."""
    good = tmp_path / "good.toml"
    good.write_text('name = "a"\nuavs = 3\n[energy]\ndrag_ratio = 0.5\n[[link]]\nloss = 0.1\n')
    mission = load_mission(good)
    assert (mission.name, mission.uavs, mission.energy.drag_ratio, mission.link[0].loss) == ("a", 3, 0.5, 0.1)
    (tmp_path / "bad.toml").write_text("uavs = = 3\n")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "nan.toml").write_text("r_m = nan\n")
    (tmp_path / "json.toml").write_text('{"uavs": 3}')
    (tmp_path / "recording.toml").write_bytes(GOLDEN.read_bytes())
    with (tmp_path / "large.toml").open("wb") as file:
        file.truncate(MAX_MISSION_BYTES + 1)
    for name, allowed in (
        ("bad.toml", "valid TOML"),
        ("binary.toml", "valid TOML"),
        ("json.toml", "valid TOML .it looks like JSON"),
        ("recording.toml", "a TOML file; it is a recording"),
        ("large.toml", "at most"),
        ("missing.toml", "a readable file"),
        ("nan.toml", "a finite number"),
        (".", "a readable file"),
    ):
        with pytest.raises(MissionError, match=f"^[^\n]* = [^\n]*: must be {allowed}[^\n]*$"):
            load_mission(tmp_path / name)
