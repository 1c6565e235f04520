"""The mission: every option with its default and limits, the faults, and the roster.

This package decides which missions are valid and how a partly written one is completed. It imports `errors` and `files`
and nothing else of the library. Open `configuration` first, which declares every field with its documentation, then
`validation` for how a mission file is read and `faults` for the syntax of faults.
"""
