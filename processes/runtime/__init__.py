"""Shared parts of every process: an inbox with one loop, child processes, a clock, console, output files, run facts.

This package decides how a process waits, ends and writes. It imports no other package of `processes`. Open `inbox`
first, then `loop`.
"""
