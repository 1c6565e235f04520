"""Analysis of a recording: tracks, separation, metrics, outcome, energy bills, data frames, replanning, guarantees.

This package decides what a recording says about its run. It reads recordings alone: it runs no agent and no
simulation. It imports `recording`, `protocol`, `planner`, `emulation`, `mission`, `geometry`, `files` and
`foreign_text`. Open `metrics` first, or `guarantees.check` for the verdicts.
"""
