"""Election transcripts: what every UAV grants, suspects and claims, as readable text.

Each `NAME.txt` beside this file holds a scenario (lines of `key value` and `fault ...`), a blank
line, and the transcript of its simulation. `pytest tests/scenarios --rewrite` writes them anew; the
change is then read as a diff.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.validation import mission_from_dict
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Event, Fix, Message, Report, mission_message
from edc_swarm.simulation.simulator import Simulation

HERE = Path(__file__).parent
SCENARIOS = sorted(HERE.glob("*.txt"))


class Transcript:
    """Turns the messages of a simulated mission into lines, one for each change."""

    def __init__(self, epoch_ns: int) -> None:
        self._epoch_ns = epoch_ns
        self._grants: dict[str, tuple[int, str, bool]] = {}
        self._reports: dict[str, tuple[Any, ...]] = {}
        self.lines: list[str] = []

    def hear(self, _key: str, message: Message, now_ns: int) -> None:
        """Note what is new in `message`."""
        at_s = (now_ns - self._epoch_ns) / 1e9
        self.lines += [f"{at_s:8.4f} s  {line}" for line in self._news(message)]

    def _news(self, message: Message) -> Iterator[str]:
        match message:
            case Fix():
                now = (message.term, message.head, message.suspects)
                if self._grants.get(message.uav) != now:
                    self._grants[message.uav] = now
                    yield f"slot {message.slot:3}  {message.uav} {_grant_text(message)}"
            case Report():
                about = (message.term, message.status, len(message.heard), tuple(message.unheard), message.successor)
                if self._reports.get(message.head) != about:
                    self._reports[message.head] = about
                    yield f"slot {message.slot:3}  {message.head} REPORTS {_report_text(message)}"
            case Event(kind="fault" | "end"):
                yield f"slot {message.slot:3}  {message.source} {message.kind.upper()} {message.detail}"
            case _:
                pass


def _grant_text(fix: Fix) -> str:
    grant = f"grants {fix.head} in term {fix.term}" if fix.head else "grants nobody"
    return grant + (", suspects" if fix.suspects else "") + ("" if fix.voter else ", has lost its memory")


def _report_text(report: Report) -> str:
    if report.status == "claim":
        return f"claim of term {report.term}, {','.join(report.grants)} suspect"
    unheard = f", unheard {','.join(report.unheard)}" if report.unheard else ""
    after = f", successor {report.successor} in term {report.next_term}" if report.successor else ""
    return f"{report.status} in term {report.term}, heard {len(report.heard)}{unheard}{after}"


def _read(text: str) -> dict[str, Any]:
    fields: dict[str, Any] = {"fault": [], "planner": "straight", "area_m2": 40_000.0, "max_slots": 60}
    for line in text.splitlines():
        key, _, value = line.partition(" ")
        if key == "fault":
            fields["fault"].append(value)
        elif key and key != "#":
            fields[key] = msgspec.json.decode(value)
    return fields


def transcript(text: str) -> str:
    """The transcript of a scenario."""
    mission = mission_message(complete_mission(mission_from_dict(_read(text))))
    scribe = Transcript(mission.epoch_ns)
    Simulation(mission, lambda: make_planner(mission.planner, mission), scribe.hear).run()
    return "\n".join(scribe.lines) + "\n"


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_transcript(path: Path, request: pytest.FixtureRequest) -> None:
    """A scenario goes exactly as its transcript says."""
    scenario, _, expected = path.read_text().partition("\n\n")
    found = transcript(scenario)
    if request.config.getoption("--rewrite"):
        path.write_text(f"{scenario}\n\n{found}")
    else:
        assert found == expected


def test_there_are_scenarios() -> None:
    """An empty folder would pass in silence."""
    assert len(SCENARIOS) >= 10
