"""The fault vocabulary as a page for users, made of the declarations."""

from __future__ import annotations

from edc_swarm.mission.faults import DECLARATIONS, MOST_IN_FAULT, Declaration
from edc_swarm.mission.wording import plain_number

_INTRODUCTION = f"""\
# Faults

The swarm suffers these faults on purpose: `fault` in mission files, `--fault` of `edc-swarm run` and `edc-swarm sim`,
and the fuzzer take this vocabulary. (This page is what `edc-swarm faults` prints.)

- WHEN and D are slots, or seconds of mission time with an `s`, up to {plain_number(MOST_IN_FAULT)} s:
  `@10`, `@5s`, `for 4`, `for 2.5s`. Without `for` the fault lasts for good.
- MS are milliseconds, M metres, PPM parts per million; P is a probability.
- `head` and `standby` are the head and the first standby at that time; of several clusters `head-NAME` and
  `standby-NAME` are those of cluster NAME, `head` that of the first. A fault is skipped if no UAV holds the role; the
  event `fault-without-target` says so. The event `fault` tells what was done when, with ids in place of words.
- `edc-swarm sim` has no recorder process, so it skips faults of `recorder`.
- `mid-step` stops the process between two effects of one step. The simulator alone can aim at such a moment; for real
  processes it is an ordinary kill or freeze.
"""


EXAMPLES = {
    "kill": ("kill head @10", "the UAV that leads in slot 10 dies"),
    "restart": ("restart u003 lose-memory @5s", "u003 starts again without its promise"),
    "freeze": ("freeze standby @10 for 2.5s", "the first standby stops for 2.5 s"),
    "resume": ("resume u003 @20", "u003 goes on"),
    "partition": ("partition u001,u002|rest @10 for 20", "two UAVs are cut off for 20 slots"),
    "heal": ("heal @30", "all partitions end in slot 30"),
    "link": ("link *>u004 delay 80 loss 0.2 @10 for 5s", "what is sent to u004 is late, and a fifth is lost"),
    "clock": ("clock u002 offset 150 @10", "the clock of u002 is 150 ms ahead"),
    "gps": ("gps u005 white @10", "the GPS error of u005 is drawn anew at every fix"),
    "gust": ("gust u005 8mps @10", "a gust of 8 m/s hits u005"),
    "motor": ("motor u005 weak 0.5 @10 for 4s", "u005 accelerates half as much for 4 s"),
    "land": ("land u002 @20", "u002 rests, lands and stays on the ground"),
    "slow": ("slow head 300 @10 for 4", "plans of the head take 300 ms longer"),
    "goal": ("goal u003 120,40 80,40 @20", "u003 flies to two other points"),
}
"""An example of each fault, with what it does."""


def fault_help() -> str:
    """Return the page: what every fault does, its syntax, its bounds and who carries it out."""
    return "\n".join([_INTRODUCTION, *map(_section, DECLARATIONS.values())])


def _section(declaration: Declaration) -> str:
    example, does = EXAMPLES[declaration.verb]
    syntaxes = "\n".join(f"    {line}" for line in declaration.syntaxes)
    limits = "".join(f"{part.limits}\n" for part in declaration.parts if part.limits)
    carrier = f"It is carried out by {declaration.kind.carrier}.\n"
    shown = f"For example `{example}`: {does}.\n"
    return f"## {declaration.verb}\n\n{syntaxes}\n\n{declaration.kind.__doc__}\n{limits}{shown}{carrier}"
