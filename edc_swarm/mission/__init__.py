"""The mission: every option with its default and limits, the faults, the roster, and until when progress is promised.

This package decides which missions are valid and how a partly written one is completed. It imports `errors` and
`files`, and `zones` imports `geometry`. Open `configuration` first, which declares every field with its documentation,
`validation` for how a mission file is read, `faults` for the syntax of faults, `prospect` for what is promised after
the last fault.
"""
