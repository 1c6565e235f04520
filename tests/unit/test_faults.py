"""The fault vocabulary: what is read, what is refused, and who is meant."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from edc_swarm.emulation.machine import MACHINE_FAULTS
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.fault_help import EXAMPLES, fault_help
from edc_swarm.mission.fault_targets import resolve
from edc_swarm.mission.faults import (
    DECLARATIONS,
    USAGE,
    ChangeClock,
    ChangeGps,
    ChangeLink,
    Fault,
    Freeze,
    Heal,
    Kill,
    Partition,
    ProcessFault,
    Restart,
    Resume,
    SlowSolver,
    parse_fault,
    parse_faults,
)
from edc_swarm.mission.link import FOR_GOOD_S
from edc_swarm.simulation.faults import PROCESS_FAULTS
from processes.operator.fault_injector import Injector
from tests.builders import mission, row

ROSTER = ("u001", "u002", "u003", "u004", "u005")
LINK = "link A>B [delay MS] [jitter MS] [loss P] [duplicate P] [reorder P] [range M] @WHEN [for D]"
CLOCK = "clock TARGET [offset MS] [drift PPM] @WHEN"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "faults.md"


def mission_with(*faults: str) -> Mission:
    """A mission of five UAVs with the given faults."""
    return mission(row(ROSTER, gap_m=20.0, north_m=9.0), fault=list(faults))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("kill head @10", Kill("head", at_s=5.0)),
        ("kill u001 mid-step @1.5s", Kill("u001", mid_step=True, at_s=1.5)),
        ("kill router @2 for 4", Kill("router", at_s=1.0, for_s=2.0)),
        ("restart u001 lose-memory @3", Restart("u001", lose_memory=True, at_s=1.5)),
        ("freeze u003 @5s for 2s", Freeze("u003", at_s=5.0, for_s=2.0)),
        ("resume u003 @8", Resume("u003", at_s=4.0)),
        ("partition halves @10 for 20", Partition(("halves",), at_s=5.0, for_s=10.0)),
        ("partition u1,u2|rest @0", Partition(("u1", "u2"), ("rest",), at_s=0.0)),
        ("partition head>rest @0", Partition(("head",), ("rest",), one_way=True, at_s=0.0)),
        ("heal @4", Heal(at_s=2.0)),
        (
            "link u1>* delay 20 jitter 5 loss 0.1 duplicate 0.2 reorder 0.3 @0",
            ChangeLink(
                "u1",
                "*",
                (("delay_ms", 20), ("jitter_ms", 5), ("loss", 0.1), ("duplicate", 0.2), ("reorder", 0.3)),
            ),
        ),
        ("link *>u1 range 80 @0", ChangeLink("*", "u1", (("range_m", 80),))),
        ("clock u1 offset -2 drift 5 @0", ChangeClock("u1", (("offset_ms", -2), ("drift_ppm", 5)))),
        ("gps u1 gauss-markov @2", ChangeGps("u1", "gauss-markov", at_s=1.0)),
        ("slow standby 300 @2 for 3", SlowSolver("standby", 300.0, at_s=1.0, for_s=1.5)),
    ],
)  # fmt: skip
def test_every_verb_is_read(text: str, fault: Fault) -> None:
    """Every line of the grammar, slots being half a second long."""
    assert parse_fault(text, 0.5) == fault


@pytest.mark.parametrize(
    "text",
    [
        "",
        "kill",
        "kill head",
        "kill @3",
        "explode head @3",
        "kill head @",
        "kill head @soon",
        "kill head @-1",
        "kill head @nan",
        "kill head @inf",
        "kill head @1e300s",
        "kill head @3 later",
        "kill head @3 for",
        "kill head @3 for 2 4",
        "kill head @3 for -1",
        "kill head @3 for inf",
        "kill head lose-memory @3",
        "restart head mid-step @3",
        "restart head @3 for 2",
        "resume head mid-step @3",
        "partition @3",
        "partition u1 @3",
        "partition u1|u2|u3 @3",
        "partition u1|u2 u3 @3",
        "partition rest|rest @3",
        "partition rest,u1|u2 @3",
        "partition halves|u1 @3",
        "heal u1 @3",
        "heal @3 for 2",
        "link @3",
        "link u1 @3",
        "link u1>u2>u3 @3",
        "link u1>u2 loss @3",
        "link u1>u2 loss 1.5 @3",
        "link u1>u2 loss -0.1 @3",
        "link u1>u2 loss nan @3",
        "link u1>u2 speed 3 @3",
        "link u1>u2 delay 1e300 @3",
        "clock u1 @3",
        "clock u1 offset @3",
        "clock u1 offset inf @3",
        "clock u1 drift -1000000 @3",
        "clock u1 speed 3 @3",
        "clock u1 offset 3 @3 for 2",
        "gps u1 @3",
        "gps u1 perfect @3",
        "gps u1 none @3 for x",
        "slow u1 @3",
        "slow u1 -3 @3",
        "slow u1 1e300 @3",
    ],
)
def test_bad_faults_are_refused_in_one_line(text: str) -> None:
    """The message names the field, the whole text and what is allowed."""
    with pytest.raises(MissionError) as caught:
        parse_fault(text, 0.5)
    assert str(caught.value).startswith(f"fault = {text!r}: must be ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("", USAGE),
        ("explode head @3", f"{USAGE} (unknown fault explode; `edc-swarm faults` lists all)"),
        ("kill head", "kill TARGET [mid-step] @WHEN [for D] (no @WHEN)"),
        ("resume head @soon", "resume TARGET @WHEN ('soon' is no number)"),
        ("partition u1 @3", "partition LEFT|RIGHT @WHEN [for D] or partition LEFT>RIGHT @WHEN [for D]"),
        ("link u1>u2 loss @3", LINK),
        ("link u1>u2 loss 1.5 @3", f"{LINK} (loss must be from 0 to 1)"),
        ("clock u1 @3", f"{CLOCK} (give offset or drift)"),
        ("clock u1 drift 1e6 @3", f"{CLOCK} (drift must be from -500000 to 500000)"),
        ("clock u1 speed 3 @3", CLOCK),
    ],
)
def test_the_form_of_the_fault_is_said(text: str, allowed: str) -> None:
    """What is allowed is the line of the vocabulary, and why in the user's words, not in the parser's."""
    with pytest.raises(MissionError) as caught:
        parse_fault(text, 0.5)
    assert caught.value.allowed == allowed


def test_the_help_has_every_declaration() -> None:
    """Syntax, effect, bounds and who carries it out; every syntax line is one that the parser's error quotes."""
    page = fault_help()
    for declaration in DECLARATIONS.values():
        section = page.split(f"## {declaration.verb}\n")[1].split("\n## ")[0]
        assert [line.strip() for line in section.splitlines() if line.startswith("    ")] == declaration.syntaxes
        assert str(declaration.kind.__doc__) in section
        assert f"It is carried out by {declaration.kind.carrier}." in section
        with pytest.raises(MissionError) as caught:
            parse_fault(f"{declaration.verb} @", 0.5)
        assert " or ".join(declaration.syntaxes) in caught.value.allowed


