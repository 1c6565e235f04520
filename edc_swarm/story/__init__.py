"""The story of a mission: what happened, to whom, and why it stands still, told from messages alone.

This package decides which happenings are told and on what evidence. Terminal, `edc-swarm events`, report page and
Foxglove tell the same ones. It imports `protocol` and `mission`, and no numpy. Open `teller` first.
"""
