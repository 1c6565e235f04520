"""The memory of the fork source, packed before it forks, so that its UAVs share more of it.

Forked processes share a page of memory until one of them writes to it and gets a copy. Old memory is full of small
holes; what a child allocates falls into them and copies a page each time. `pack_memory` fills the holes with what
nobody frees, so that children allocate in a row, on few pages.
"""

from __future__ import annotations

import ctypes
import sys

MOST_BYTES = 512
"""Largest object in Python's own memory; the C library has the rest, and all of Zenoh's."""
STEP_BYTES = 16
SMALL, OTHERS, OF_C = 5000, 300, 80
"""Holes that are filled, of each size: up to 32 bytes and more in Python's memory, and any in that of C. More gained
nothing."""
MOST_C_BYTES = 1024
_fillers: list[object] = []
"""What fills them in Python's memory."""


def pack_memory() -> None:
    """Give free memory back, and fill the holes in what is left.

    Python remembers which attribute of a type it found under which name. A child that replaces such an entry writes to
    the page of the old name, so those of the warm-up go.
    """
    clear = getattr(sys, "_clear_internal_caches", None) or sys._clear_type_cache  # The former since Python 3.13.
    clear()
    system = ctypes.CDLL(None)
    if hasattr(system, "malloc_trim"):  # Only the GNU C library has it.
        system.malloc_trim(0)
    for size in range(STEP_BYTES, MOST_C_BYTES + 1, STEP_BYTES):
        for _ in range(OF_C):
            system.malloc(size - 8)  # The library adds 8 bytes to each.
    _fillers.extend(object() for _ in range(SMALL))
    _fillers.extend(map(float, range(SMALL)))
    for size in range(3 * STEP_BYTES, MOST_BYTES + 1, STEP_BYTES):
        _fillers.extend(bytes(size - sys.getsizeof(b"")) for _ in range(OTHERS))
