"""The door for notebooks and scripts: `import edc_swarm as es; run = es.simulate(uavs=20, loss=0.1)`.

This package decides what a researcher calls, and what it shows. Open `flight` first; `docs/python.md` is its reference.
It may import everything but `cli`.
"""