def test_the_page_of_the_docs_is_current() -> None:
    """`edc-swarm faults > docs/faults.md` writes it anew."""
    assert PAGE.read_text() == fault_help()


def test_every_example_is_a_fault_of_its_verb() -> None:
    """An example can be copied as it stands."""
    assert EXAMPLES.keys() == DECLARATIONS.keys()
    for verb, (example, _) in EXAMPLES.items():
        assert parse_fault(example, 0.5).declaration.verb == verb


@pytest.mark.parametrize(("verb", "meant"), [("kil", "kill"), ("partitoin", "partition"), ("restrat", "restart")])
def test_an_unknown_verb_suggests_the_nearest(verb: str, meant: str) -> None:
    """One that is like no other suggests none."""
    with pytest.raises(MissionError, match=f"do you mean {meant}\\?"):
        parse_fault(f"{verb} head @10", 0.5)
    with pytest.raises(MissionError) as caught:
        parse_fault("xyzzy head @10", 0.5)
    assert "do you mean" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "kill u009 @3",
        "kill rest @3",
        "kill halves @3",
        "kill * @3",
        "freeze u001,u002 @3",
        "partition u001|u009 @3",
        "partition *|u001 @3",
        "partition |u001 @3",
        "partition router|rest @3",
        "link u001>rest @3",
        "link u001>u009 @3",
        "clock router offset 3 @3",
        "gps recorder none @3",
        "slow rest 3 @3",
    ],
)
def test_faults_are_about_uavs_of_the_roster(text: str) -> None:
    """A name that is neither in the roster nor a word of that verb is refused."""
    with pytest.raises(MissionError, match="about a UAV of the roster"):
        parse_faults(mission_with(text))


