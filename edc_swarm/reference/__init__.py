"""The reference that the paper skipped: eq. 13-21 over the whole horizon, without convexification, for a few UAVs.

This package decides how short the ways of a swarm could be, for comparison: it flies nothing. It imports `geometry`
and `errors` alone. Open `search` first (`solve`); `problem` has the bound that no plan can undercut.

>>> from edc_swarm.reference.problem import Problem
>>> from edc_swarm.reference.search import solve
"""
