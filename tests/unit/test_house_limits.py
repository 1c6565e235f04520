"""Test of the limits of this house: a module has at most 400 lines, a class at most 20 methods."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MAX_LINES = 400
MAX_METHODS = 20
LONG_MODULES = {
    "edc_swarm/planner/guidance_kernel.py": 1400,  # A kernel: compiled as one module.
}
"""Modules that are longer today, and the lines that each may have: none may grow."""
LARGE_CLASSES = {
    "Foreign": 21,
    "Knowledge": 25,
    "Operator": 21,
    "Pilot": 23,
    "Scenery": 27,
    "VehicleView": 21,
}
"""Classes that have more methods and properties today, and how many each may have: none may grow."""


def excesses(name: str, text: str) -> list[str]:
    """Return each limit that module `name` of source `text` breaks."""
    lines = len(text.splitlines())
    found = [f"{name}: {lines} lines"] if lines > LONG_MODULES.get(name, MAX_LINES) else []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef):
            methods = sum(isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef) for part in node.body)
            if methods > LARGE_CLASSES.get(node.name, MAX_METHODS):
                found.append(f"{name}: class {node.name} has {methods} methods")
    return found


def sources() -> dict[str, str]:
    """Return the text of each module, by its path in the repository."""
    paths = [path for folder in ("edc_swarm", "processes", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def test_no_module_and_no_class_is_too_large() -> None:
    """No module and no class is larger than it may be."""
    modules = sources()
    assert modules.keys() >= LONG_MODULES.keys()
    assert [line for name, text in sorted(modules.items()) for line in excesses(name, text)] == []


def test_every_exception_is_still_needed() -> None:
    """An exception that is no longer needed is found."""
    modules = sources()
    assert [name for name in LONG_MODULES if len(modules[name].splitlines()) <= MAX_LINES] == []
    large = {
        node.name
        for text in modules.values()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ClassDef)
        and sum(isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef) for part in node.body) > MAX_METHODS
    }
    assert large == LARGE_CLASSES.keys()


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("x = 1\n" * 401, ["new.py: 401 lines"]),
        ("x = 1\n" * 400, []),
        ("class A:\n" + "".join(f"    def f{i}(self): ...\n" for i in range(21)), ["new.py: class A has 21 methods"]),
        ("class A:\n" + "".join(f"    def f{i}(self): ...\n" for i in range(20)), []),
    ],
)
def test_what_is_too_large_is_named(text: str, found: list[str]) -> None:
    """One line or one method too many is found."""
    assert excesses("new.py", text) == found
