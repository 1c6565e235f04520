"""A ground station that this project did not write, MAVSDK: `python mavsdk_client.py PORT SYSTEMS SECONDS [arm|steer]`.

It waits for the systems, reads each mission and fence, listens for the given time, and prints what it saw as JSON. With
`arm` it tries to arm the first UAV and to send it somewhere. With `steer` it pauses the first UAV's mission and starts
it again, sends the second UAV to a place, and lands the third.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission import Mission
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.telemetry import Telemetry


def tries(found: dict[int, Any], what: str, positions: list[Any]) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what the client tries, by name."""
    action = Action(found[1])
    if what == "arm":
        yield from (("arm", action.arm), ("takeoff", action.takeoff), ("land", action.land))
    if what == "steer":
        mission = Mission(found[1])
        yield "pause", mission.pause_mission
        time.sleep(1.5)
        yield "start", mission.start_mission
        lat_deg, lon_deg = positions[-1]
        yield "goto", lambda: Action(found[2]).goto_location(lat_deg, lon_deg, 10.0, math.nan)
        yield "land", Action(found[3]).land


def main(port: int, systems: int, seconds: float, what: str) -> dict[str, Any]:
    """Return what the client saw of each system, the texts, and the answers to what it tried."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    print("ready", file=sys.stderr, flush=True)
    until_s = time.monotonic() + 60
    found: dict[int, Any] = {}
    while len(found) < systems and time.monotonic() < until_s:
        found = {system.get_system_id(): system for system in mavsdk.get_systems() if system.has_autopilot()}
        time.sleep(0.05)
    seen: dict[int, dict[str, Any]] = {}
    texts: list[str] = []
    for number, system in sorted(found.items()):
        about = seen[number] = {"positions": [], "battery": []}
        telemetry = about["telemetry"] = Telemetry(system)
        telemetry.subscribe_position(
            lambda at, *_, about=about: about["positions"].append([at.latitude_deg, at.longitude_deg])
        )
        telemetry.subscribe_battery(lambda at, *_, about=about: about["battery"].append(at.remaining_percent))
        telemetry.subscribe_status_text(lambda said, *_: texts.append(said.text))
    for number, system in sorted(found.items()):
        raw = MissionRaw(system)
        mission, fence = raw.download_mission(), raw.download_geofence()
        seen[number]["mission"] = [[item.command, item.x, item.y, item.param1, item.param2] for item in mission]
        seen[number]["fence"] = [[item.command, item.x, item.y, item.param1] for item in fence]
    tried: dict[str, str] = {}
    for name, act in tries(found, what, seen[2]["positions"] if 2 in seen else []):
        try:
            tried[name] = str(act())
        except Exception as error:  # noqa: BLE001 - the client reports a refusal in its own way
            tried[name] = f"{type(error).__name__}: {error}"
    time.sleep(seconds)
    for about in seen.values():
        del about["telemetry"]
    return {"systems": seen, "texts": texts, "tried": tried}


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), [*sys.argv, ""][4])), flush=True)
    sys.stdout.flush()
