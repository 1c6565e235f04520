"""The names that users import from packages: they exist, are the ones of their modules, and cost nothing until used."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest

PACKAGES = ("edc_swarm", "edc_swarm.planner", "edc_swarm.recording")


def test_planner_of_a_user_imports_what_the_docs_promise() -> None:
    """The lines of docs/planner.md and of planners that were written for earlier versions."""
    from edc_swarm.planner import Plan, PlanRequest, SafeSteps, airspace_of, make_planner  # noqa: PLC0415
    from edc_swarm.planner.interface import Plan as PlanOfModule  # noqa: PLC0415

    assert Plan is PlanOfModule
    assert [name.__name__ for name in (PlanRequest, SafeSteps, airspace_of, make_planner)] == [
        "PlanRequest",
        "SafeSteps",
        "airspace_of",
        "make_planner",
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there(package: str) -> None:
    """`from package import *` takes every name of `__all__`."""
    module = import_module(package)
    assert all(getattr(module, name) is not None for name in module.__all__)


@pytest.mark.parametrize("package", PACKAGES)
def test_other_names_are_not(package: str) -> None:
    """A wrong name is an error that says so, and submodules are still imported by `from package import module`."""
    with pytest.raises(AttributeError, match=f"'{package}' has no attribute 'Nothing'"):
        _ = import_module(package).Nothing


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_the_package_imports_no_module_of_it(package: str) -> None:
    """A process pays for a name when it uses it: a UAV that plans nothing starts without numpy."""
    code = f"import sys, {package}; print(*[name for name in sys.modules if name.startswith('edc_swarm')])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == list(dict.fromkeys(["edc_swarm", package]))


def test_a_package_is_imported_without_the_public_names() -> None:
    """`from edc_swarm import mission` asks for an attribute first, which must not import what notebooks need."""
    code = "import sys; from edc_swarm import mission; print({'processes', 'numpy'} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "set()"


def test_notebooks_complete_the_public_names() -> None:
    """`dir(edc_swarm)` has the names of the door, and `from edc_swarm import *` takes them."""
    import edc_swarm  # noqa: PLC0415
    from processes.notebook import api  # noqa: PLC0415

    assert set(api.__all__) <= set(dir(edc_swarm))
    taken: dict[str, object] = {}
    exec("from edc_swarm import *", taken)
    assert set(api.__all__) == set(taken) - {"__builtins__"}
