"""Parts of the user: the examples fly, wrong parts are refused in one line, names and hashes are recorded."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.own_metrics import own_metrics
from edc_swarm.errors import InputError, MissionError
from edc_swarm.experiments.resimulation import check_same_bytes
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.recording.reader import read_recording
from edc_swarm.simulation.plug_in_trial import try_plug_ins
from processes.experiments.measures import simulate
from processes.runtime.run_facts import plug_in_facts, source_hash

EXAMPLES = Path(__file__).parents[2] / "examples"
BROKEN = """
class Raises:
    def __init__(self, *_): raise ValueError("no")
class Late:
    def __init__(self, *_): pass
    def value(self, fix): return 1 / 0
    def next_error_m(self): return 1 / 0
    def delay_ms(self, message): return 1 / 0
    def measure(self, recording): return 1 / 0
class Odd:
    def __init__(self, *_): pass
    def value(self, fix): return "best"
    def next_error_m(self): return (float("nan"), 0.0)
    def delay_ms(self, message): return float("inf")
    def measure(self, recording): return object()
class Bare:
    def __init__(self, *_): pass
"""


@pytest.fixture(autouse=True)
def _examples(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "broken_parts.py").write_text(BROKEN)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.parametrize(
    "fields",
    [
        {"elect": "own_criterion:Central"},
        {"gps_model": "own_gps:Circling"},
        {"link": [{"model": "own_link:Handovers", "delay_ms": 20.0}]},
    ],
)
def test_the_examples_fly_and_fly_again(fields: dict[str, Any]) -> None:
    """All are home, no guarantee is broken, and the same mission gives the same bytes."""
    mission = mission_from_dict({"uavs": 5, **fields})
    try_plug_ins(complete_mission(mission))
    recording, _ = simulate(mission)
    assert compute_metrics(recording).completed
    assert [result.guarantee for result in check(recording) if result.broken] == []
    recording.run["clock"] = "virtual"
    assert "load-planner" in str(check_same_bytes(recording))
    again = check_same_bytes(recording, load_planner=True)
    assert again.judged
    assert not again.broken


def test_the_parts_do_what_their_examples_say() -> None:
    """The head is central, errors circle at 80 % of the largest, and messages wait in handovers alone."""
    central, _ = simulate(Mission(uavs=9, elect="own_criterion:Central"))
    usual, _ = simulate(Mission(uavs=9))
    assert compute_metrics(central).heads[0].head != compute_metrics(usual).heads[0].head
    circling, _ = simulate(Mission(uavs=3, gps_model="own_gps:Circling"))
    truths = {(truth.uav, truth.slot): truth for truth in circling.truths}
    errors_m = [
        math.dist((fix.x_m, fix.y_m), (truths[key].from_x_m, truths[key].from_y_m))
        for fix in circling.fixes
        if (key := (fix.uav, fix.slot)) in truths
    ]
    assert max(abs(error_m - 0.8 * 4.75) for error_m in errors_m) < 1e-6


@pytest.mark.parametrize("name", ["Raises", "Late", "Odd", "Bare", "Absent"])
@pytest.mark.parametrize("field", ["elect", "gps_model", "link"])
def test_wrong_parts_are_refused_in_one_line(field: str, name: str) -> None:
    """The line names the field, the class, and what went wrong where."""
    part = f"broken_parts:{name}"
    fields: dict[str, Any] = {"link": [Link(model=part)]} if field == "link" else {field: part}
    with pytest.raises(MissionError) as caught:
        try_plug_ins(complete_mission(Mission(uavs=3, **fields)))
    line = str(caught.value)
    assert line.startswith("link[0].model" if field == "link" else field)
    assert part in line
    assert "\n" not in line
    assert name not in {"Raises", "Late"} or "broken_parts.py, line" in line


def test_a_module_that_is_not_there_is_told_without_a_line_of_python_itself() -> None:
    """Nobody mends importlib."""
    with pytest.raises(MissionError, match=r"\(ModuleNotFoundError: No module named 'no_such_part'\)$"):
        try_plug_ins(complete_mission(Mission(uavs=3, elect="no_such_part:Class")))


@pytest.mark.parametrize("text", ["luck", "module", ":Class", "a b:C", "a:b:c", "a.b:"])
def test_names_that_are_none_are_refused_without_an_import(text: str) -> None:
    """Neither built in nor package.module:Class."""
    for fields in ({"elect": text}, {"gps_model": text}, {"link": [{"model": text}]}):
        with pytest.raises(MissionError, match=r"package\.module:Class"):
            mission_from_dict(fields)


def test_own_metrics() -> None:
    """A metric measures the recording; a wrong one is refused in one line."""
    recording, _ = simulate(Mission(uavs=3))
    (found,) = own_metrics(recording, ["own_metric:Obedience"]).values()
    assert isinstance(found, dict)
    assert found["obedience_pct"] == pytest.approx(100.0, abs=1.0)
    for name in ("Raises", "Late", "Odd", "Bare", "Absent"):
        with pytest.raises(InputError, match="--metric"):
            own_metrics(recording, [f"broken_parts:{name}"])
    with pytest.raises(InputError, match=r"must be package\.module:Class"):
        own_metrics(recording, ["obedience"])


def test_names_and_hashes_are_recorded(tmp_path: Path) -> None:
    """The mission has the name, the run the hash of the file, and metrics have both."""
    out = tmp_path / "flight.mcap"
    options = ["--uavs", "3", "--elect", "own_criterion:Central", "--out", str(out), "--no-viz", "--json"]
    edc_swarm("sim", *options)
    recording = read_recording(out)
    assert recording.mission.elect == "own_criterion:Central"
    assert recording.run["plug-in own_criterion:Central"] == source_hash("own_criterion:Central") != ""
    told = edc_swarm("metrics", str(out), "--json", "--metric", "own_metric:Obedience")
    own = json.loads(told)["own"]["own_metric:Obedience"]
    assert own["sha256"] == source_hash("own_metric:Obedience")
    assert set(own["value"]) == {"obedience_pct"}
    assert plug_in_facts(Mission()) == {}


def edc_swarm(*words: str) -> str:
    """Return what a command prints in the folder of the examples; how its mission ends does not matter."""
    command = [sys.executable, "-m", "processes.cli.main", *words]
    ended = subprocess.run(command, cwd=EXAMPLES, capture_output=True, text=True, check=False, timeout=200)
    assert ended.returncode in {0, 1}, ended.stderr
    return ended.stdout
