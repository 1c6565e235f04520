"""The operating-system processes: all sockets, files, clocks and signals are in here.

Every package below says in its `__init__` what it decides, what it may import and which file to open first. No
`__init__` imports anything.
"""
