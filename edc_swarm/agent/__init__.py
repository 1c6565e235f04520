"""One UAV as a value: node, election, cluster head, knowledge of the others, vehicle.

This package decides what a UAV does with each event; the simulator and the real process feed it. It imports
`protocol`, `planner`, `emulation`, `mission` and `geodesy`. Open `node` first; `vehicle.refusal` decides
whether a command is flown.
"""
