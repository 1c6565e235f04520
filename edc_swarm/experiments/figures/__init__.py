"""The figures of the paper's section IV, and of the energy bill: their missions, tables and findings.

Open `catalogue` first.
"""
