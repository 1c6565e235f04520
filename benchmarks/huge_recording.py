"""Memory that reading a recording of a gigabyte takes, with huge payloads on a UAV's own event key.

    python benchmarks/huge_recording.py FILE.mcap [MEGABYTES]

The script writes the file from a recording of the project, then runs `check` and `metrics` on it.
"""

from __future__ import annotations

import random
import resource
import subprocess
import sys
from pathlib import Path

from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.recording.writer import RecordingWriter

GOLDEN = Path(__file__).parent.parent / "recordings" / "golden.mcap"
PAYLOAD_BYTES = 8 << 20


def write(path: Path, size_bytes: int) -> None:
    golden = McapFile(GOLDEN)
    raws = list(golden.messages())
    key = next(raw[0].topic for raw in raws if raw[0].topic.startswith("swarm/") and "/event/" in raw[0].topic)
    with path.open("wb") as stream:
        writer = RecordingWriter(stream, golden.metadata["run"])
        for channel, sequence, log_ns, sent_ns, payload in raws:
            writer.copy(channel, payload, log_ns, sent_ns, sequence)
        for number in range(size_bytes // PAYLOAD_BYTES):
            writer.write(key, random.Random(number).randbytes(PAYLOAD_BYTES), raws[-1][2] + number)
        writer.finish(golden.metadata.get("run_end", {}))


if __name__ == "__main__":
    path = Path(sys.argv[1])
    write(path, (int(sys.argv[2]) if len(sys.argv) > 2 else 1000) * 1_000_000)
    print(f"{path.stat().st_size / 1e6:.0f} MB")
    for command in ("check", "metrics"):
        subprocess.run([sys.executable, "-m", "processes.cli.main", command, str(path)], check=False)
        print(f"{command}: at most {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3:.0f} MB of memory")
