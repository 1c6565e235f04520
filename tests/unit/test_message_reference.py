"""The page of the messages: every kind, with an example that a simulated mission has sent."""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest
from msgspec import Struct

from edc_swarm.protocol.messages import Command, Event, Fix, Goal, Message, MissionMessage, Report, Truth
from edc_swarm.recording.reader import read_recording
from processes.cli.main import main

PAGE = Path(__file__).parents[2] / "docs" / "messages.md"
KINDS: dict[type[Struct], str] = {
    Fix: "uav/{id}/fix",
    Command: "head/{head}/command/{id}",
    Report: "head/{head}/report",
    Truth: "uav/{id}/truth",
    Goal: "goal/{source}/to/{id}",
    Event: "event/{source}",
}
INTRODUCTION = """# Messages on the bus

`python -m pytest tests/unit/test_message_reference.py --rewrite` writes this page.

All messages are JSON. Keys begin with `swarm/{mission}/`. Fields that have their default may be absent; readers ignore
fields that they do not know. The key `mission` carries the [mission](mission.md) as run, with the roster filled in, and
`epoch_ns`. [What a recording holds](metrics.md) says when each message is sent, and lists the kinds of events.

The examples are of slot 3 of this mission:

    edc-swarm sim --uavs 2 --planner straight --fault "goal u002 80,40 @3"
"""


def _rounded(value: Any) -> Any:
    """Return what JSON holds, without the last digits of its numbers, in which computers differ."""
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return round(value, 6) if isinstance(value, float) else value


def _example(messages: list[Struct], kind: type[Struct]) -> Struct:
    """Return the first message of a kind of slot 3, or of no slot."""
    return next(each for each in messages if isinstance(each, kind) and getattr(each, "slot", 3) == 3)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the page, with the messages of a mission."""
    out = tmp_path_factory.mktemp("page") / "a.mcap"
    fault = "goal u002 80,40 @3"
    main(["sim", "--uavs", "2", "--planner", "straight", "--fault", fault, "--out", str(out), "--quiet"])
    recording = read_recording(out)
    lists = (
        recording.fixes,
        recording.commands,
        recording.reports,
        recording.truths,
        recording.goals,
        recording.events,
    )
    messages: list[Struct] = [each for found in lists for each in found]
    parts = [INTRODUCTION]
    for kind, key in KINDS.items():
        said = inspect.getdoc(kind)
        text = json.dumps(_rounded(msgspec.to_builtins(_example(messages, kind))), indent=2)
        parts.append(f"\n## {kind.__name__}: `{key}`\n\n{said}\n\n```json\n{text}\n```\n")
    return "".join(parts)


def test_the_page_is_current(page: str, request: pytest.FixtureRequest) -> None:
    """`--rewrite` writes it anew."""
    if request.config.getoption("--rewrite"):
        PAGE.write_text(page, encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == page, f"write it anew: pytest {__file__} --rewrite"


def test_every_kind_is_on_the_page() -> None:
    """Every struct that the bus carries; the mission has a page of its own."""
    assert {*KINDS, MissionMessage} == set(get_args(Message))
