"""Imports point one way, and the library does no I/O: the linter's contracts, checked with the tests."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_import_contracts_are_kept() -> None:
    """What `make check` runs too."""
    tool = Path(sys.executable).with_name("lint-imports")
    said = subprocess.run([tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr


def test_a_uav_imports_no_numpy() -> None:
    """Nor anything else that only planning needs."""
    heavy = "{'numpy', 'scipy', 'osqp', 'numba', 'rich', 'cyclopts'} & set(sys.modules)"
    code = f"import sys, processes.uav.process; print(sorted({heavy}))"
    said = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


def test_nothing_flown_is_reckoned_with_what_differs_between_processors() -> None:
    """numpy's sines, arcs and powers may, in the last bit: `geometry.by_libm` instead."""
    library = ROOT / "edc_swarm"
    reckoning = [library / "geometry.py", *library.glob("planner/*.py"), *library.glob("solver/*.py")]
    assert len(reckoning) > 10
    differs = re.compile(r"np\.(sin|cos|tan|exp|log|arc|power|cbrt)")
    assert [path.name for path in reckoning if differs.search(path.read_text())] == []


def test_one_name_is_one_number() -> None:
    """A constant of a module that has the name of another's has its value: different limits have different names."""
    values = defaultdict(set)
    for path in (*ROOT.glob("edc_swarm/**/*.py"), *ROOT.glob("processes/**/*.py")):
        for node in ast.parse(path.read_text()).body:
            match node:
                case ast.Assign([ast.Name(name)], ast.Constant(int() | float() as value)) if name.isupper():
                    values[name].add(value)
    assert len(values) > 100
    assert {name: found for name, found in values.items() if len(found) > 1} == {}
