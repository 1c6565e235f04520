"""What a command says while a mission flies: the story line by line, a state that fits, or nothing."""

from __future__ import annotations

import pytest

from edc_swarm.errors import InputError
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.messages import Event, Message
from edc_swarm.story.teller import Storyteller
from processes.cli.main import main
from processes.runtime.display import MAX_LINES, Display, fitting, heads_of
from processes.runtime.voice import Voice
from tests.builders import at, fix, mission_message, report, row

MISSION = mission_message(row("abc", 12.0, 40.0))


def said(voice: Voice, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return the lines about a mission whose UAV c dies in slot 5."""
    monitor, teller = MissionMonitor(MISSION), Storyteller(MISSION)
    messages: list[Message] = [Event(source="operator", slot=5, kind="fault", detail="kill c @5", sent_ns=at(5))]
    for slot in range(12):
        messages.append(report(slot, grants=["a", "b"]))
        heard = {uav: fix(uav, slot, seq=slot, executing=True, energy_j=1.0, sent_ns=at(slot)) for uav in "abc"}
        messages.extend(heard[uav] for uav in ("ab" if slot >= 5 else "abc"))
    for message in messages:
        teller.hear(message)
    with Display(MISSION, voice, {"c": "uav-7"}) as display:
        display.show(monitor, teller, 12)
    return capsys.readouterr().err.splitlines()


def test_the_story_names_the_uav_and_its_container(capsys: pytest.CaptureFixture[str]) -> None:
    """Without a terminal each happening of weight is a line."""
    lines = said(Voice(), capsys)
    assert "    2.5 s  fault         kill c @5" in lines
    assert "    2.5 s  dead          c (uav-7): killed by a fault in slot 5" in lines
    assert not any("holding" in line for line in lines)


def test_verbose_tells_details_and_quiet_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    """A hold of four slots is a detail."""
    assert any("holding" in line for line in said(Voice(verbose=True), capsys))
    assert said(Voice(quiet=True), capsys) == []
    with pytest.raises(InputError, match="--quiet"):
        Voice(quiet=True, verbose=True)


def test_the_state_is_said_in_its_turn(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The monitor knows of slots that are still to be told; the line about them stands behind what came before."""
    monkeypatch.setattr("processes.runtime.display.BEAT_S", 0.0)
    monitor, teller = MissionMonitor(MISSION), Storyteller(MISSION)
    with Display(MISSION, Voice()) as display:
        for slot in range(12):
            for uav in "abc":
                said = fix(uav, slot, seq=slot, executing=True, arrived=slot > 5, energy_j=90.0, sent_ns=at(slot))
                teller.hear(said)
                monitor.hear_fix(said)
            display.show(monitor, teller, slot - 1)
    lines = [line.split()[0:3:2] for line in capsys.readouterr().err.splitlines()]
    assert ["3.0", "arrived"] in lines
    assert ["3.0", "now"] in lines
    assert [float(time_s) for time_s, _ in lines] == sorted(float(time_s) for time_s, _ in lines)


def test_a_slot_brings_a_bounded_number_of_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """Events of another kind each make a line each, up to a limit; the last line counts the others."""
    monitor, teller = MissionMonitor(MISSION), Storyteller(MISSION)
    for number in range(200):
        teller.hear(Event(source="recorder", slot=3, kind="clock-jump", detail=f"by {number} s", sent_ns=at(3)))
    with Display(MISSION, Voice(verbose=True)) as display:
        display.show(monitor, teller, 6)
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("    1.5 s")]
    assert len(lines) == MAX_LINES + 1
    assert lines[-1].endswith("and 150 more: edc-swarm events lists all of them")


def test_a_narrow_terminal_shows_the_most_important_parts() -> None:
    """Parts are left out whole."""
    parts = ["slot 12", "arrived 3/10", "head u001 term 2"]
    assert fitting(parts, 80) == "slot 12  arrived 3/10  head u001 term 2"
    assert fitting(parts, 25) == "slot 12  arrived 3/10"
    assert fitting(parts, 3) == "slot 12"


def test_the_state_names_the_head_of_each_cluster() -> None:
    """A cluster without a head is named first; of many clusters only their number is told."""
    assert heads_of({"a": "a1", "b": "", "c": "c2"}) == ["no head of b", "head of a a1", "head of c c2"]
    many = {f"c{k}": "" if k < 8 else f"u{k}" for k in range(20)}
    assert heads_of(many) == ["no head of c0, c1, c2, c3, c4, c5, ...", "heads of 12 clusters"]


def test_faults_prints_the_vocabulary(capsys: pytest.CaptureFixture[str]) -> None:
    """It has examples."""
    assert main(["faults"]) == 0
    assert "kill head @10" in capsys.readouterr().out


@pytest.mark.parametrize(("word", "meant"), [("reprot", "report"), ("evnts", "events"), ("xyzzy", "")])
def test_an_unknown_command_suggests_the_nearest(word: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    """One that is like no other suggests none."""
    assert main([word]) == 2
    error = capsys.readouterr().err
    assert (f"do you mean {meant}?" in error) if meant else ("do you mean" not in error)
