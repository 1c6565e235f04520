"""Traffic between two hosts: what crosses the link if the second host has a router of its own, and if it has none.

    sudo python benchmarks/host_links.py

Each host is a network namespace (Linux, root, iproute2). Cluster a of `scenarios/crossing_clusters.toml` flies on the
first one, cluster b on the second. Bytes are those of the link's device, headers included, in a mission from start to
end; *per slot*: divided by the slots flown.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SCENARIO = Path(__file__).parents[1] / "scenarios" / "crossing_clusters.toml"
HERE, THERE = f"edc{os.getpid()}-a", f"edc{os.getpid()}-b"
ADDRESS = "tcp/10.78.0.1:7447"
EDC = (sys.executable, "-m", "processes.cli.main")


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


@contextmanager
def two_hosts() -> Iterator[None]:
    """Make two hosts with a link between them."""
    try:
        for name in (HERE, THERE):
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
        ip("-n", HERE, "link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", THERE)
        for name, host in ((HERE, 1), (THERE, 2)):
            ip("-n", name, "addr", "add", f"10.78.0.{host}/24", "dev", "eth0")
            ip("-n", name, "link", "set", "eth0", "up")
        yield
    finally:
        for name in (HERE, THERE):
            subprocess.run(["ip", "netns", "del", name], check=False)


def crossed_bytes() -> tuple[int, int]:
    """Return the bytes that the first host has received and sent on the link."""
    said = subprocess.check_output(["ip", "-n", HERE, "-s", "-j", "link", "show", "eth0"])
    counted = json.loads(said)[0]["stats64"]
    return counted["rx"]["bytes"], counted["tx"]["bytes"]


def fly(*options: str) -> tuple[float, float]:
    """Fly the mission; return the kB per slot that the first host receives from the second one, and sends to it."""
    with tempfile.TemporaryDirectory() as folder, two_hosts():
        out = ("--out", f"{folder}/a.mcap", "--json", "--no-viz")
        run = subprocess.Popen(
            ["ip", "netns", "exec", HERE, *EDC, "run", str(SCENARIO), "--remote", "4", "--listen", ADDRESS, *out],
            stdout=subprocess.PIPE,
        )
        subprocess.run(
            ["ip", "netns", "exec", THERE, *EDC, "join", ADDRESS, "--uavs", "4", *options],
            check=True,
            stdout=sys.stderr,
        )
        said = json.loads(run.communicate()[0])
        assert run.returncode == 0, said
        received, sent = crossed_bytes()
    return received / said["slots"] / 1e3, sent / said["slots"] / 1e3


def main() -> None:
    print("| second host | from it, kB per slot | to it, kB per slot |\n|---|---|---|")
    for title, options in (("no router", ()), ("`--router`", ("--router",))):
        received, sent = fly(*options)
        print(f"| {title} | {received:.1f} | {sent:.1f} |", flush=True)


if __name__ == "__main__":
    main()
