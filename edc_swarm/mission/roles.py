"""Processes beside the UAVs, by the names under which they speak and are certified."""

from __future__ import annotations

OPERATOR, RECORDER, VISUALISER, ROUTER = "operator", "recorder", "viz", "router"
GROUND = "ground"
"""The bridge to a ground station."""
LIVE = "live"
"""A visualiser that only shows: it asks for orders of its own."""
ROLES = frozenset({OPERATOR, RECORDER, VISUALISER, GROUND, ROUTER})
"""Processes beside the UAVs, by the names under which they speak and are certified."""
JOIN = "join"
"""In the place of a UAV's id in the liveliness token of a claimant (`edc-swarm join`), and its certificate's name."""
RESERVED_IDS = ROLES | {JOIN, "ca"}
"""No UAV may be named like a role, a claimant, or the file of the authority that certifies them."""
