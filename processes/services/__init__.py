"""Router, recorder and visualiser, each a process of its own.

This package decides which messages the router forwards, the recorder writes and viewers receive. It imports `bus`
and `runtime`. Open `recorder` first (`python -m processes.services.recorder`, likewise `.router` and `.visualiser`).
"""
