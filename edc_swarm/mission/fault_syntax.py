"""The parts that a fault's text is made of: each reads its words, checks its bounds and writes its words again.

A declaration in `mission.faults` is a verb with such parts. Syntax, reader, text and help of a fault derive from it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import Any

from edc_swarm.mission.field_types import MAX_GOAL_POINTS, MOST_M
from edc_swarm.mission.wording import plain_number

HEAD, STANDBY, REST, HALVES, EVERY_UAV = "head", "standby", "rest", "halves", "*"
ONE_UAV = frozenset({HEAD, STANDBY})
"""Words that stand for one UAV."""


class UnreadableError(ValueError):
    """The reason why a fault cannot be read, in words for the user; empty where the syntax says enough."""


class Part(ABC):
    """One part of a fault's text."""

    @property
    @abstractmethod
    def syntaxes(self) -> tuple[str, ...]:
        """The forms that a syntax line shows for this part."""

    @property
    def names(self) -> dict[str, frozenset[str]]:
        """The fields that name UAVs, each with the words that it takes besides the ids of the roster."""
        return {}

    @property
    def limits(self) -> str:
        """Sentences for the help text on what this part takes."""
        return ""

    @abstractmethod
    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take the words of this part from the front of `words` and return the fields that they set."""

    @abstractmethod
    def write(self, fault: Any) -> list[str]:
        """Return the words of this part in the text of `fault`."""


@dataclass(frozen=True)
class Target(Part):
    """The one process that a fault is for, in the field `target`."""

    words: frozenset[str] = ONE_UAV
    syntaxes = ("TARGET",)

    @property
    def names(self) -> dict[str, frozenset[str]]:
        """The field of the target."""
        return {"target": self.words}

    @property
    def limits(self) -> str:
        """Ids and words that are targets."""
        return f"TARGET is an id, {_either(sorted(self.words))}."

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take one word."""
        return {"target": _next(words)}

    def write(self, fault: Any) -> list[str]:
        """Return the target."""
        return [fault.target]


@dataclass(frozen=True)
class Groups(Part):
    """Two groups of UAVs, in the fields `left` and `right`; with `>` between them the field `one_way` is set."""

    syntaxes = ("LEFT|RIGHT", "LEFT>RIGHT")
    limits = (
        "LEFT and RIGHT are ids, `head`, `standby` joined by commas, or `rest` (one of the two); "
        "LEFT|RIGHT may be `halves`."
    )

    @property
    def names(self) -> dict[str, frozenset[str]]:
        """The fields of both groups."""
        return dict.fromkeys(("left", "right"), ONE_UAV | {REST, HALVES})

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take one word: `halves`, or two groups."""
        text = _next(words)
        if text == HALVES:
            return {"left": (HALVES,), "right": ()}
        one_way = ">" in text
        left, right = _pair(text, ">" if one_way else "|")
        groups = left.split(","), right.split(",")
        named = [*groups[0], *groups[1]]
        if HALVES in named or (REST in named and groups.count([REST]) != 1):
            raise UnreadableError("halves stands alone, and rest is one whole group of the two")
        return {"left": tuple(groups[0]), "right": tuple(groups[1]), "one_way": one_way}

    def write(self, fault: Any) -> list[str]:
        """Return `halves` or the two groups."""
        left, right = ",".join(fault.left), ",".join(fault.right)
        return [f"{left}{'>' if fault.one_way else '|'}{right}" if right else left]


@dataclass(frozen=True)
class Ends(Part):
    """A directed link, in the fields `sender` and `receiver`."""

    syntaxes = ("A>B",)
    limits = "A and B are ids, `head`, `standby` or `*`, which is every UAV."

    @property
    def names(self) -> dict[str, frozenset[str]]:
        """The fields of both ends."""
        return dict.fromkeys(("sender", "receiver"), ONE_UAV | {EVERY_UAV})

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take one word."""
        sender, receiver = _pair(_next(words), ">")
        return {"sender": sender, "receiver": receiver}

    def write(self, fault: Any) -> list[str]:
        """Return the link."""
        return [f"{fault.sender}>{fault.receiver}"]


@dataclass(frozen=True)
class Flag(Part):
    """A word that sets a field to True where it stands."""

    field: str
    word: str

    @property
    def syntaxes(self) -> tuple[str, ...]:
        """The word, in brackets."""
        return (f"[{self.word}]",)

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take the word if it comes next."""
        found = False
        while words and words[0] == self.word:
            found = bool(words.popleft())
        return {self.field: found}

    def write(self, fault: Any) -> list[str]:
        """Return the word if it is set."""
        return [self.word] if getattr(fault, self.field) else []


@dataclass(frozen=True)
class Choice(Part):
    """One of several words."""

    field: str
    syntax: str
    words: tuple[str, ...]

    @property
    def syntaxes(self) -> tuple[str, ...]:
        """The placeholder of the word."""
        return (self.syntax,)

    @property
    def limits(self) -> str:
        """The words."""
        return f"{self.syntax} is {_either(self.words)}."

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take one word."""
        word = _next(words)
        if word not in self.words:
            raise UnreadableError(f"{self.syntax} is {_either(self.words, quote='')}")
        return {self.field: word}

    def write(self, fault: Any) -> list[str]:
        """Return the word."""
        return [getattr(fault, self.field)]


