"""Keys and codec: each way in which bytes can be bad."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest

from edc_swarm.errors import MessageError
from edc_swarm.planner.interface import PlanStatus
from edc_swarm.protocol.codec import decode, encode
from edc_swarm.protocol.events import EVENT_FORMS, EventKind
from edc_swarm.protocol.keys import KEY_FORMS, Keys, kind_of, source_of
from edc_swarm.protocol.messages import (
    PLANNED,
    Command,
    Event,
    Fix,
    Message,
    MissionMessage,
    Report,
    Truth,
    roster_index,
)
from tests.builders import command, entry, fix, report

KEYS = Keys("m1")


def _entry(uav: str, **fields: Any) -> dict[str, Any]:
    """A roster entry."""
    places = dict.fromkeys(("start_x_m", "start_y_m", "target_x_m", "target_y_m"), 0.0)
    return {"uav": uav, **places, "r_m": 5.0, "body_m": 1.0, "energy_j": 1.0, **fields}


FIX = fix("a", 3, (0.1, 0.2), x_m=1.0, y_m=2.0)
COMMAND = command("a", 3, (0.0, 0.0), (1.0, 1.0), head="h")
REPORT = report(3, 1, "h", grants=["a", "h"])


def test_keys() -> None:
    """The key expressions that recordings and access control rely on."""
    assert KEYS.of(FIX) == "swarm/m1/uav/a/fix"
    assert KEYS.of(COMMAND) == "swarm/m1/head/h/command/a"
    assert KEYS.of(REPORT) == "swarm/m1/head/h/report"
    assert KEYS.of(Event(source="operator", kind="end")) == "swarm/m1/event/operator"
    assert KEYS.of(MissionMessage(epoch_ns=0)) == "swarm/m1/mission"
    assert (KEYS.truth("a"), KEYS.alive("a", "i")) == ("swarm/m1/uav/a/truth", "swarm/m1/alive/a/i")
    assert (KEYS.all_fixes, KEYS.commands_to("a")) == ("swarm/m1/uav/*/fix", "swarm/m1/head/*/command/a")
    assert (KEYS.all_reports, KEYS.everything) == ("swarm/m1/head/*/report", "swarm/m1/**")


@pytest.mark.parametrize(
    "key",
    ["", "swarm", "swarm/m1", "fix", "uav/a", "uav/a/fix/b", "head/h/command", "swarm/m1/uav/a/b", "viz/a", "alive/a"],
)  # fmt: skip
def test_keys_without_messages(key: str) -> None:
    """Nothing is decoded on a key that has no kind of message."""
    assert kind_of(key) is None
    with pytest.raises(MessageError, match="no message is defined"):
        decode(key, encode(FIX))


@pytest.mark.parametrize("field", ["x_m", "energy_j", "from_x_m"])
@pytest.mark.parametrize("number", [b"1e999", b"-1e999", b"NaN", b"Infinity", b'"1"', b"null"])
def test_numbers_that_are_none(field: str, number: bytes) -> None:
    """JSON has no NaN, but 1e999 would be infinite."""
    raw = msgspec.json.decode(encode(FIX))
    raw[field] = 123456.5
    payload = msgspec.json.encode(raw)
    assert getattr(decode("uav/a/fix", payload), field) == 123456.5
    with pytest.raises(MessageError):
        decode("uav/a/fix", payload.replace(b"123456.5", number))


def test_lists_are_finite_too() -> None:
    """A list, or the roster of a mission, has no infinite number either."""
    raw = encode(msgspec.structs.replace(REPORT, hull_r_m=[1.0, 123456.5])).replace(b"123456.5", b"1e999")
    with pytest.raises(MessageError):
        decode("head/h/report", raw)
    mission = encode(MissionMessage(epoch_ns=0, roster=[entry(start_m=(123456.5, 0.0))])).replace(b"123456.5", b"1e999")
    with pytest.raises(MessageError):
        decode("mission", mission)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("slot", -2),
        ("slot", 1 << 40),
        ("term", -1),
        ("term", 1 << 40),
        ("seq", -1),
        ("seq", 1 << 53),
        ("sent_ns", -1),
        ("sent_ns", 1 << 63),
        ("uav", ""),
        ("uav", "a/b"),
        ("uav", "a*"),
        ("uav", "a\n"),
        ("head", "a\n"),
        ("uav", "x" * 33),
        ("head", "a b"),
        ("instance", "x" * 65),
        ("voter", 1),
        ("slot", 1.5),
    ],
)
def test_limits(field: str, value: object) -> None:
    """Fields out of range or of another type are refused, and the reason names the field."""
    raw = {**msgspec.to_builtins(FIX), field: value}
    with pytest.raises(MessageError, match=field):
        decode("uav/a/fix", msgspec.json.encode(raw))


@pytest.mark.parametrize("name", ["uav", "slot", "x_m", "y_m", "r_m", "waypoint_x_m", "waypoint_y_m"])
def test_required_fields(name: str) -> None:
    """A fix without one of them says nothing."""
    raw = msgspec.to_builtins(FIX)
    del raw[name]
    with pytest.raises(MessageError, match=name):
        decode("uav/a/fix", msgspec.json.encode(raw))


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("swarm/m1/uav/b/fix", FIX),
        ("swarm/m1/head/x/command/a", COMMAND),
        ("swarm/m1/head/h/command/b", COMMAND),
        ("swarm/m1/head/x/report", REPORT),
    ],
)
def test_sender_and_receiver_are_those_in_the_key(key: str, message: Fix | Command | Report) -> None:
    """The key alone decides which sender and receiver a message may name."""
    with pytest.raises(MessageError, match="is not the one in the key"):
        decode(key, encode(message))


@pytest.mark.parametrize(
    "payload", [b"", b"{", b"[]", b"null", b"\xff\xfe", b'"\\ud800"', b"[" * 300_000, b'{"q":' * 100_000]
)
def test_garbage(payload: bytes) -> None:
    """Only `MessageError` comes out, however deep it is nested."""
    with pytest.raises(MessageError):
        decode("uav/a/fix", payload)


def test_the_statuses_of_planners_are_those_of_reports_with_a_plan() -> None:
    """A planner may not know messages, so its words stand in `planner.interface` too; they are the same."""
    assert frozenset(get_args(PlanStatus)) == PLANNED


@pytest.mark.parametrize(
    ("status", "grants", "proof"),
    [
        ("planned", 2, True),
        ("no-qp-needed", 3, True),
        ("failed", 2, True),
        ("planned", 1, False),
        ("no-quorum", 3, False),
        ("claim", 3, False),
    ],
)
def test_what_proves_a_quorum(status: str, grants: int, proof: bool) -> None:
    """Only a report of a plan, with enough grants, does."""
    report = msgspec.structs.replace(REPORT, status=status, grants=["a", "b", "c"][:grants])
    assert report.has_quorum is proof


def _unbounded(kind: Any, where: str) -> list[str]:
    """Fields of a message, at any depth, that are numbers or texts or lists without a limit."""
    node = msgspec.inspect.type_info(kind) if not isinstance(kind, msgspec.inspect.Type) else kind
    match node:
        case msgspec.inspect.StructType():
            return [name for field in node.fields for name in _unbounded(field.type, f"{where}.{field.name}")]
        case msgspec.inspect.ListType():
            return [*([where] if node.max_length is None else []), *_unbounded(node.item_type, f"{where}[]")]
        case msgspec.inspect.FloatType() | msgspec.inspect.IntType():
            limits = [(node.ge, node.gt), (node.le, node.lt)]
            return [where] if any(pair == (None, None) for pair in limits) else []
        case msgspec.inspect.StrType():
            return [where] if node.max_length is None and node.pattern is None else []
        case _:
            return []


@pytest.mark.parametrize("kind", [Fix, Truth, Command, Report, Event, MissionMessage])
def test_everything_in_a_message_has_a_limit(kind: type[msgspec.Struct]) -> None:
    """Hence no infinity passes, no product of two numbers overflows, and no list is endless."""
    assert _unbounded(kind, kind.__name__) == []


@pytest.mark.parametrize(
    "changes",
    [
        {"roster": []},
        {"max_slots": 0},
        {"tau_s": 0.0},
        {"tau_s": 0.6},
        {"name": "m2"},
        {"fault": ["kill zz @3"]},
        {"fault": ["nonsense"]},
        {"link": [{"sender": "zz"}]},
        {"roster": [_entry("a"), _entry("a")]},
        {"roster": [_entry("a"), _entry("b", start_x_m=1.0)]},
        {"roster": [_entry("operator")]},
        {"claimants": ["mallory"]},
        {"claimants": ["0123456789abcdef", ""]},
    ],
)
def test_a_mission_that_no_file_could_describe_is_refused(changes: dict[str, Any]) -> None:
    """From the bus as from a file; and another mission's is not this one's."""
    whole = {"name": "m1", "uavs": 1, "roster": [_entry("a")], "tau_s": 0.2, "max_slots": 9, "epoch_ns": 0}
    assert decode(KEYS.mission, msgspec.json.encode(whole)) is not None
    changed = {**whole, **changes}
    with pytest.raises(MessageError):
        decode(KEYS.mission, msgspec.json.encode({**changed, "uavs": len(changed["roster"])}))


@pytest.mark.parametrize("mission", ["*", "**", "m1/x", "a b", "x" * 65, ""])
def test_keys_that_stand_for_many_are_no_missions(mission: str) -> None:
    """A put on `swarm/*/uav/a/fix` reaches every subscriber, and nobody believes it."""
    assert kind_of(f"swarm/{mission}/uav/a/fix") is None


def test_roster_index() -> None:
    """Positions in roster order, by id."""
    assert roster_index([entry("z"), entry("a")]) == {"z": 0, "a": 1}


@pytest.mark.parametrize("kind", get_args(Message))
def test_the_table_of_keys_has_every_kind_once(kind: type) -> None:
    """A key that the table builds is parsed back to its kind and its publisher; no other kind has such a key."""
    form, values = KEY_FORMS[kind], [f"u{index}" for index in range(len(KEY_FORMS[kind].fields))]
    key = f"swarm/m/{form.form.format(*values)}"
    assert kind_of(key) is kind
    assert source_of(key) == dict(zip(form.fields, values, strict=True)).get(form.sender, form.sender)
    assert set(form.fields) <= set(kind.__struct_fields__)


def test_every_kind_of_event_is_documented() -> None:
    """The table in docs/metrics.md is the table in the code."""
    text = Path(__file__).parents[2].joinpath("docs/metrics.md").read_text(encoding="utf-8")
    assert EVENT_FORMS.keys() == set(EventKind)
    for kind, form in EVENT_FORMS.items():
        assert f"| `{kind}` | {form.sender} | {form.detail} |\n" in text
