"""Recordings: MCAP files with every message of a run, byte for byte.

This package decides how a run is written and read back; `reader.read_recording` returns a `model.Recording`. It
imports `protocol`, `mission` and `errors`. It does not import numpy, because the processes of the recorder and of
the UAVs start without numpy. Open `model` first.
"""
