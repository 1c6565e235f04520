"""Options and fixtures of the whole test suite."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--rewrite` writes the election transcripts anew instead of comparing them."""
    parser.addoption("--rewrite", action="store_true", help="rewrite the transcripts under tests/scenarios")