def test_faults_come_by_time() -> None:
    """The order in the mission file does not matter."""
    faults = parse_faults(mission_with("kill u002 @9", "kill router @1s", "heal @3"))
    assert [fault.declaration.verb + "".join(fault.names) for fault in faults] == ["killrouter", "heal", "killu002"]


@pytest.mark.parametrize(
    ("text", "resolved"),
    [
        ("kill head @1", "kill u003 @0.5s"),
        ("kill standby @1", "kill u001 @0.5s"),
        ("kill router @1", "kill router @0.5s"),
        ("heal @1", "heal @0.5s"),
        ("partition halves @1", "partition u001,u002|u003,u004,u005 @0.5s"),
        ("partition head|rest @1", "partition u003|u001,u002,u004,u005 @0.5s"),
        ("partition rest>head @1", "partition u001,u002,u004,u005>u003 @0.5s"),
        ("partition head,standby|u002 @1", "partition u003,u001|u002 @0.5s"),
        ("link head>* jitter 3 delay 2 @1", "link u003>* jitter 3 delay 2 @0.5s"),
    ],
)
def test_words_become_ids(text: str, resolved: str) -> None:
    """`head`, `standby`, `halves` and `rest` mean those of the moment; order and direction stay."""
    fault = parse_fault(text, 0.5)
    found = resolve(fault, "u003", ["u001", "u005"], ROSTER)
    assert str(found) == resolved
    assert found is not None
    assert found.without_names() == fault.without_names()


@pytest.mark.parametrize("text", ["kill head @1", "kill standby @1", "partition head|rest @1", "link *>head @1"])
def test_nobody_to_be_meant(text: str) -> None:
    """While there is no head and no standby, such a fault has no target."""
    assert resolve(parse_fault(text, 0.5), "", [], ROSTER) is None


def test_times() -> None:
    """A fault without `for` is for good; the link rule has the fault's window."""
    assert parse_fault("partition halves @4", 0.5).end_s == math.inf
    rule = _link("link u1>* loss 0.25 delay 7 @4 for 6").rule()
    assert (rule.sender, rule.receiver, rule.loss, rule.delay_ms, rule.start_s, rule.end_s) == (
        "u1", "*", 0.25, 7.0, 2.0, 5.0,
    )  # fmt: skip
    assert _link("link u1>* loss 0.25 @4").rule().end_s == FOR_GOOD_S


def _link(text: str) -> ChangeLink:
    fault = parse_fault(text, 0.5)
    assert isinstance(fault, ChangeLink)
    return fault


def test_every_fault_has_a_handler() -> None:
    """The tables of the simulator, of the machines and of the injector hold every kind, each where it belongs."""
    kinds = {declaration.kind for declaration in DECLARATIONS.values()}
    processes = {kind for kind in kinds if issubclass(kind, ProcessFault)}
    assert MACHINE_FAULTS.kinds == kinds - processes
    assert PROCESS_FAULTS.kinds == processes
    assert Injector.HANDLERS.kinds == processes
