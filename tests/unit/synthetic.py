"""A small, faultless mission as messages, in which tests plant one fault."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from edc_swarm.mission.roster_entry import RosterEntry
from edc_swarm.protocol.messages import Command, Event, Fix, Message, MissionMessage, Report, Truth
from edc_swarm.recording.model import Recording

EPOCH_NS = 1_800_000_000_000_000_000
SLOT_NS = 500_000_000
OFFSET_M = (0.5, -0.25)
Path = Sequence[tuple[float, float]]


def straight(start: tuple[float, float], end: tuple[float, float], steps: int, wait: int = 1) -> Path:
    """Return points at slot ends: `wait` slots at the start, then equal steps to the end."""
    (ax, ay), (bx, by) = start, end
    moving = [(ax + (bx - ax) * i / steps, ay + (by - ay) * i / steps) for i in range(1, steps + 1)]
    return [start] * wait + moving


def parallel(uavs: int = 3, steps: int = 8) -> list[Path]:
    """Return paths of UAVs 12 m apart that fly 2 m north per slot from slot 1 on."""
    return [straight((12.0 * k, 0.0), (12.0 * k, 2.0 * steps), steps) for k in range(uavs)]


def mission_of(paths: Sequence[Path], **fields: Any) -> MissionMessage:
    """Return the mission whose UAVs u0, u1, ... follow `paths` (r 5 m, body 0.25 m by default)."""
    roster = [
        RosterEntry(
            uav=f"u{k}",
            start_x_m=path[0][0],
            start_y_m=path[0][1],
            target_x_m=path[-1][0],
            target_y_m=path[-1][1],
            r_m=5.0,
            body_m=0.25,
            energy_j=5e4,
        )
        for k, path in enumerate(paths)
    ]
    defaults = {"roster": roster, "uavs": len(roster), "epoch_ns": EPOCH_NS, "tau_s": 0.2, "max_slots": 300}
    return MissionMessage(**{**defaults, **fields})


def flight(paths: Sequence[Path], head: str = "u0", term: int = 1, **fields: Any) -> list[Message]:
    """Return all messages of a mission in which one head leads from slot 0 on and nothing fails."""
    mission = mission_of(paths, **fields)
    messages: list[Message] = [mission]
    flown: dict[tuple[int, int], Command] = {}
    for slot in range(max(map(len, paths))):
        began_ns = EPOCH_NS + slot * SLOT_NS
        for k, path in enumerate(paths):
            messages += _moves(k, path, slot, began_ns, flown.get((k, slot)), (term, head))
        commands = [_command(k, path, slot, began_ns, (term, head)) for k, path in enumerate(paths)]
        flown.update({(k, slot + 1): command for k, command in enumerate(commands)})
        messages += commands
        messages.append(_report(mission, slot, began_ns, (term, head)))
    return [*messages, *_closed(messages)]


def at(path: Path, slot: int) -> tuple[float, float]:
    """Return the position of a UAV at the end of a slot."""
    return path[min(max(slot, 0), len(path) - 1)]


def _moves(
    k: int, path: Path, slot: int, began_ns: int, command: Command | None, grant: tuple[int, str]
) -> list[Message]:
    (fx, fy), (wx, wy) = at(path, slot - 1), at(path, slot)
    target_m = path[-1]
    common: dict[str, Any] = {"uav": f"u{k}", "instance": f"i{k}", "seq": slot, "slot": slot}
    fix = Fix(
        **common,
        sent_ns=began_ns + 2_000_000,
        x_m=wx,
        y_m=wy,
        r_m=5.0,
        waypoint_x_m=wx,
        waypoint_y_m=wy,
        from_x_m=fx,
        from_y_m=fy,
        executing=command is not None,
        command_term=command.term if command else -1,
        command_seq=command.seq if command else -1,
        arrived=math.dist((wx, wy), target_m) <= 0.1,
        term=grant[0],
        head=grant[1],
        energy_j=5e4 - 70 * slot,
    )
    ox, oy = OFFSET_M
    truth = Truth(
        **common,
        sent_ns=began_ns + 1_000_000,
        from_x_m=fx + ox,
        from_y_m=fy + oy,
        to_x_m=wx + ox,
        to_y_m=wy + oy,
    )
    return [truth, fix]


def _command(k: int, path: Path, slot: int, began_ns: int, grant: tuple[int, str]) -> Command:
    (sx, sy), (tx, ty) = at(path, slot), at(path, slot + 1)
    return Command(
        head=grant[1],
        uav=f"u{k}",
        instance="i0",
        seq=slot,
        sent_ns=began_ns + 12_000_000,
        slot=slot + 1,
        term=grant[0],
        start_x_m=sx,
        start_y_m=sy,
        target_x_m=tx,
        target_y_m=ty,
        fix_seq=slot,
    )


def _report(mission: MissionMessage, slot: int, began_ns: int, grant: tuple[int, str]) -> Report:
    ids = [entry.uav for entry in mission.roster]
    return Report(
        head=grant[1],
        instance="i0",
        seq=slot,
        sent_ns=began_ns + 13_000_000,
        slot=slot,
        term=grant[0],
        planner=mission.planner,
        status="planned",
        heard=ids,
        grants=ids,
        quorum=mission.quorum,
        plan_ms=2.0 + slot,
    )


def _closed(messages: Iterable[Message]) -> list[Event]:
    """Return the `closed` events of all publishers."""
    tails: dict[str, dict[str, int]] = {}
    for message in messages:
        match message:
            case Fix():
                tails.setdefault(message.instance, {})[f"uav/{message.uav}/fix"] = message.seq
            case Truth():
                tails.setdefault(message.instance, {})[f"uav/{message.uav}/truth"] = message.seq
            case Command():
                tails.setdefault(message.instance, {})[f"head/{message.head}/command/{message.uav}"] = message.seq
            case Report():
                tails.setdefault(message.instance, {})[f"head/{message.head}/report"] = message.seq
            case MissionMessage():
                tails.setdefault("", {})["mission"] = message.seq
    return [
        Event(
            source=instance.rstrip("b").replace("i", "u") or "operator",
            instance=instance,
            sent_ns=EPOCH_NS + 1000 * SLOT_NS,
            kind="closed",
            detail=msgspec.json.encode(keys).decode(),
        )
        for instance, keys in tails.items()
    ]


def close(messages: list[Message]) -> None:
    """Add the missing `closed` events of all publishers, as the messages stand."""
    said = {message.instance for message in messages if isinstance(message, Event) and message.kind == "closed"}
    messages += [event for event in _closed(messages) if event.instance not in said]


def whole(messages: Iterable[Message]) -> list[Message]:
    """Return `messages` numbered as if nothing else had been said, with the last words that fit."""
    said = [m for m in messages if not (isinstance(m, Event) and m.kind == "closed")]
    counts: dict[tuple[Any, ...], int] = {}
    numbers: dict[tuple[Any, ...], int] = {}
    for message in said:
        stream = (type(message), message.instance, getattr(message, "uav", ""), getattr(message, "source", ""))
        numbers[*stream, message.seq] = counts[stream] = counts.get(stream, -1) + 1
    heads = {command.term: command.instance for command in said if isinstance(command, Command)}
    instances = {fix.uav: fix.instance for fix in said if isinstance(fix, Fix)}
    renumbered: list[Message] = []
    for message in said:
        stream = (type(message), message.instance, getattr(message, "uav", ""), getattr(message, "source", ""))
        fields: dict[str, int] = {"seq": numbers[*stream, message.seq]}
        if isinstance(message, Fix) and message.command_seq >= 0:
            ordered = (Command, heads.get(message.command_term, ""), message.uav, "", message.command_seq)
            fields["command_seq"] = numbers.get(ordered, message.command_seq)
        if isinstance(message, Command):
            counted = (Fix, instances.get(message.uav, ""), message.uav, "", message.fix_seq)
            fields["fix_seq"] = numbers.get(counted, message.fix_seq)
        renumbered.append(msgspec.structs.replace(message, **fields))
    return [*renumbered, *_closed(renumbered)]


def change(messages: list[Message], match: dict[str, Any], kind: type, **fields: Any) -> int:
    """Replace fields of every message of `kind` whose fields equal `match`; return the number of messages changed."""
    hits = 0
    for i, message in enumerate(messages):
        if type(message) is kind and all(getattr(message, name) == value for name, value in match.items()):
            messages[i] = msgspec.structs.replace(message, **fields)
            hits += 1
    return hits


def recorded(messages: Iterable[Message]) -> Recording:
    """Return the recording of `messages`."""
    return Recording.from_messages(messages)
