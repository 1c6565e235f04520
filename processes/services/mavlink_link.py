"""The UDP link to a ground station: MAVLink messages out, requests in.

pymavlink is optional (`pip install edc-swarm[mavlink]`); only this module imports it, and only for `--mavlink`.
"""

from __future__ import annotations

import os
import re
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from edc_swarm.errors import InputError
from edc_swarm.extras import has_package, install_command
from edc_swarm.ground_station.frames import Frame, Request

FORM = "udp:HOST:PORT"
COMPONENT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
MAX_DATAGRAM = 65_536
MAX_REQUESTS = 200
"""Most requests of one datagram; more are counted and dropped."""
MAX_REQUESTS_A_SECOND = 1_000
"""The same of one second: a ground station that reads the missions of 250 UAVs asks less often."""


def ground_address(text: str) -> tuple[str, int]:
    """Return host and port of a ground station.

    Raises
    ------
    InputError
        The text is no such address, the host is unknown, or pymavlink is not installed.
    """
    found = re.fullmatch(r"udp:(\[[0-9a-fA-F:]+\]|[A-Za-z0-9._-]+):(\d{1,5})", text)
    if found is None or not 0 < int(found[2]) < 65536:
        raise InputError("--mavlink", text, f"{FORM}, such as udp:127.0.0.1:14550")
    if not has_package("pymavlink"):
        raise InputError("--mavlink", text, f"absent, or pymavlink installed: {install_command('mavlink')}")
    host, port = found[1].strip("[]"), int(found[2])
    try:
        socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise InputError("--mavlink", text, f"{FORM} with a host that is known ({error.strerror})") from None
    return host, port


class MavlinkLink:
    """A socket that sends every UAV's messages to one ground station, and hands over its requests.

    Attributes
    ----------
    dropped
        What was not sent or not understood, by reason.
    """

    def __init__(self, host: str, port: int) -> None:
        os.environ["MAVLINK20"] = "1"
        from pymavlink.dialects.v20 import common  # noqa: PLC0415  (optional)

        self._dialect: Any = common
        self._address: tuple[Any, ...]
        family, _, _, _, self._address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.bind(("", 0))
        self._systems: dict[int, Any] = {}
        self._second, self._heard = 0, 0
        self.dropped: Counter[str] = Counter()

    def send(self, frames: list[Frame]) -> None:
        """Send messages; a datagram that the host cannot send is counted and dropped."""
        for frame in frames:
            mav = self._systems.get(frame.system)
            if mav is None:
                mav = self._systems[frame.system] = self._dialect.MAVLink(None, frame.system, COMPONENT)
            message = getattr(self._dialect, f"MAVLink_{frame.name}_message")(**frame.fields)
            try:
                self._socket.sendto(message.pack(mav), self._address)
            except OSError as error:
                self.dropped[f"not sent: {error.strerror}"] += 1
            mav.seq = (mav.seq + 1) % 256

    def listen(self, hand_over: Callable[[Request], None]) -> None:
        """Hand over each request of the ground station, from a thread of its own, until the link is closed."""
        threading.Thread(target=self._listen, args=(hand_over,), name="mavlink", daemon=True).start()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _listen(self, hand_over: Callable[[Request], None]) -> None:
        while True:
            try:
                datagram, sender = self._socket.recvfrom(MAX_DATAGRAM)
            except ConnectionRefusedError:
                continue  # Nobody listens there yet: the host said so to the socket.
            except OSError:
                return
            if sender[:2] != self._address[:2]:
                self.dropped["from a stranger"] += 1
                continue
            for request in self.requests(datagram):
                if self._has_room(int(time.monotonic())):
                    hand_over(request)

    def _has_room(self, second: int) -> bool:
        """Count a request of a second; return False, and count it as dropped, if there are too many."""
        if second != self._second:
            self._second, self._heard = second, 0
        self._heard += 1
        if self._heard > MAX_REQUESTS_A_SECOND:
            self.dropped["too many in one second"] += 1
            return False
        return True

    def requests(self, datagram: bytes) -> list[Request]:
        """Return the requests in a datagram; what is no MAVLink is counted."""
        parser = self._dialect.MAVLink(None)
        parser.robust_parsing = True
        found: list[Request] = []
        for message in parser.parse_buffer(datagram) or []:
            if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN"):
                self.dropped["not MAVLink"] += 1
            elif len(found) >= MAX_REQUESTS:
                self.dropped["too many in one datagram"] += 1
            else:
                found.append(_request(message))
        return found


def _request(message: Any) -> Request:
    fields = {name: getattr(message, name) for name in message.get_fieldnames()}
    return Request(
        sender=message.get_srcSystem(),
        component=message.get_srcComponent(),
        system=int(fields.get("target_system", -1)),
        name=message.get_type().lower(),
        fields=fields,
    )
