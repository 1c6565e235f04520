"""The operating-system processes: all sockets, files, clocks and signals are in here."""
