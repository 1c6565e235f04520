"""Recordings: MCAP files that hold every message of a run, verbatim.

This package decides how a run is written and read back; `reader.read_recording` returns a `model.Recording`. It
imports `protocol`, `mission`, `files` and `errors`, and no numpy, since the recorder and the UAV start without it. Open
`model` first.
"""
