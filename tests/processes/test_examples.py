"""Tests of the examples."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

NOTEBOOK = Path(__file__).parents[2] / "examples" / "energy_notebook.py"


def test_energy_notebook(tmp_path: Path) -> None:
    """The notebook runs as a script, prints its results and draws a picture."""
    picture = tmp_path / "energy.png"
    said = subprocess.run(
        [sys.executable, str(NOTEBOOK), str(picture)],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "Agg"},
    )
    assert "above the straight lines" in said.stdout
    assert "u001: cruise" in said.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
