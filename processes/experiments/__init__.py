"""Execution of experiments: the ledger of runs, their measurements, real runs, the Zenoh baseline, plots and pages.

This package decides how the sweeps that `edc_swarm.experiments` declares are executed and drawn. It imports `host`,
`bus` and `runtime`. Open `ledger` first.
"""
