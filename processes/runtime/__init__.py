"""What every process needs: an inbox with one loop, child processes, a clock, console, output files, facts about
the run.

This package decides how a process waits, ends and writes. It imports no other package of `processes`. Open `inbox`
first, then `loop`.
"""
