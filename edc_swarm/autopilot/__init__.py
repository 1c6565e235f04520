"""An autopilot as the body of a UAV: MAVLink messages in and out, as values.

This package says what an autopilot is told and what its messages mean; it opens no socket, reads no clock and knows no
library of MAVLink. Open `pilot` first (arming, take-off, watch, landing), then `telemetry` and `body`.
"""
