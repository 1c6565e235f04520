"""The swarm as a ground station sees it: each UAV as a MAVLink system.

This package says which MAVLink messages a mission's messages amount to; it opens no socket and knows no library of
MAVLink. Open `view` first, then `vehicle` (telemetry) and `mission_items` (routes and zones).
"""
