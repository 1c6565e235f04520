"""The simulator: a whole swarm in one process, in virtual time, over an emulated network.

This package decides in which order things happen in virtual time. It imports everything that flies (`agent`,
`planner`, `protocol`, `emulation`, `mission`) and `recording`; it judges nothing. Open `simulator` first.
"""
