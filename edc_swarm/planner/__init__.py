"""Planners behind one small interface.

This package decides the next waypoint of each UAV. It imports `solver`, `emulation.energy`, `mission`,
`geometry` and `errors`; it never sees a message. Open `interface` first; a planner of your own implements
`interface.Planner`.

>>> from edc_swarm.planner.registry import make_planner
"""
