"""The link to one autopilot: a thread that reads its messages and sends what its pilot says, in time.

pymavlink is optional (`pip install edc-swarm[mavlink]`); of UAV processes only those with an autopilot import it. Its
connections cover UDP, TCP and serial devices.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from edc_swarm.autopilot.failsafes import OWN_SYSTEM
from edc_swarm.autopilot.pilot import Pilot, Said
from edc_swarm.errors import InputError
from edc_swarm.extras import has_package, install_command

OWN_COMPONENT = 190
"""MAV_COMP_ID_MISSIONPLANNER, a ground station."""
MAVLINK_1 = 0xFE
"""First byte of a frame of MAVLink 1."""
LEAST_TURN_S, MOST_TURN_S = 0.002, 0.05
"""Shortest and longest wait of the thread."""
MAX_MESSAGES = 500
"""Most messages that are read in one turn; the rest waits for the next one."""
MAX_ADDRESSES = 8
"""Most addresses that one UDP port is answered to; pymavlink sends each set-point to all that it has heard."""
DEFAULT_BAUD = 57_600


def check_package(address: str) -> None:
    """Raise `InputError` if pymavlink is not installed."""
    if not has_package("pymavlink"):
        raise InputError("vehicle.autopilot", address, f"absent, or pymavlink installed: {install_command('mavlink')}")


def load() -> Any:
    """Return pymavlink's module of connections, set to MAVLink 2 and ArduPilot's dialect, which has all of `common`."""
    os.environ["MAVLINK20"] = "1"
    os.environ["MAVLINK_DIALECT"] = "ardupilotmega"
    from pymavlink import mavutil  # noqa: PLC0415  (optional)

    return mavutil


def _connection(address: str) -> Any:
    device, _, baud = address.partition(",")
    try:
        return load().mavlink_connection(
            device,
            baud=int(baud or DEFAULT_BAUD),
            source_system=OWN_SYSTEM,
            source_component=OWN_COMPONENT,
            autoreconnect=True,
            retries=1,
        )
    except Exception as error:  # noqa: BLE001  (pymavlink raises what its transports raise)
        why = str(error) or type(error).__name__
        raise InputError("vehicle.autopilot", address, f"an address that can be opened ({why})") from None


class AutopilotLink:
    """A connection to one autopilot, and the thread that flies it.

    Parameters
    ----------
    now_ns
        The mission's clock.
    tell
        Function that takes the pilot's news, on the thread of the link.

    Attributes
    ----------
    heard
        Pieces by kind: "messages", "bad" (no MAVLink), "unknown" (of another dialect), "stranger" (from one sender too
        many), "errors", "not sent".
    """

    def __init__(
        self, address: str, pilot: Pilot, now_ns: Callable[[], int], tell: Callable[[Said], None] = lambda _: None
    ) -> None:
        self._pilot = pilot
        self._now_ns = now_ns
        self._tell = tell
        self._orders: list[str] = []
        self._over = threading.Event()
        self._connection = _connection(address)
        self.heard: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._run, name="autopilot", daemon=True)
        self._thread.start()

    def tell_to(self, tell: Callable[[Said], None]) -> None:
        """Give the news to another function from now on."""
        self._tell = tell

    def land(self) -> None:
        """Let the pilot land, from the next turn of the thread on."""
        self._orders.append("land")

    def close(self) -> None:
        """End the thread and close the connection."""
        self._over.set()
        self._thread.join(timeout=1.0)
        self._connection.close()

    def _run(self) -> None:
        while not self._over.is_set():
            self._wait()
            self._read()
            now_ns = self._now_ns()
            if self._orders:
                self._orders.clear()
                self._pilot.land(now_ns)
            for name, fields in self._pilot.advance(now_ns):
                self._send(name, fields)
            for said in self._pilot.take_news():
                self._tell(said)

    def _wait(self) -> None:
        """Wait for bytes, or until a set-point is due."""
        turn_s = min(max(self._pilot.due_in_s(self._now_ns()), LEAST_TURN_S), MOST_TURN_S)
        file = self._connection.fd if isinstance(self._connection.fd, int) else None
        if file is None:
            time.sleep(turn_s)
            return
        try:
            select.select([file], [], [], turn_s)
        except (OSError, ValueError):
            time.sleep(turn_s)

    def _read(self) -> None:
        for _ in range(MAX_MESSAGES):
            try:
                message = self._connection.recv_msg()
            except OSError:
                self.heard["errors"] += 1
                return
            if message is None:
                return
            self._forget_senders()
            name = message.get_type()
            if name == "BAD_DATA" or name.startswith("UNKNOWN"):
                self.heard["bad" if name == "BAD_DATA" else "unknown"] += 1
                continue
            self.heard["messages"] += 1
            sender = message.get_srcSystem(), message.get_srcComponent()
            if sender[0] != OWN_SYSTEM:
                version = 1 if message.get_msgbuf()[0] == MAVLINK_1 else 2
                self._pilot.telemetry.hear(
                    name, message.to_dict(), sender, self._now_ns(), number=message.get_seq(), version=version
                )

    def _forget_senders(self) -> None:
        """Keep the oldest senders alone, if too many send to the port: the autopilot is one that was there before."""
        senders = getattr(self._connection, "clients_last_alive", {})
        for sender in list(senders)[MAX_ADDRESSES:]:
            del senders[sender]
            self._connection.clients.discard(sender)
            self.heard["stranger"] += 1

    @property
    def complaints(self) -> str:
        """Numbers of pieces and messages that came and are of no autopilot, in words; "" if there are none."""
        kinds = {"bad": "pieces that are no MAVLink", "unknown": "messages of another dialect", "stranger": "strangers"}
        return ", ".join(f"{self.heard[kind]} {words}" for kind, words in kinds.items() if self.heard[kind])

    def _send(self, name: str, fields: Any) -> None:
        target = self._pilot.telemetry.system
        values = dict(fields)
        if name != "heartbeat":
            if target is None:
                return
            values |= {"target_system": target[0], "target_component": target[1]}
        try:
            getattr(self._connection.mav, f"{name}_send")(**values)
        except OSError:
            self.heard["not sent"] += 1
