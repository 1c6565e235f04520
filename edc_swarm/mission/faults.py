"""Faults that a mission asks for: one declaration per verb, which says all that there is to know of it.

A declaration is a class: its fields are the typed values, its docstring is the help text, its decorator says the verb
and the parts of its text. Parser, canonical text, bounds, error texts and the help (`edc-swarm faults`, docs/faults.md)
derive from it. To add a fault, declare it here and write the function that carries it out: in `emulation.machine` if a
UAV's machine does so, in `simulation.faults` and `processes.operator.fault_injector` if it is about whole processes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, ClassVar, Literal, TypeVar, get_args

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.fault_syntax import (
    ONE_UAV,
    Choice,
    Ends,
    Flag,
    Groups,
    Part,
    Quantities,
    Quantity,
    Route,
    Target,
    UnreadableError,
    bounded,
    number,
    number_text,
)
from edc_swarm.mission.field_types import GpsModel, Point
from edc_swarm.mission.link import FOR_GOOD_S, Link
from edc_swarm.mission.roles import RECORDER, ROUTER
from edc_swarm.mission.validation import convert

MOST_IN_FAULT = 1e9
"""Largest time in seconds and largest quantity in a fault."""
MOST_DRIFT_PPM = 500_000.0
OUTAGE: Literal["outage"] = "outage"
"""State of a GPS receiver that measures nothing."""
GpsState = Literal[GpsModel, "outage"]
ROUTER_OUTAGE_S = 1.0
"""Time for which a router that is restarted is away."""
USAGE = "a fault such as 'kill head @10', 'freeze u003 @5s for 2s' or 'partition halves @10 for 20'"

PROCESS = Target(ONE_UAV | {RECORDER, ROUTER})


@dataclass(frozen=True, slots=True)
class Declaration:
    """All that is declared of one verb.

    Attributes
    ----------
    verb
        First word of the fault's text.
    kind
        Class of the typed values.
    parts
        The parts of the text between the verb and the time.
    lasts
        True if the fault may end by itself, `for D`.
    """

    verb: str
    kind: type[Fault]
    parts: tuple[Part, ...]
    lasts: bool

    @property
    def syntaxes(self) -> list[str]:
        """The syntax lines."""
        lines = [self.verb]
        for part in self.parts:
            lines = [f"{line} {syntax}" for syntax in part.syntaxes for line in lines]
        return [f"{line} @WHEN{' [for D]' if self.lasts else ''}" for line in lines]

    @property
    def names(self) -> dict[str, frozenset[str]]:
        """The fields that name UAVs, each with the words that it takes besides ids."""
        return {field: words for part in self.parts for field, words in part.names.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A fault: its class says what goes wrong, `at_s` (mission time) when, `for_s` how long (infinite: for good)."""

    declaration: ClassVar[Declaration]
    carrier: ClassVar[str] = "the UAVs that it concerns"
    at_s: float = 0.0
    for_s: float = math.inf

    @property
    def end_s(self) -> float:
        """Mission time at which it is over."""
        return self.at_s + self.for_s

    @property
    def names(self) -> tuple[str, ...]:
        """The ids and words that it names, in the order of its text."""
        values = (getattr(self, field) for field in self.declaration.names)
        return tuple(name for value in values for name in ((value,) if isinstance(value, str) else value))

    def without_names(self) -> Fault:
        """Return the same fault of nobody: equal for a fault as planned and as carried out."""
        return replace(self, **{field: type(getattr(self, field))() for field in self.declaration.names})

    def __str__(self) -> str:
        """Return the canonical text, which `parse_fault` reads again."""
        words = [word for part in self.declaration.parts for word in part.write(self)]
        lasting = [] if math.isinf(self.for_s) else ["for", f"{number_text(self.for_s)}s"]
        return " ".join([self.declaration.verb, *words, f"@{number_text(self.at_s)}s", *lasting])


@dataclass(frozen=True, slots=True)
class ProcessFault(Fault):
    """A fault that hosts or the operator carry out, and no UAV's own machine."""

    carrier: ClassVar[str] = "the host of the process"
    target: str


F = TypeVar("F", bound=Fault)

DECLARATIONS: dict[str, Declaration] = {}
"""Every declaration, by verb."""


def _declare(verb: str, *parts: Part, lasts: bool = False) -> Callable[[type[F]], type[F]]:
    def enter(kind: type[F]) -> type[F]:
        kind.declaration = DECLARATIONS[verb] = Declaration(verb, kind, parts, lasts)
        return kind

    return enter


