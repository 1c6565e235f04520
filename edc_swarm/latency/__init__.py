"""Latency experiments: what delay, jitter and loss do to a centrally planned swarm."""
