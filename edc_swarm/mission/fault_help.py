"""The fault vocabulary as a page for users, made of the declarations."""

from __future__ import annotations

from edc_swarm.mission.faults import DECLARATIONS, MOST_IN_FAULT, Declaration

_INTRODUCTION = f"""\
# Faults

The swarm suffers these faults on purpose: `fault` in mission files, `--fault` of `edc-swarm run` and `edc-swarm sim`,
and the fuzzer take this vocabulary. (This page is what `edc-swarm run --fault-help` prints.)

- WHEN and D are slots, or seconds of mission time with an `s`, up to {MOST_IN_FAULT:g} s: `@10`, `@5s`, `for 4`,
  `for 2.5s`. Without `for` the fault lasts for good.
- `head` and `standby` are the head and the first standby at that time. A fault is skipped if no UAV holds the role; the
  event `fault-without-target` says so. The event `fault` tells what was done when, with ids in place of words.
- `edc-swarm sim` has no recorder process, so it skips faults of `recorder`.
- `mid-step` stops the process between two effects of one step. The simulator alone can aim at such a moment; for real
  processes it is an ordinary kill or freeze.
"""


def fault_help() -> str:
    """Return the page: what every fault does, its syntax, its bounds and who carries it out."""
    return "\n".join([_INTRODUCTION, *map(_section, DECLARATIONS.values())])


def _section(declaration: Declaration) -> str:
    syntaxes = "\n".join(f"    {line}" for line in declaration.syntaxes)
    limits = "".join(f"{part.limits}\n" for part in declaration.parts if part.limits)
    carrier = f"Carried out by {declaration.kind.carrier}.\n"
    return f"## {declaration.verb}\n\n{syntaxes}\n\n{declaration.kind.__doc__}\n{limits}{carrier}"