@_declare("kill", PROCESS, Flag("mid_step", "mid-step"), lasts=True)
@dataclass(frozen=True, slots=True)
class Kill(ProcessFault):
    """The process dies (SIGKILL); after D it starts again. The recorder does not start again."""

    mid_step: bool = False


@_declare("restart", PROCESS, Flag("lose_memory", "lose-memory"))
@dataclass(frozen=True, slots=True)
class Restart(ProcessFault):
    """The process dies if it lives, and starts again, with `lose-memory` without its promise. Not for the recorder."""

    lose_memory: bool = False


@_declare("freeze", PROCESS, Flag("mid_step", "mid-step"), lasts=True)
@dataclass(frozen=True, slots=True)
class Freeze(ProcessFault):
    """The process stops (SIGSTOP); after D it goes on (SIGCONT). Of freezes that overlap the longest counts."""

    mid_step: bool = False


@_declare("resume", PROCESS)
@dataclass(frozen=True, slots=True)
class Resume(ProcessFault):
    """The process goes on after a freeze (SIGCONT)."""


@_declare("partition", Groups(), lasts=True)
@dataclass(frozen=True, slots=True)
class Partition(Fault):
    """No message passes between the two groups; with LEFT>RIGHT none passes from the first to the second."""

    left: tuple[str, ...]
    right: tuple[str, ...] = ()
    one_way: bool = False


@_declare("heal")
@dataclass(frozen=True, slots=True)
class Heal(Fault):
    """Every partition ends."""


@_declare(
    "link",
    Ends(),
    Quantities(
        (
            Quantity("delay_ms", "MS", 0.0, MOST_IN_FAULT, "delay"),
            Quantity("jitter_ms", "MS", 0.0, MOST_IN_FAULT, "jitter"),
            Quantity("loss", "P", 0.0, 1.0, "loss"),
            Quantity("duplicate", "P", 0.0, 1.0, "duplicate"),
            Quantity("reorder", "P", 0.0, 1.0, "reorder"),
            Quantity("range_m", "M", 0.0, MOST_IN_FAULT, "range"),
        )
    ),
    lasts=True,
)
@dataclass(frozen=True, slots=True)
class ChangeLink(Fault):
    """The links from A to B get these properties in place of those that they have; a quantity that is left out is 0."""

    sender: str
    receiver: str
    quantities: tuple[tuple[str, float], ...] = ()

    def rule(self) -> Link:
        """Return the link rule, which holds while the fault lasts."""
        window = {"start_s": self.at_s, "end_s": min(self.end_s, FOR_GOOD_S)}
        return convert({"sender": self.sender, "receiver": self.receiver, **dict(self.quantities), **window}, Link)


@_declare(
    "clock",
    Target(),
    Quantities(
        (
            Quantity("offset_ms", "MS", -MOST_IN_FAULT, MOST_IN_FAULT, "offset"),
            Quantity("drift_ppm", "PPM", -MOST_DRIFT_PPM, MOST_DRIFT_PPM, "drift"),
        ),
        least_count=1,
    ),
)
@dataclass(frozen=True, slots=True)
class ChangeClock(Fault):
    """The clock is ahead by the offset from then on, and gains the drift."""

    target: str
    quantities: tuple[tuple[str, float], ...]

    @property
    def offset_ms(self) -> float:
        """By how much the clock is ahead."""
        return dict(self.quantities).get("offset_ms", 0.0)

    @property
    def drift_ppm(self) -> float:
        """By how much the clock gains."""
        return dict(self.quantities).get("drift_ppm", 0.0)


@_declare("gps", Target(), Choice("model", "MODEL", (*get_args(GpsModel), OUTAGE)), lasts=True)
@dataclass(frozen=True, slots=True)
class ChangeGps(Fault):
    """The GPS receiver errs by another model or measures nothing (`outage`); after D the mission's model is back."""

    target: str
    model: GpsState


@_declare("gust", Target(), Quantity("speed_mps", "Vmps", 0.0, 100.0, suffix="mps"), lasts=True)
@dataclass(frozen=True, slots=True)
class Gust(Fault):
    """A gust of V m/s from a random direction hits the UAV, if its vehicle has inertia; the last gust counts."""

    target: str
    speed_mps: float


