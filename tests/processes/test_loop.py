"""The loop of a command: ends of a wait, signals and failures."""

from __future__ import annotations

import os
import signal

import pytest

from edc_swarm.errors import SwarmError
from processes.runtime import loop
from processes.runtime.loop import Interrupt, Interrupted, Loop


def test_everything_goes_through_one_inbox() -> None:
    """The loop takes items in their order and calls `after` each time; a signal is no item."""
    said: list[object] = []
    made = Loop(said.append, lambda: said.append("after"))
    made.inbox.put(1)
    made.inbox.put(2)
    made.wait(lambda: "after" in said, "it")
    assert said == [1, 2, "after"]
    made.inbox.put_always(Interrupt())
    with pytest.raises(Interrupted):
        made.pump(0)
    assert said == [1, 2, "after", "after"]


def test_a_wait_ends_with_a_word_about_what_was_waited_for(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long wait prints one note; a wait at the end of a command prints none."""
    made, looks = Loop(lambda _: None), list[int]()

    def look() -> bool:
        looks.append(0)
        return False

    made.wait_quietly(look, 0.05, look_every_s=0.01)
    assert len(looks) > 1
    with pytest.raises(SwarmError, match=r"waited 0\.05 s for it"):
        made.wait(lambda: False, "it", 0.05)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(loop, "PATIENCE_S", 0.02)
    with pytest.raises(SwarmError, match=r"waited 0\.1 s for Godot"):
        made.wait(lambda: False, "Godot", 0.1, look_every_s=0.01)
    assert capsys.readouterr().err.count("waiting for Godot") == 1
    made.wait_quietly(lambda: False, 0.05, look_every_s=0.01)
    assert capsys.readouterr().err == ""


def test_what_comes_without_a_message_is_looked_for() -> None:
    """The loop checks the condition periodically."""
    looks = iter(range(5))
    Loop(lambda _: None).wait(lambda: next(looks) == 4, "it", look_every_s=0.001)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_and_failures_end_everything_but_the_end(number: int) -> None:
    """A signal does not interrupt a command that is ending."""
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    made = Loop(lambda _: None)
    made.failure = SwarmError("broken")
    with pytest.raises(SwarmError, match="broken"):
        made.pump(0)
    try:
        made.obey_signals()
        os.kill(os.getpid(), number)
        with pytest.raises(Interrupted):
            made.wait(lambda: False, "the signal")
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
    made.ending = True
    made.pump(0)
    assert made.interrupted
