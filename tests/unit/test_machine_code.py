"""The library with the guidance's machine code: it plans as numba's code does, to the byte."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.zone import Zone
from edc_swarm.planner import guidance_kernel, machine_code, room_kernel, roundabout_kernel
from edc_swarm.planner.machine_code import functions_of_library
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import mission_message
from edc_swarm.simulation.closed_loop import closed_loop


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library, made as for a wheel: a good half minute of processor time."""
    if shutil.which("ld") is None:
        pytest.skip("no linker (apt install binutils)")
    folder = tmp_path_factory.mktemp("library")
    subprocess.run([sys.executable, "-m", "processes.uav.compile_ahead", "--library", str(folder)], check=True)
    return machine_code.library_path(folder)


@pytest.mark.long
def test_the_library_plans_as_numbas_code_does(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every function is replaced; a dense mission with a zone to fly round, equal to the last bit."""
    zone = Zone(name="tower", kind="exclusion", polygon=[(45.0, 45.0), (55.0, 45.0), (55.0, 55.0), (45.0, 55.0)])
    mission = mission_message(complete_mission(Mission(uavs=12, seed=7, zone=[zone])))
    path_m, _ = closed_loop(mission, make_planner("edc", mission))
    called = set()

    def noted(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            called.add(name)
            return function(*args)

        return call

    functions = functions_of_library(library)
    for name, function in functions.items():
        (module,) = [module for module in (guidance_kernel, room_kernel, roundabout_kernel) if name in vars(module)]
        monkeypatch.setattr(module, name, noted(name, function))
    by_library_m, _ = closed_loop(mission, make_planner("edc", mission))
    assert by_library_m.tobytes() == path_m.tobytes()
    assert called >= {"sweep", "populate", "urgencies", "uniform", "clear_ways", "open_leg", "next_node"}


@pytest.mark.long
def test_a_library_of_other_sources_is_not_used(library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A developer who changes the guidance flies the change; without a library numba compiles."""
    assert functions_of_library(library)
    monkeypatch.setattr(machine_code, "SOURCES", ("guidance_kernel.py",))
    assert functions_of_library(library) == {}
    assert functions_of_library(tmp_path / "none.so") == {}


@pytest.mark.parametrize("text", ["", 'const char edc_label[] = "{";', 'const char edc_label[] = "{\\"sources\\":1}";'])
def test_a_library_that_is_none_of_ours_is_not_used(tmp_path: Path, text: str) -> None:
    """One without a label, or with one that cannot be read: numba compiles, as if no library were there."""
    if shutil.which("cc") is None:
        pytest.skip("no compiler")
    (tmp_path / "other.c").write_text(text)
    subprocess.run(["cc", "-shared", "-o", tmp_path / "other.so", tmp_path / "other.c"], check=True)
    assert functions_of_library(tmp_path / "other.so") == {}


@pytest.mark.parametrize(
    "value", [np.zeros((2, 3), np.float32), np.zeros(3), np.zeros((4, 4))[::2], np.zeros((2, 3), order="F"), 1.0]
)
def test_other_arrays_than_the_rehearsals_are_refused(value: Any) -> None:
    """Another item, number of dimensions or order in memory is never read as what it is not."""
    unfold = machine_code._unfolder({"item": "float64", "dimensions": 2})
    passed: list[Any] = []
    with pytest.raises((AssertionError, AttributeError)):
        unfold(value, passed)
    assert passed == []
    fitting = np.ones((2, 3))
    unfold(fitting, passed)
    assert passed == [None, None, 6, 8, fitting.ctypes.data, 2, 3, 24, 8]


def test_a_number_of_another_type_is_refused() -> None:
    """A fraction is no index."""
    with pytest.raises(TypeError):
        machine_code._unfolder("int64")(1.5, [])
