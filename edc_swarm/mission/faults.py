"""What can go wrong on purpose: the fault vocabulary of mission files, `--fault` and the fuzzer.

    kill TARGET [mid-step] @WHEN [for D]    the process dies (SIGKILL), and is started again after D
    restart TARGET [lose-memory] @WHEN      it comes back, with or without its promise
    freeze TARGET [mid-step] @WHEN [for D]  it stops (SIGSTOP), and goes on after D (SIGCONT)
    resume TARGET @WHEN
    partition LEFT|RIGHT @WHEN [for D]      nothing passes between two groups
    partition LEFT>RIGHT @WHEN [for D]      nothing passes from the first to the second
    heal @WHEN                              every partition ends
    link A>B [delay MS] [jitter MS] [loss P] [duplicate P] [reorder P] [range M] @WHEN [for D]
    clock TARGET [offset MS] [drift PPM] @WHEN
    gps TARGET MODEL @WHEN
    slow TARGET MS @WHEN [for D]            the solver takes MS longer

TARGET is an id, `head` or `standby`, for the first four also `router` or, with real processes,
`recorder`, which is not restarted. LEFT|RIGHT is `halves`, or two groups: `rest` (one of them), or ids,
`head`, `standby` joined by commas; A and B are ids, `head`, `standby` or `*`. WHEN and D are slots, or
seconds of mission time with an `s`: `@10`, `@5s`, `for 4`, `for 2.5s`. Without `for` it is for good.
Of freezes that overlap the longest counts. A `link` replaces what those links did before: what it does
not say is 0. A fault whose target nobody is at its time does nothing, and the record says so (event
`fault-without-target`; what was done when is in the events `fault`, with ids in place of words).
`mid-step` stops the process between two effects of one step; it is honoured by the simulator, where
such a moment can be aimed at, and is an ordinary kill or freeze for real processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import RECORDER, ROUTER, Link, Mission
from edc_swarm.mission.validation import convert

HEAD, STANDBY, REST, HALVES = "head", "standby", "rest", "halves"
PROCESS_VERBS = frozenset({"kill", "restart", "freeze", "resume"})
LINK_WORDS = ("delay", "jitter", "loss", "duplicate", "reorder", "range")
TARGETS = frozenset({HEAD, STANDBY})
"""Words that stand for one UAV."""
WORDS = {
    **dict.fromkeys(PROCESS_VERBS, TARGETS | {RECORDER, ROUTER}),
    "partition": TARGETS | {REST, HALVES},
    "link": TARGETS | {"*"},
    **dict.fromkeys(("clock", "gps", "slow"), TARGETS),
}
"""What a fault may name besides the UAVs of the roster."""
LASTING_VERBS = frozenset({"kill", "freeze", "partition", "link", "slow"})
"""Faults that may end by themselves, `for D`."""
MOST = 1e9
"""Largest time in seconds and largest quantity in a fault."""
MOST_DRIFT_PPM = 500_000.0
USAGE = "a fault such as 'kill head @10', 'freeze u003 @5s for 2s' or 'partition halves @10 for 20'"
FORMS = {
    "kill": "kill TARGET [mid-step] @WHEN [for D]",
    "restart": "restart TARGET [lose-memory] @WHEN",
    "freeze": "freeze TARGET [mid-step] @WHEN [for D]",
    "resume": "resume TARGET @WHEN",
    "partition": "partition LEFT|RIGHT @WHEN [for D] or partition LEFT>RIGHT @WHEN [for D]",
    "heal": "heal @WHEN",
    "link": "link A>B [delay MS] [jitter MS] [loss P] [duplicate P] [reorder P] [range M] @WHEN [for D]",
    "clock": "clock TARGET [offset MS] [drift PPM] @WHEN",
    "gps": "gps TARGET MODEL @WHEN",
    "slow": "slow TARGET MS @WHEN [for D]",
}
"""What is said of a fault that cannot be read, by its verb."""


class _UnreadableError(ValueError):
    """Why, in words for the user."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: what, to whom, when (mission seconds), for how long (infinite: for good).

    `left` is the target or the first group, `right` the second group; `flags` are words such as
    `mid-step`, `lose-memory`, a GPS model or `one-way`; `numbers` are named quantities such as
    `delay_ms` or `loss`.
    """

    verb: str
    left: tuple[str, ...] = ()
    right: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    numbers: tuple[tuple[str, float], ...] = ()
    at_s: float = 0.0
    for_s: float = math.inf

    @property
    def target(self) -> str:
        """The one process this fault is for."""
        return self.left[0]

    @property
    def end_s(self) -> float:
        """Mission time at which it is over."""
        return self.at_s + self.for_s

    def number(self, name: str, default: float = 0.0) -> float:
        """A named quantity, or `default`."""
        return dict(self.numbers).get(name, default)

    def __str__(self) -> str:
        """The canonical text, which `parse_fault` takes again."""
        words = [self.verb, *([_groups_text(self)] if self.left else []), *self.flags_shown(), *_numbers_text(self)]
        lasting = [] if math.isinf(self.for_s) else ["for", f"{_number_text(self.for_s)}s"]
        return " ".join([*words, f"@{_number_text(self.at_s)}s", *lasting])

    def flags_shown(self) -> list[str]:
        """Flags that stand in the text as words of their own."""
        return [flag for flag in self.flags if flag != "one-way"]

    def link(self) -> Link:
        """The link rule of a `link` fault."""
        fields = dict(self.numbers)
        window = {"start_s": self.at_s, "end_s": min(self.end_s, 1e9)}
        return convert({"sender": self.left[0], "receiver": self.right[0], **fields, **window}, Link)


def parse_fault(text: str, dt_s: float) -> Fault:
    """Read one fault.

    Raises
    ------
    MissionError
        With the text and what would have been accepted.
    """
    words = text.split()
    form = FORMS.get(words[0], USAGE) if words else USAGE
    try:
        return _parse_words(words, dt_s)
    except _UnreadableError as error:
        raise MissionError("fault", text, f"{form} ({error})") from None
    except (ValueError, IndexError, KeyError):
        raise MissionError("fault", text, form) from None


def parse_faults(mission: Mission) -> list[Fault]:
    """All faults of a mission with a roster, by time.

    Raises
    ------
    MissionError
        A fault cannot be read, or names a UAV that is not in the roster.
    """
    roster = {entry.uav for entry in mission.roster}
    faults = []
    for text in mission.fault:
        fault = parse_fault(text, mission.dt_s)
        for name in (*fault.left, *fault.right):
            if name not in roster | WORDS.get(fault.verb, frozenset()):
                raise MissionError("fault", text, f"about a UAV of the roster, which {name!r} is not")
        faults.append(fault)
    return sorted(faults, key=lambda fault: fault.at_s)


def resolve(fault: Fault, head: str, standbys: Sequence[str], roster: Sequence[str]) -> Fault | None:
    """The same fault with ids in place of `head`, `standby`, `halves`, `rest`; None when nobody is that now."""
    left = _resolved(fault.left, head, standbys)
    right = _resolved(fault.right, head, standbys)
    if fault.left == (HALVES,):
        left, right = tuple(roster[: len(roster) // 2]), tuple(roster[len(roster) // 2 :])
    elif fault.right == (REST,):
        right = tuple(uav for uav in roster if uav not in left)
    elif fault.left == (REST,):
        left = tuple(uav for uav in roster if uav not in right)
    nobody = (fault.left and not left) or (fault.right and not right)
    return None if nobody else replace(fault, left=left, right=right)


def _resolved(names: tuple[str, ...], head: str, standbys: Sequence[str]) -> tuple[str, ...]:
    table = {HEAD: head, STANDBY: standbys[0] if standbys else ""}
    found = (table.get(name, name) for name in names)
    return tuple(name for name in found if name)


def _parse_words(words: list[str], dt_s: float) -> Fault:
    verb, rest = words[0], words[1:]
    if verb not in _READERS:
        raise _UnreadableError(f"unknown fault {verb}")
    when = next((i for i, word in enumerate(rest) if word.startswith("@")), None)
    if when is None:
        raise _UnreadableError("no @WHEN")
    tail = rest[when + 1 :]
    for_s = math.inf
    if tail:
        if tail[0] != "for" or len(tail) != 2 or verb not in LASTING_VERBS:
            raise _UnreadableError(f"unexpected {' '.join(tail)}")
        for_s = _seconds(tail[1], dt_s)
    fault = _READERS[verb](verb, rest[:when])
    return replace(fault, at_s=_seconds(rest[when][1:], dt_s), for_s=for_s)


def _seconds(text: str, dt_s: float) -> float:
    return _bounded(_number(text[:-1]) if text.endswith("s") else _number(text) * dt_s)


def _bounded(value: float) -> float:
    if not 0 <= value <= MOST:
        raise _UnreadableError(f"a time or quantity must be from 0 to {MOST:g}")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise _UnreadableError(f"{text!r} is no number") from None


def _read_process(verb: str, words: list[str]) -> Fault:
    allowed = {"kill": "mid-step", "freeze": "mid-step", "restart": "lose-memory"}.get(verb)
    if any(flag != allowed for flag in words[1:]):
        raise ValueError
    return Fault(verb, (words[0],), flags=tuple(words[1:]))


def _read_partition(verb: str, words: list[str]) -> Fault:
    (groups,) = words
    if groups == HALVES:
        return Fault(verb, (HALVES,))
    one_way = ">" in groups
    left, right = groups.split(">" if one_way else "|")
    names = left.split(","), right.split(",")
    if HALVES in (*names[0], *names[1]) or (REST in (*names[0], *names[1]) and (names.count([REST]) != 1)):
        raise _UnreadableError("halves stands alone, and rest is one whole group of the two")
    return Fault(verb, tuple(names[0]), tuple(names[1]), ("one-way",) if one_way else ())


def _read_heal(verb: str, words: list[str]) -> Fault:
    if words:
        raise ValueError
    return Fault(verb)


def _read_link(verb: str, words: list[str]) -> Fault:
    sender, receiver = words[0].split(">")
    fields = {"delay": "delay_ms", "jitter": "jitter_ms", "range": "range_m"}
    pairs = list(zip(words[1::2], words[2::2], strict=True))
    if any(name not in LINK_WORDS for name, _ in pairs):
        raise ValueError
    numbers = tuple((fields.get(name, name), _bounded(_number(value))) for name, value in pairs)
    if any(value > 1 for name, value in numbers if name not in fields.values()):
        raise _UnreadableError("a probability is at most 1")
    return Fault(verb, (sender,), (receiver,), numbers=numbers)


def _read_clock(verb: str, words: list[str]) -> Fault:
    fields = {"offset": "offset_ms", "drift": "drift_ppm"}
    numbers = tuple((fields[name], _number(value)) for name, value in zip(words[1::2], words[2::2], strict=True))
    most = {"offset_ms": MOST, "drift_ppm": MOST_DRIFT_PPM}
    if not numbers or not all(abs(value) <= most[name] for name, value in numbers):
        raise _UnreadableError(
            f"clock takes offset MS up to {MOST:g} and drift PPM up to {MOST_DRIFT_PPM:g}, either way"
        )
    return Fault(verb, (words[0],), numbers=numbers)


def _read_gps(verb: str, words: list[str]) -> Fault:
    target, model = words
    if model not in {"none", "bias", "white", "gauss-markov"}:
        raise _UnreadableError("gps takes none, bias, white or gauss-markov")
    return Fault(verb, (target,), flags=(model,))


def _read_slow(verb: str, words: list[str]) -> Fault:
    target, by_ms = words
    return Fault(verb, (target,), numbers=(("by_ms", _bounded(_number(by_ms))),))


_READERS: dict[str, Callable[[str, list[str]], Fault]] = {
    **dict.fromkeys(PROCESS_VERBS, _read_process),
    "partition": _read_partition,
    "heal": _read_heal,
    "link": _read_link,
    "clock": _read_clock,
    "gps": _read_gps,
    "slow": _read_slow,
}


def _groups_text(fault: Fault) -> str:
    left, right = ",".join(fault.left), ",".join(fault.right)
    if not right:
        return left
    return f"{left}{'>' if fault.verb == 'link' or 'one-way' in fault.flags else '|'}{right}"


def _numbers_text(fault: Fault) -> list[str]:
    if fault.verb == "slow":
        return [_number_text(fault.number("by_ms"))]
    return [word for name, value in fault.numbers for word in (name.split("_")[0], _number_text(value))]


def _number_text(value: float) -> str:
    """Twelve digits where they are exact, else all that it takes."""
    short = f"{value:.12g}"
    return short if float(short) == value else repr(value)
