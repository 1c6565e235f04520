"""Planners behind one small interface (`edc_swarm.planner.interface`)."""
