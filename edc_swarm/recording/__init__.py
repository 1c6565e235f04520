"""Recordings: MCAP files with every message of a run, byte for byte.

This package decides how a run is written and read back; `reader.read_recording` returns a `model.Recording`. It
imports `protocol`, `mission`, `files` and `errors`, and no numpy, since the recorder and the UAV start without it. Open
`model` first.

The names of `__all__` are for programs that read recordings (docs/metrics.md). Each is imported when it is first used,
so that importing this package imports no other module.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from edc_swarm.recording.model import Recording
    from edc_swarm.recording.reader import read_recording, recover
else:

    def __getattr__(name: str) -> object:
        """Return a public name from its module."""
        from importlib import import_module  # noqa: PLC0415  (only where a name is used)

        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{'model' if name == 'Recording' else 'reader'}"), name)


__all__ = ["Recording", "read_recording", "recover"]
