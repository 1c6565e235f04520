"""Compilation of the planner as part of an installation: `python -m processes.uav.compile_ahead [--library FOLDER]`.

Without it the first flight does so. Code is kept for the processor of this machine. With `--library` it becomes a
library in the folder, for any processor of this kind: in the folder of `edc_swarm.planner`, numba is needed no more.
The linker is `ld`, of the package binutils.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from argparse import ArgumentParser
from pathlib import Path

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.zone import Zone
from processes.runtime.compiling import CompilingNote
from processes.runtime.voice import Voice
from processes.uav.planner_loader import warm_planner

ANY_ZONE = Zone(name="fence", kind="inclusion", polygon=[(-1.0, -1.0), (101.0, -1.0), (101.0, 101.0), (-1.0, 101.0)])
"""Any zone: missions with zones need more code than others."""


def main(arguments: list[str]) -> int:
    """Compile all that any mission needs, or load it if it is compiled."""
    parser = ArgumentParser("python -m processes.uav.compile_ahead", description="Compile the planner.")
    parser.add_argument("--library", type=Path, metavar="FOLDER", help="make a library in this folder")
    folder: Path | None = parser.parse_args(arguments).library
    if folder is not None:
        return _make_library(folder)
    compiling = CompilingNote(Voice())
    warm_planner(Mission(zone=[ANY_ZONE]), compiling.tell, helped=True)
    compiling.end()
    return 0


def _make_library(folder: Path) -> int:
    if shutil.which("ld") is None or not folder.is_dir():
        print(
            f"error: --library = {str(folder)!r}: must be a folder, and needs `ld` (apt install binutils)",
            file=sys.stderr,
        )
        return 2
    from edc_swarm.planner.ahead_of_time import SYMBOLS, object_code  # noqa: PLC0415  (imports numba)
    from edc_swarm.planner.machine_code import library_path  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as scratch:
        compiled, symbols = Path(scratch) / "kernels.o", Path(scratch) / "symbols"
        compiled.write_bytes(object_code(Mission(zone=[ANY_ZONE])))
        symbols.write_text(SYMBOLS)
        made = library_path(folder)
        subprocess.run(["ld", "-shared", "-s", f"--version-script={symbols}", "-o", made, compiled], check=True)
    print(made)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
