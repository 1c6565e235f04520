"""The recorder under load: K UAVs at F slots a second that all publish at the start of a slot.

Publishers with one session per UAV send, in phase, the messages of a swarm in a slot: fix and truth of every UAV, then
a command for each and a report. The script prints the sequence gaps and the recorder's share of one processor, start
and end included.

    python benchmarks/recorder.py [--uavs 50] [--hz 20] [--seconds 20]
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.events import EventKind
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Command, Event, Fix, MissionMessage, Report, Truth, mission_message
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from processes.bus.address import free_endpoint
from processes.bus.session import open_client, put
from processes.services.recorder_settings import RecorderSettings

MISSION = "bench"
SESSIONS = 10


def publish(endpoint: str, uavs: list[str], everyone: list[str], start_s: float, slots: int, slot_s: float) -> None:
    keys = Keys(MISSION)
    sessions = {uav: open_client(endpoint) for uav in uavs}
    for slot in range(slots):
        time.sleep(max(0.0, start_s + slot * slot_s - time.time()))
        for uav, session in sessions.items():
            common: dict[str, Any] = {"uav": uav, "instance": uav, "seq": slot, "sent_ns": time.time_ns(), "slot": slot}
            put(session, keys.truth(uav), encode(Truth(**common, from_x_m=1.5, from_y_m=2.5, to_x_m=3.5, to_y_m=4.5)))
            fix = Fix(**common, x_m=17.123456, y_m=3.987654, r_m=5.0, waypoint_x_m=17.0, waypoint_y_m=3.0, term=1)
            put(session, keys.fix(uav), encode(fix))
        if everyone[0] in sessions:
            lead(sessions[everyone[0]], keys, everyone, slot)
    for uav, session in sessions.items():
        tails = {keys.fix(uav): slots - 1, keys.truth(uav): slots - 1}
        detail = msgspec.json.encode(tails).decode()
        put(session, keys.event(uav), encode(Event(source=uav, instance=uav, kind=EventKind.CLOSED, detail=detail)))
    time.sleep(1.0)
    for session in sessions.values():
        session.close()


def lead(session: zenoh.Session, keys: Keys, everyone: list[str], slot: int) -> None:
    head = everyone[0]
    for uav in everyone:
        common: dict[str, Any] = {
            "head": head,
            "uav": uav,
            "instance": head,
            "seq": slot,
            "sent_ns": time.time_ns(),
            "slot": slot + 1,
        }
        where: dict[str, Any] = {"start_x_m": 17.123456, "start_y_m": 3.5, "target_x_m": 18.654321, "target_y_m": 4.5}
        put(session, keys.command(head, uav), encode(Command(**common, **where, term=1)))
    report = Report(head=head, instance=head, seq=slot, slot=slot, term=1, status="planned", heard=everyone, quorum=26)
    put(session, keys.report(head), encode(report))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--uavs", type=int, default=50)
    parser.add_argument("--hz", type=float, default=20.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    mission = mission_message(complete_mission(mission_from_dict({"uavs": options.uavs, "area_m2": 40_000.0})))
    everyone = [entry.uav for entry in mission.roster]
    with tempfile.TemporaryDirectory() as folder:
        measure(options, Path(folder), msgspec.structs.replace(mission, name=MISSION), everyone)


def measure(options: argparse.Namespace, folder: Path, mission: MissionMessage, everyone: list[str]) -> None:
    endpoint, part, out = free_endpoint(), folder / "run.mcap.part", folder / "run.mcap"
    part.touch()
    router = subprocess.Popen([sys.executable, "-m", "processes.services.router", endpoint], stdout=subprocess.PIPE)
    assert router.stdout is not None
    router.stdout.readline()
    settings = RecorderSettings(endpoint=endpoint, mission=MISSION, part=str(part), out=str(out), run={})
    recorder = subprocess.Popen([sys.executable, "-m", "processes.services.recorder"], stdin=subprocess.PIPE)
    assert recorder.stdin is not None
    recorder.stdin.write(msgspec.json.encode(settings))
    recorder.stdin.close()
    operator = open_client(endpoint)
    time.sleep(2.0)
    put(operator, Keys(MISSION).mission, encode(mission))
    slots, start_s = round(options.seconds * options.hz), time.time() + 3.0
    workers = [
        multiprocessing.get_context("spawn").Process(
            target=publish, args=(endpoint, everyone[i : i + SESSIONS], everyone, start_s, slots, 1 / options.hz)
        )
        for i in range(0, len(everyone), SESSIONS)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    last = Event(source="operator", instance="operator", kind=EventKind.CLOSED, detail="{}")
    put(operator, Keys(MISSION).event("operator"), encode(last))
    recorder.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    operator.close()
    router.terminate()
    router.wait()
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    recording = read_recording(out)
    lost = sum(gap.count for gap in find_gaps(recording) if not gap.duplicate)
    per_s = recording.message_count / options.seconds
    print(f"{len(everyone)} UAVs at {options.hz:g} Hz for {options.seconds:g} s: {recording.message_count} messages")
    print(f"{per_s:.0f} messages/s, {lost} missing, run_end {recording.run_end}")
    print(f"recorder: {cpu_s:.2f} s of processor time, {100 * cpu_s / options.seconds:.1f} % of one core")
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
