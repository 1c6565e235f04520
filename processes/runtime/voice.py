"""The amount that a command says while it works: a bar on a terminal, elsewhere the running story."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from edc_swarm.errors import InputError


@dataclass(frozen=True, slots=True)
class Voice:
    """The words on standard error besides notes and errors.

    Without a terminal the story is told, line by line; on one a bar shows the state. `verbose` tells the story on a
    terminal too, with all details. `quiet` says nothing.
    """

    quiet: bool = False
    verbose: bool = False

    def __post_init__(self) -> None:
        """Check that not both are asked for."""
        if self.quiet and self.verbose:
            raise InputError("--quiet", True, "absent where --verbose is given")

    @property
    def shows_bar(self) -> bool:
        """True for a bar."""
        return not self.quiet and sys.stderr.isatty()

    @property
    def tells_story(self) -> bool:
        """True for the running story."""
        return self.verbose or not (self.quiet or sys.stderr.isatty())
