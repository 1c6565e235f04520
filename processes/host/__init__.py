"""One host of a mission: launcher and joiner, the pool of UAV processes, certificates.

This package decides which processes run on this machine and how they end. It imports `operator`, `services`, `uav`,
`bus` and `runtime`, and never the simulator. Open `launcher` first: it combines `start` and `parts` (start), `watch`
(flight), `ending` (end, shared with `joiner`) and `run_report`.
"""
