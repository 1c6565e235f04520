"""The operating-system processes: all sockets, files, clocks and signals.

The `__init__` of every package below states its decisions, its imports and the file to open first. No `__init__`
imports anything.
"""
