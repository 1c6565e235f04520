"""Mission files of other programs, read; and tracks, written for other programs.

This package decides what a file of another program means as a mission, and what a mission cannot express of it.
It takes bytes and returns values, and imports `mission` and `geodesy`. Open `registry` first: its table has a row per
format.
"""
