"""Options and fixtures of the whole test suite."""

from __future__ import annotations

import pytest
from hypothesis import settings

# Every run tries the same examples, whatever the machine's load; `--hypothesis-profile explore` looks for others.
settings.register_profile("same", derandomize=True, deadline=None, print_blob=True)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile("same")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--rewrite` writes the election transcripts and the reference of the mission file anew."""
    parser.addoption("--rewrite", action="store_true", help="write transcripts and reference anew")
