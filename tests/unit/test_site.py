"""The documentation site: it builds without a warning, and every page of the documentation is in it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def _build(top: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-c", str(top / "docs")]
    return subprocess.run([*command, str(top), str(out)], capture_output=True, text=True, check=False)


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    """A link that leads nowhere, or a page that no list of contents names, is one."""
    built = _build(ROOT, tmp_path)
    assert (built.returncode, built.stderr) == (0, "")
    for page in [*(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "ARCHITECTURE.md"]:
        assert (tmp_path / page.relative_to(ROOT).with_suffix(".html")).is_file()


def test_links_that_lead_nowhere_are_found(tmp_path: Path) -> None:
    """A page that is not there, and a heading; with the project's settings."""
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "conf.py").write_text((ROOT / "docs" / "conf.py").read_text(encoding="utf-8"), encoding="utf-8")
    (docs / "contents.md").write_text("# Contents\n\n```{toctree}\nindex\n```\n", encoding="utf-8")
    (docs / "index.md").write_text("# Index\n\n[a](gone.md)\n[b](index.md#lost)\n", encoding="utf-8")
    built = _build(tmp_path, tmp_path / "site")
    assert built.returncode == 1
    assert "gone.md" in built.stderr
    assert "lost" in built.stderr
