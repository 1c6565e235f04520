"""Experiments carried out: the ledger of runs, what is measured of each, real runs, the Zenoh baseline, plots, pages.

This package decides how the sweeps that `edc_swarm.experiments` declares are flown and drawn. It imports `host`, `bus`
and `runtime`. Open `ledger` first.
"""