@dataclass(frozen=True)
class Route(Part):
    """Points that a UAV flies to one after another, in the field `route`."""

    syntaxes = ("X,Y [X,Y ...]",)
    limits = (
        f"X and Y are coordinates in metres, from {plain_number(-MOST_M)} to {plain_number(MOST_M)}; "
        f"at most {MAX_GOAL_POINTS} points."
    )

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take all that is left."""
        points = []
        while words:
            pair = _pair(words.popleft(), ",")
            points.append(tuple(bounded(number(text), -MOST_M, MOST_M, "a coordinate") for text in pair))
        if not 1 <= len(points) <= MAX_GOAL_POINTS:
            raise UnreadableError(f"give 1 to {MAX_GOAL_POINTS} points X,Y")
        return {"route": tuple(points)}

    def write(self, fault: Any) -> list[str]:
        """Return the points."""
        return [f"{number_text(x_m)},{number_text(y_m)}" for x_m, y_m in fault.route]


@dataclass(frozen=True)
class Quantity(Part):
    """A number within bounds: a part by itself, or after its word one of `Quantities`. Its unit may be a suffix."""

    field: str
    unit: str
    least: float
    most: float
    word: str = ""
    suffix: str = ""

    @property
    def syntaxes(self) -> tuple[str, ...]:
        """The word, if there is one, and the unit."""
        return (f"{self.word} {self.unit}".lstrip(),)

    @property
    def limits(self) -> str:
        """The bounds."""
        return f"{self.syntaxes[0]} is from {plain_number(self.least)} to {plain_number(self.most)}."

    def value(self, text: str) -> float:
        """Return the number that `text` says."""
        return bounded(number(text.removesuffix(self.suffix)), self.least, self.most, self.word or self.unit)

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take one number."""
        return {self.field: self.value(_next(words))}

    def write(self, fault: Any) -> list[str]:
        """Return the number."""
        return [f"{number_text(getattr(fault, self.field))}{self.suffix}"]


@dataclass(frozen=True)
class Quantities(Part):
    """Named quantities in any order, in the field `quantities`: pairs of field and value, as they were written."""

    of: tuple[Quantity, ...]
    least_count: int = 0

    @property
    def syntaxes(self) -> tuple[str, ...]:
        """Every quantity, in brackets."""
        return (" ".join(f"[{quantity.syntaxes[0]}]" for quantity in self.of),)

    @property
    def limits(self) -> str:
        """The bounds of all."""
        return "\n".join(quantity.limits for quantity in self.of)

    def read(self, words: deque[str]) -> dict[str, Any]:
        """Take all that is left."""
        by_word, found = {quantity.word: quantity for quantity in self.of}, []
        while words:
            quantity = by_word.get(words.popleft())
            if quantity is None:
                raise UnreadableError
            found.append((quantity.field, quantity.value(_next(words))))
        if len(found) < self.least_count:
            raise UnreadableError(f"give {_either([quantity.word for quantity in self.of], quote='')}")
        return {"quantities": tuple(found)}

    def write(self, fault: Any) -> list[str]:
        """Return words and numbers, in their order."""
        word = {quantity.field: quantity.word for quantity in self.of}
        return [text for field, value in fault.quantities for text in (word[field], number_text(value))]


def bounded(value: float, least: float, most: float, name: str) -> float:
    """Return `value` if it is within its bounds."""
    if not least <= value <= most:
        raise UnreadableError(f"{name} must be from {plain_number(least)} to {plain_number(most)}")
    return value


def number(text: str) -> float:
    """Return the number that `text` says."""
    try:
        return float(text)
    except ValueError:
        raise UnreadableError(f"{text!r} is no number") from None


def number_text(value: float) -> str:
    """Return twelve digits where they are exact, else all that it takes."""
    short = f"{value:.12g}"
    return short if float(short) == value else repr(value)


def _next(words: deque[str]) -> str:
    if not words:
        raise UnreadableError
    return words.popleft()


def _pair(text: str, separator: str) -> tuple[str, str]:
    parts = text.split(separator)
    if len(parts) != 2:
        raise UnreadableError
    return parts[0], parts[1]


def _either(words: tuple[str, ...] | list[str], quote: str = "`") -> str:
    """Return the words as an enumeration: `a`, `b` or `c`."""
    *first, last = (f"{quote}{word}{quote}" for word in words)
    return f"{', '.join(first)} or {last}"
