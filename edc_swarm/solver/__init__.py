"""The slot QP: problem in, solution with residuals out, certificate last.

This package decides which steps are safe. It imports `geometry` and nothing else of the library. Open `slot_qp`
first; `certificate` decides what is published.
"""
