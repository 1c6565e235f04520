"""The command line `edc-swarm`.

This package decides options, exit statuses and what is printed. It may import everything. Open `main` first; every
command is a file in `commands`.
"""
