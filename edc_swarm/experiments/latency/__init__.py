"""The latency experiments: the effect of delay, jitter and loss on a centrally planned swarm.

Open `declared` first.
"""