@_declare("motor", Target(), Quantities((Quantity("share", "SHARE", 0.0, 1.0, "weak"),), least_count=1), lasts=True)
@dataclass(frozen=True, slots=True)
class WeakMotor(Fault):
    """The greatest acceleration of the UAV, if its vehicle has inertia, falls to this share."""

    target: str
    quantities: tuple[tuple[str, float], ...]

    @property
    def share(self) -> float:
        """Share of the greatest acceleration that is left."""
        return dict(self.quantities)["share"]


@_declare("land", Target())
@dataclass(frozen=True, slots=True)
class OrderLanding(Fault):
    """The operator orders the UAV to land where it is: it rests, lands, and never flies again in the mission."""

    target: str


VehicleFault = ChangeGps | Gust | WeakMotor | OrderLanding
"""Faults that change how a vehicle flies and measures."""


@_declare("slow", Target(), Quantity("by_ms", "MS", 0.0, MOST_IN_FAULT), lasts=True)
@dataclass(frozen=True, slots=True)
class SlowSolver(Fault):
    """Every plan takes MS milliseconds longer."""

    target: str
    by_ms: float


@_declare("goal", Target(), Route())
@dataclass(frozen=True, slots=True)
class GiveGoal(ProcessFault):
    """The operator gives the UAV a new route, which replaces what it has still to fly."""

    carrier: ClassVar[str] = "the operator"
    route: tuple[Point, ...]


def declaration_of(text: str) -> Declaration | None:
    """Return the declaration of the verb that `text` begins with; None for an unknown verb."""
    return DECLARATIONS.get(next(iter(text.split()), ""))


def parse_fault(text: str, dt_s: float) -> Fault:
    """Read one fault.

    Raises
    ------
    MissionError
        With the text and what would have been accepted.
    """
    declaration = declaration_of(text)
    syntax = " or ".join(declaration.syntaxes) if declaration is not None else USAGE
    try:
        return _parse(text, declaration, dt_s)
    except UnreadableError as error:
        allowed = f"{syntax} ({error})" if str(error) else syntax
    raise MissionError("fault", text, allowed)


def read_fault(text: str, dt_s: float) -> Fault | None:
    """Read the fault that an event of a recording or of the bus tells; None for a text that tells no fault."""
    try:
        return parse_fault(text, dt_s)
    except MissionError:
        return None


def parse_faults(mission: Mission) -> list[Fault]:
    """Read all faults of a mission with a roster, by time.

    Raises
    ------
    MissionError
        A fault cannot be read, names a UAV that is not in the roster, or one whose id is a word for a role too.
    """
    roster = {entry.uav for entry in mission.roster}
    clusters = {entry.cluster for entry in mission.roster if entry.cluster}
    faults = []
    for text in mission.fault:
        fault = parse_fault(text, mission.dt_s)
        words = frozenset[str]().union(*fault.declaration.names.values())
        words |= {f"{word}-{name}" for word in words & ONE_UAV for name in clusters}
        for name in fault.names:
            if name not in roster | words:
                raise MissionError("fault", text, f"about a UAV of the roster, which {name!r} is not")
            if name in roster & words:
                raise MissionError("fault", text, f"about one UAV: {name!r} is both an id and a word for a role")
        faults.append(fault)
    return sorted(faults, key=lambda fault: fault.at_s)


def _parse(text: str, declaration: Declaration | None, dt_s: float) -> Fault:
    verb, *rest = text.split() or [""]
    if declaration is None:
        nearest = get_close_matches(verb, DECLARATIONS, n=1)
        meant = f"; do you mean {nearest[0]}?" if nearest else ";"
        raise UnreadableError(f"unknown fault {verb}{meant} `edc-swarm faults` lists all" if verb else "")
    when = next((i for i, word in enumerate(rest) if word.startswith("@")), None)
    if when is None:
        raise UnreadableError("no @WHEN")
    tail, for_s = rest[when + 1 :], math.inf
    if tail:
        if tail[0] != "for" or len(tail) != 2 or not declaration.lasts:
            raise UnreadableError(f"unexpected {' '.join(tail)}")
        for_s = _seconds(tail[1], dt_s)
    words, values = deque(rest[:when]), dict[str, Any]()
    for part in declaration.parts:
        values.update(part.read(words))
    if words:
        raise UnreadableError
    return declaration.kind(**values, at_s=_seconds(rest[when][1:], dt_s), for_s=for_s)


def _seconds(text: str, dt_s: float) -> float:
    value_s = number(text[:-1]) if text.endswith("s") else number(text) * dt_s
    return bounded(value_s, 0.0, MOST_IN_FAULT, "a time in seconds")
