"""Foxglove scenes of a mission, built from swarm messages alone.

This package decides what a viewer draws. It imports `recording`, `protocol`, `mission` and `geodesy`, and no agent.
Open `scenery` first; the visualiser process, the simulator and `edc-swarm visualise` feed that class.
"""
