"""Experiments: declared sweeps of many missions, their statistics and findings, and the fuzzer.

This package decides which missions an experiment runs and what its numbers show; `processes.experiments` runs
them. It may import all of the library but `viz` and `report_page`. Open `sweeps` first.
"""
