"""A rogue on a secured bus: a process of its own that prints its actions and the messages that it heard, as JSON.

python -m tests.processes.rogue ENDPOINT FOLDER NAME RECORDING

It reads the mission from the recording, so a rogue that hears nothing can forge as well as one that hears all.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from edc_swarm.mission.roles import JOIN
from edc_swarm.protocol.claims import IdClaim
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, Message, Report, Status, Truth
from edc_swarm.protocol.retransmission import Ask, Span
from edc_swarm.protocol.retransmission import encode as encode_ask
from edc_swarm.recording.reader import read_recording
from processes.bus.credentials import Credentials
from processes.bus.session import hand_over, open_client, put

INSTANCE = "rogue"
CLAIMANT = "0" * 16
TERM = 50
LISTENS_S = 2.0


def main() -> int:
    """Misbehave in the name of `NAME` in every known way."""
    endpoint, folder, name, recorded = sys.argv[1:]
    try:
        session = open_client(endpoint, Credentials(Path(folder), name), timeout_ms=1500)
    except zenoh.ZError as error:
        print(json.dumps({"connected": False, "why": str(error)}))
        return 0
    recording = read_recording(Path(recorded), salvage=True)
    mission = recording.mission.name
    keys, heard = Keys(mission), Counter[str]()
    newest = {fix.uav: fix for fix in recording.fixes}

    def take(sample: zenoh.Sample) -> None:
        _hear(sample, heard, newest)

    def take_again(reply: zenoh.Reply) -> None:
        heard.update([f"reply {reply.ok.key_expr}" if reply.ok else "error"])

    def take_claim(reply: zenoh.Reply) -> None:
        heard.update(["claim answered"] if reply.ok else [])

    for key in (keys.all_fixes, keys.commands_to("u001"), keys.truth("*"), f"{keys.root}/**", "swarm/**", "**"):
        session.declare_subscriber(key, hand_over(take), allowed_origin=zenoh.Locality.REMOTE)
    again = encode_ask(Ask([Span(keys.command("u001", uav), 0, 9) for uav in ("u001", "u002", "u003")]))
    for key in (keys.mission, f"{keys.root}/**", keys.again("u001", "*"), keys.again("*", "*")):
        session.get(key, hand_over(take_again), payload=again)
    time.sleep(LISTENS_S)
    stolen = [session.liveliness().declare_token(keys.alive(who, f"{INSTANCE}-{name}")) for who in ("u001", JOIN)]
    claim = msgspec.json.encode(IdClaim(claimant=CLAIMANT, uavs=1, among=["u001"]))
    session.get(keys.claims, hand_over(take_claim), payload=claim)
    for message in _forged(newest, "u001"):
        put(session, keys.of(message), encode(message))
        put(session, keys.of(message).replace(mission, "*"), encode(message))
    put(session, f"{keys.root}/uav/*/fix", encode(newest["u003"]))
    put(session, f"{keys.root}/**", b"{}")
    session.delete(keys.fix("u001"))
    for message in _claims(newest, name):
        put(session, keys.of(message), encode(message))
    time.sleep(1.0)
    del stolen
    session.close()
    print(json.dumps({"connected": True, "heard": heard}))
    return 0


def _hear(sample: zenoh.Sample, heard: Counter[str], newest: dict[str, Fix]) -> None:
    key = str(sample.key_expr)
    heard["/".join(key.split("/")[2::2])] += 1
    if key.endswith("/fix"):
        fix = msgspec.json.decode(sample.payload.to_bytes(), type=Fix)
        newest[fix.uav] = fix


def _forged(newest: dict[str, Fix], victim: str) -> list[Message]:
    """Return messages that only the victim, its head, or the operator may publish."""
    now: dict[str, Any] = {"instance": INSTANCE, "slot": newest[victim].slot, "sent_ns": time.time_ns()}
    return [
        msgspec.structs.replace(newest[victim], instance=INSTANCE, term=TERM, waypoint_x_m=1.0),
        Truth(uav=victim, from_x_m=0.0, from_y_m=0.0, to_x_m=9.0, to_y_m=9.0, **now),
        *_commands(newest, victim),
        Report(head=victim, term=TERM, status="planned", grants=sorted(newest), quorum=3, **now),
        Event(source=victim, kind="closed", detail="{}", **now),
        Event(source="operator", kind="end", **now),
    ]


def _claims(newest: dict[str, Fix], name: str) -> list[Message]:
    """Return messages of the rogue as a head under its own id, without a quorum."""
    messages: list[Message] = []
    slot = max(fix.slot for fix in newest.values())
    statuses: tuple[Status, ...] = ("planned", "claim", "no-qp-needed")
    for seq, (status, quorum) in enumerate((s, q) for s in statuses for q in (1, 3)):
        report = Report(head=name, term=TERM, status=status, grants=[name], quorum=quorum, slot=slot)
        messages.append(msgspec.structs.replace(report, instance=INSTANCE, seq=seq, sent_ns=time.time_ns()))
    return messages + _commands(newest, name)


def _commands(newest: dict[str, Fix], head: str) -> list[Message]:
    """Return commands to every UAV for the next slots, from its position, of its granted term and of a new one."""
    return [
        Command(
            head=head,
            uav=fix.uav,
            instance=INSTANCE,
            seq=seq,
            sent_ns=time.time_ns() + (slots - 1) * 500_000_000,
            slot=fix.slot + slots,
            term=term,
            start_x_m=fix.waypoint_x_m,
            start_y_m=fix.waypoint_y_m,
            target_x_m=fix.waypoint_x_m + 1.0,
            target_y_m=fix.waypoint_y_m,
        )
        for fix in newest.values()
        for seq, (slots, term) in enumerate((s, t) for s in (1, 2, 3) for t in (fix.term, TERM))
    ]


if __name__ == "__main__":
    sys.exit(main())
