"""The guarantees, each checked on a recording alone.

One file per guarantee; `check` runs them in order, `verdict` defines what a verdict is. It imports the rest of
`analysis` and what `analysis` may import. Open `check` first.
"""
