"""Terminal escapes and huge texts in a recording reach no terminal and no page as they are."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from edc_swarm.foreign_text import MAX_LINE
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Event
from edc_swarm.recording.writer import RecordingWriter
from processes.cli.main import main
from tests.unit.synthetic import EPOCH_NS, flight, parallel, whole

ESCAPE = "\x1b]0;owned\x07\x1b[31m"
LONG = "x" * 600_000
DETAIL = "x" * 60_000
"""So long may the detail of an event be."""


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A mission among escapes and 600 kB texts: in topics, in fault texts, as the cause of a UAV's end, in payloads."""
    path = tmp_path / "hostile.mcap"
    flown = flight(parallel())
    messages = whole(m for m in flown if not (getattr(m, "uav", "") == "u2" and getattr(m, "slot", 0) > 3))
    said: dict[str, Any] = {"source": "operator", "instance": "operator", "sent_ns": EPOCH_NS + 1, "slot": 4}
    messages += [
        Event(**said, seq=100, kind="fault-without-target", detail=f"{ESCAPE}{DETAIL}"),
        Event(**said, seq=101, kind="exited", detail=f"u2 {ESCAPE}{DETAIL}"),
        Event(**said, seq=102, kind="fault", detail=f"{ESCAPE}{DETAIL}"),
        Event(**said, seq=103, kind="end", detail=f"{ESCAPE}{DETAIL}"),
    ]
    with path.open("w+b") as stream:
        writer = RecordingWriter(stream, {"clock": "wall", "command": f"{ESCAPE}{LONG}"})
        keys = Keys("mission")
        for message in messages:
            writer.write(keys.of(message), encode(message), EPOCH_NS)
        writer.write(f"/{ESCAPE}", b"{}", EPOCH_NS)
        writer.write(f"/{LONG[:60_000]}", b"{}", EPOCH_NS)
        writer.write(f"swarm/mission/uav/{ESCAPE}/fix", b"{}", EPOCH_NS)
        writer.write("swarm/mission/uav/u1/fix", msgspec.json.encode({"uav": f"{ESCAPE}{LONG}"}), EPOCH_NS)
        writer.finish({})
    return path


@pytest.mark.parametrize("command", ["check", "metrics", "replay --verify"])
def test_no_command_prints_them(hostile: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every line is printable; each text in it is cut."""
    assert main([*command.split(), str(hostile)]) in {0, 1, 2, 3}
    said = capsys.readouterr()
    lines = (said.out + said.err).splitlines()
    assert lines
    assert all(line.isprintable() for line in lines)
    assert re.search(rf"x{{{MAX_LINE + 1}}}", said.out + said.err) is None


def test_no_page_embeds_them(hostile: Path, tmp_path: Path) -> None:
    """Neither as text nor in its JSON."""
    page = tmp_path / "page.html"
    assert main(["report", str(hostile), "--out", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "\x1b" not in text
    assert "\\u001b" not in text
    assert re.search(rf"x{{{MAX_LINE + 1}}}", text) is None
