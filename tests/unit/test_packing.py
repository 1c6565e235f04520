"""Packed memory: what a forked child allocates copies few of the pages that it shares with its parent."""

import os
import socket
import subprocess
import sys

import msgspec

from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.roster import complete_mission
from processes.host.fork_source import News, Ready
from processes.host.packing import SMALL
from processes.runtime.children import SINGLE_THREADED

HOLES = 250
"""Holes of one size, each in another page: objects that die between others that live on."""
ALLOCATED_BYTES = 128
CHILD = f"""
import gc, os, re, sys
from processes.host.packing import pack_memory

def own_kb():
    return int(re.search(r"Private_Dirty:\\s+(\\d+)", open("/proc/self/smaps_rollup").read())[1])

objects = [bytes({ALLOCATED_BYTES} - 33) for _ in range({HOLES} * 100)]
del objects[::100]
gc.collect()
if sys.argv[1] == "packed":
    pack_memory()
gc.freeze()
read, write = os.pipe()
if os.fork() == 0:
    own_kb()
    before_kb = own_kb()
    made = [bytes({ALLOCATED_BYTES} - 33) for _ in range({HOLES})]
    os.write(write, str(own_kb() - before_kb).encode())
    os._exit(0)
os.wait()
print(os.read(read, 100).decode())
"""


def copied_kb(how: str) -> int:
    """Return the memory that a child copies which allocates as many objects as its parent has holes."""
    done = subprocess.run([sys.executable, "-c", CHILD, how], capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_a_child_of_packed_memory_copies_few_pages() -> None:
    """A child that allocates as much as its parent has holes copies a page for each, or a few in a row."""
    loose_kb, packed_kb = copied_kb("loose"), copied_kb("packed")
    assert loose_kb > 2 * HOLES
    assert packed_kb < loose_kb / 4


WARM = """
import socket, sys
from processes.host import fork_source, packing

assert fork_source._warm(fork_source.ForkSource(socket.socket(fileno=int(sys.argv[1]))))
print(len(packing._fillers))
"""


def test_the_fork_source_packs_its_memory_before_it_is_ready() -> None:
    """It forks when it has said that it is ready, so whatever it packs later is of no use to its UAVs."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    mission = msgspec.json.encode(complete_mission(Mission(uavs=2, planner="straight")))
    with ours, theirs:
        command, passed = [sys.executable, "-c", WARM, str(theirs.fileno())], [theirs.fileno()]
        alone = {**os.environ, **SINGLE_THREADED}
        done = subprocess.run(command, input=mission, capture_output=True, check=True, pass_fds=passed, env=alone)
        assert isinstance(msgspec.json.decode(ours.recv(1000), type=News), Ready)
    assert int(done.stdout) > SMALL
