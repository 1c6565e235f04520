"""The door for notebooks: its names, its pages, and what it refuses."""

from __future__ import annotations

import doctest
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import edc_swarm as es
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.planner import Plan, PlanRequest
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.writer import RecordingWriter
from processes.cli.main import main

DOCS = Path(__file__).parents[2] / "docs"
STRAIGHT: dict[str, Any] = {"uavs": 3, "planner": "straight"}


def test_the_public_names() -> None:
    """Names that users import stay."""
    assert es.__all__ == [
        "Flight", "InputError", "Mission", "MissionError", "RecordingError", "SwarmError", "Sweep", "SweepError",
        "load", "new_mission", "simulate", "sweep",
    ]  # fmt: skip
    assert all(getattr(es, name) is not None for name in es.__all__)
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        _ = es.fly  # type: ignore[attr-defined]


def test_importing_costs_nothing() -> None:
    """A UAV process starts without numpy."""
    code = (
        "import sys, edc_swarm; print(*[name for name in sys.modules if name.startswith(('edc_swarm', 'processes'))])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["edc_swarm"]


def test_the_reference_is_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every example of docs/python.md."""
    monkeypatch.chdir(tmp_path)
    failed, tried = doctest.testfile(str(DOCS / "python.md"), module_relative=False)
    assert (failed, tried > 8) == (0, True)


def test_the_tutorial_runs() -> None:
    """In a kernel of its own, every cell, with the outputs that the page shows."""
    shown, run = (nbformat.read(DOCS / "tutorial.ipynb", as_version=4) for _ in range(2))  # type: ignore[no-untyped-call]
    NotebookClient(run, timeout=600, kernel_name="python3").execute(cwd=str(DOCS))
    for before, after in zip(shown.cells, run.cells, strict=True):
        assert _texts(before) == _texts(after), before.source


def _texts(cell: nbformat.NotebookNode) -> list[str]:
    outputs = [each for each in cell.get("outputs", []) if each.output_type == "execute_result"]
    return [each.data.get("text/plain", "") for each in outputs]


def test_a_flight_is_what_sim_flies(tmp_path: Path) -> None:
    """The same options give the same messages."""
    out = tmp_path / "a.mcap"
    main(
        [
            "sim",
            "--uavs",
            "3",
            "--planner",
            "straight",
            "--loss",
            "0.2",
            "--fault",
            "kill u002 @5",
            "--out",
            str(out),
            "--quiet",
        ]
    )
    flight = es.simulate(**STRAIGHT, loss=0.2, fault=["kill u002 @5"])
    assert flight.recording.lists() == read_recording(out).lists()
    assert flight.metrics.not_living == ["u002"]


def test_absent_evidence_is_unknown(tmp_path: Path) -> None:
    """A recording whose messages are gone: no number stands for what is not there."""
    said = es.simulate(**STRAIGHT).recording.mission
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = RecordingWriter(stream, {"clock": "virtual"})
        writer.write(Keys(said.name).mission, encode(said), said.sent_ns)
        writer.finish({"messages": "520"})
    flight = es.load(tmp_path / "a.mcap")
    assert not any(each.held for each in flight.verdicts)
    assert flight.metrics.makespan_s is None
    assert "- arrived" in repr(flight)


class Tiring:
    """A planner that raises."""

    def __init__(self, mission: object, stopwatch: object) -> None:
        pass

    def plan(self, request: PlanRequest) -> Plan:
        """Fly straight on, and fail after slot 4."""
        if request.slot > 4:
            raise LookupError("no more ideas")
        return Plan([(x, y) for x, y in np.asarray(request.target_m).tolist()], "planned")


def test_a_planner_that_fails_is_told() -> None:
    """Nothing else in a notebook says why nobody arrives."""
    said = repr(es.simulate(uavs=3, max_slots=9, planner=Tiring))
    assert "; 5 plans failed, and all held; first in slot 4: LookupError: no more ideas" in said


def test_a_class_of_the_notebook_flies_in_the_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    """No worker can import it, so there is none; who asks for some is told."""
    main_module = sys.modules["__main__"]
    monkeypatch.delattr(main_module, "__file__", raising=False)
    monkeypatch.setattr(Tiring, "__module__", "__main__")
    monkeypatch.setattr(main_module, "Tiring", Tiring, raising=False)
    options: dict[str, Any] = {"uavs": 2, "max_slots": 4, "planner": [Tiring, "straight"], "seeds": 1}
    assert [row["planner"] for row in es.sweep(**options).rows] == ["__main__:Tiring", "straight"]
    elsewhere: list[dict[str, Any]] = [{"jobs": 2}, {"scheduler": "tcp://127.0.0.1:1"}]
    for workers in elsewhere:
        with pytest.raises(es.InputError, match="for a class of the notebook") as refused:
            es.sweep(**options, **workers)
        assert refused.value.field in workers


def test_guarantees_that_do_not_apply_are_not_named_among_those_that_do_not_hold() -> None:
    """Without a head half of them do not apply."""
    said = repr(es.simulate(uavs=2, control="local", planner="bvc", fence="none"))
    assert said == "<Flight of 2 UAVs, planner bvc: 2 arrived; every guarantee that applies held>"


def test_an_unknown_metric_is_in_no_mean() -> None:
    """A mission that never completes has no makespan."""
    sweep = es.sweep(**STRAIGHT, max_slots=[5, 200], seeds=2, jobs=1)
    short, whole = sweep.summary("makespan_s").to_dict("records")
    assert (short["runs"], short["unknown"], math.isnan(short["mean"])) == (0, 2, True)
    assert (whole["runs"], whole["unknown"]) == (2, 0)


def test_the_axes_of_a_picture_have_units() -> None:
    """Of an option that is named without its unit too; nobody flies half a UAV."""
    rows = [
        {"uavs": uavs, "gps_error": r_m, "seed": 0, "makespan_s": 20.0, "completed": True}
        for uavs in (10, 20)
        for r_m in (1, 5)
    ]
    sweep = es.Sweep({"uavs": [10, 20], "gps_error": [1, 5]}, rows)
    ax = sweep.plot("makespan_s")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("UAVs", "makespan [s]")
    assert all(float(tick).is_integer() for tick in ax.get_xticks())
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["gps error 1 m", "gps error 5 m"]
    assert sweep.plot("completed", x="gps_error").get_xlabel() == "gps error [m]"


def test_a_sweep_resumes_and_takes_any_mission(tmp_path: Path) -> None:
    """Fields that no option sets go to a file, which the ledger names."""
    options: dict[str, Any] = {**STRAIGHT, "fault": [[], ["kill u001 @3"]], "seeds": 1, "jobs": 1, "tau_s": 0.1}
    first = es.sweep(folder=tmp_path / "a", **options)
    lines = (tmp_path / "a" / "runs.jsonl").read_text(encoding="utf-8")
    assert es.sweep(folder=tmp_path / "a", **options).rows == first.rows
    assert (tmp_path / "a" / "runs.jsonl").read_text(encoding="utf-8") == lines
    (file, *_) = (tmp_path / "a" / "missions").iterdir()
    assert es.new_mission(file).tau_s == 0.1
    assert [row["completed"] for row in first.rows] == [True, False]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"uavs": 0}, "uavs = 0: must be"),
        ({"loss": 2}, "loss = 2: must be a number from 0 to 1"),
        ({"vehicle": "brick"}, "vehicle = 'brick'"),
        ({"planner": "nowhere:Nothing"}, "planner = 'nowhere:Nothing'"),
        ({"fault": "kill head @10"}, "fault = 'kill head @10': must be a list of texts"),
        ({"fault": 3}, "fault = 3: must be a list of texts"),
        ({"area": 100, "area_m2": 200}, "area = 100: must be left out beside area_m2"),
    ],
)
def test_bad_options(options: dict[str, Any], text: str) -> None:
    """In one line, with the name that the user wrote."""
    with pytest.raises(es.InputError) as refused:
        es.simulate(**options)
    assert str(refused.value).startswith(text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("path", [5, None, b"flown.mcap", "a\0b", ["flown.mcap"]])
def test_a_recording_is_a_path(path: Any) -> None:
    """What is no path is refused in one line."""
    with pytest.raises(es.InputError, match=r"^path = .*: must be the path of a recording$"):
        es.load(path)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"seeds": 0}, "seeds"),
        ({"seeds": 10**12}, "seeds"),  # No list of all of them is made first.
        ({"seeds": 1.5}, "seeds"),
        ({"seeds": [1.5]}, "seeds"),
        ({"seeds": "12"}, "seeds"),
        ({"seeds": True}, "seeds"),
        ({"seeds": [1, 2, 1]}, "seeds"),
        ({"seeds": 1, "seed": [7, 8]}, "seed"),
        ({"seeds": 1, "loss": []}, "loss"),
        ({"seeds": 1, "loss": [0.1, 0.2, 0.1]}, "loss"),
        ({"seeds": 1, "loss": range(10**12)}, "loss"),
        ({"seeds": 1, "uavs": range(1, 1001), "loss": range(1000), "jitter_ms": range(1000)}, "seeds"),
        ({"seeds": 1, "uavs": [2, 0]}, "uavs"),
        ({"seeds": 1, "jobs": 1.5}, "--jobs"),
    ],
)
def test_what_a_sweep_refuses(options: dict[str, Any], field: str) -> None:
    """Before any mission flies."""
    with pytest.raises(es.InputError) as refused:
        es.sweep(**options)
    assert refused.value.field == field


def test_numbers_of_numpy_are_numbers() -> None:
    """Arrays are axes, so their elements are values."""
    assert es.new_mission(uavs=np.int64(3), loss=np.float64(0.1)) == es.new_mission(uavs=3, loss=0.1)
    swept = es.sweep(**STRAIGHT, max_slots=np.array([5]), seeds=np.int64(1), jobs=1)
    assert [row["seed"] for row in swept.rows] == [0]


class Late:
    """A link that takes 100 ms."""

    def __init__(self, *_: object) -> None: ...

    def delay_ms(self, _: object) -> float:
        """Return the delay of any message."""
        return 100.0


def test_a_link_model_may_be_a_class() -> None:
    """As a planner may: in the table of its link, alone or as one of several to compare."""
    links: list[list[dict[str, Any]]] = [[], [{"model": Late}]]
    at_once, late = (es.simulate(**STRAIGHT, link=link).metrics.fix_to_command_ms.p50 for link in links)
    assert at_once is not None
    assert late is not None
    assert late - at_once == pytest.approx(100.0, abs=1.0)
    axis = es.sweep(**STRAIGHT, link=links, seeds=1, jobs=1)
    assert repr(axis) == "<Sweep of 2 missions: link (2 values)>"


@pytest.mark.parametrize(
    ("field", "options"),
    [("planner", {"planner": Late()}), ("elect", {"elect": Late()}), ("link.model", {"link": [{"model": Late()}]})],
)
def test_an_object_in_place_of_its_class_is_refused_as_such(field: str, options: dict[str, Any]) -> None:
    """Each process makes its own object, so a mission states the class."""
    with pytest.raises(es.MissionError, match=r"not an object of the class$") as refused:
        es.new_mission(uavs=3, **options)
    assert refused.value.field == field


def test_a_source_is_a_mission_or_a_path() -> None:
    """A table of options is neither."""
    with pytest.raises(es.MissionError, match="source"):
        es.simulate({"uavs": 3})  # type: ignore[arg-type]


def test_saving_overwrites_only_when_told(tmp_path: Path) -> None:
    """And takes the plan times along."""
    flight = es.simulate(**STRAIGHT)
    path = flight.save(tmp_path / "a.mcap")
    with pytest.raises(es.InputError):
        flight.save(path)
    flight.save(path, force=True)
    again = es.load(path)
    assert again.metrics == compute_metrics(flight.recording, flight.timings)
    assert again.timings


def test_the_animation_is_one_frame() -> None:
    """The page is inside an attribute: none of it reaches the notebook's own document."""
    text = es.simulate(**STRAIGHT).animate()._repr_html_()
    assert text.startswith('<iframe sandbox="allow-scripts"')
    assert text.count("<") == 2
