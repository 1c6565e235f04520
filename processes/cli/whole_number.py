"""Whole numbers on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from cyclopts import Parameter, Token


def _whole(kind: object, tokens: Sequence[Token]) -> int:
    """Convert a text to a whole number without rounding: 10.5 UAVs are a mistake."""
    del kind
    return int(tokens[0].value)


WholeNumber = Annotated[int, Parameter(converter=_whole)]
