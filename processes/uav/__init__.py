"""One UAV process: it feeds `edc_swarm.agent.node.UavNode` from the bus and a monotonic clock.

This package decides when the agent steps, and keeps the agent's promise on disk. It imports `bus` and `runtime`, and
no numpy until the UAV may have to lead. Open `process` first (`python -m processes.uav.process`).
"""
