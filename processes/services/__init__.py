"""Router, recorder and visualiser, each a process of its own.

This package decides what the router lets pass, what is recorded and what viewers get. It imports `bus` and
`runtime`. Open `recorder` first (`python -m processes.services.recorder`, likewise `.router` and `.visualiser`).
"""
