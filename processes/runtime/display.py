"""The state of a mission on standard error while it flies: a bar, or the running story."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column

from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.protocol.completion import MissionMonitor
from edc_swarm.protocol.messages import MissionMessage
from edc_swarm.story.happening import Happening, grouped
from edc_swarm.story.teller import Storyteller
from processes.runtime.console import note
from processes.runtime.voice import Voice

BEAT_S = 10.0
"""Period of the lines that say how the mission stands."""
BAR_COLUMNS = 24
ROOM = 12
"""Columns for the time and the spaces between columns."""
MAX_LINES = 50
"""Most lines that one slot brings."""
MAX_HEADS = 6
"""Most clusters whose heads the state names."""
GONE = frozenset({"dead", "silent", "frozen", "landed"})


class Display:
    """Bar and story of one mission.

    Parameters
    ----------
    hosts
        Name of the host or container of each UAV that another host flies.
    """

    def __init__(self, mission: MissionMessage, voice: Voice, hosts: Mapping[str, str] | None = None) -> None:
        self._mission = mission
        self._voice = voice
        self._hosts = hosts if hosts is not None else {}
        self._order = [entry.uav for entry in mission.roster]
        self._console = Console(stderr=True)
        state = TextColumn("{task.fields[state]}", table_column=Column(no_wrap=True, overflow="ellipsis"))
        wide = self._console.width > 2 * BAR_COLUMNS + ROOM
        columns = (state, BarColumn(bar_width=BAR_COLUMNS), TimeElapsedColumn()) if wide else (state,)
        self._bar_columns = BAR_COLUMNS + ROOM if wide else 1
        self._progress = Progress(*columns, console=self._console, transient=True, disable=not voice.shows_bar)
        self._task = self._progress.add_task("", total=len(self._order), state="")
        self._beat_s = time.monotonic()
        self._now: tuple[int, str] | None = None

    def __enter__(self) -> Display:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show(self, monitor: MissionMonitor, teller: Storyteller, until: int) -> None:
        """Tell all slots before `until`, and show the state that they lead to."""
        if not (self._voice.tells_story or self._voice.shows_bar):
            return
        while teller.next_slot < until:
            if self._now is not None and self._now[0] <= teller.next_slot:
                self._say(teller.next_slot * self._mission.dt_s, "now", self._now[1])
                self._now = None
            told = teller.close(teller.next_slot)
            if self._voice.tells_story:
                self._tell(told)
        if self._voice.tells_story and self._now is None and time.monotonic() - self._beat_s >= BEAT_S:
            self._beat_s = time.monotonic()
            # Fixes of slots that are still to be told have come: the line waits for them, so that times do not go back.
            self._now = max(0, monitor.slot), "  ".join(self._state(monitor, teller))
        if self._voice.shows_bar:
            room = self._console.width - self._bar_columns
            state = fitting(self._state(monitor, teller), room)
            self._progress.update(self._task, completed=monitor.arrived, state=state)

    def _tell(self, told: Iterable[Happening]) -> None:
        """Tell what one slot brought, in at most `MAX_LINES` lines and one that says how many more there are."""
        news = [each for each in grouped(told, self._order) if self._voice.verbose or each.level != "detail"]
        for each in news[:MAX_LINES]:
            named = [f"{uav} ({self._hosts[uav]})" if uav in self._hosts else uav for uav in each.uavs]
            self._say(each.time_s, each.kind, _with_names(each, named).words)
        if (left := len(news) - MAX_LINES) > 0:
            self._say(news[-1].time_s, "", f"and {left} more: edc-swarm events lists all of them")

    def _say(self, time_s: float, kind: str, words: str) -> None:
        line = shown(f"{time_s:7.1f} s  {kind:<13} {words}", MAX_LINE)
        if self._voice.shows_bar:
            self._progress.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            note(line)

    def _state(self, monitor: MissionMonitor, teller: Storyteller) -> list[str]:
        """Return the parts of the state, the most important first."""
        report, gone = monitor.report, sum(state in GONE for state in teller.states.values())
        parts = [f"slot {max(monitor.slot, 0)}", f"arrived {monitor.arrived}/{len(self._order)}"]
        parts += [f"dead or silent {gone}"] if gone else []
        alone = "local control" if self._mission.control == "local" else "no head"
        if len(monitor.clusters) > 1:
            return parts + heads_of({name: cluster.head for name, cluster in monitor.clusters.items()})
        parts += [f"head {report.head} term {report.term}" if report else alone]
        if report is not None:
            begun_ns = self._mission.epoch_ns + report.slot * self._mission.slot_ns
            share = (report.sent_ns - begun_ns) / self._mission.slot_ns
            # A planner leaves the gap at 0 where no two UAVs are near each other.
            parts += [f"gap {report.min_gap_m:.2f} m"] if report.min_gap_m else []
            parts += [f"plan sent at {100 * max(0.0, share):.0f} % of the slot"]
        return parts


def heads_of(of_clusters: Mapping[str, str]) -> list[str]:
    """Return who leads each cluster, those without a head first; of many clusters, how many have one."""
    without = [name for name, head in of_clusters.items() if not head]
    parts = [f"no head of {', '.join(without[:MAX_HEADS])}{', ...' * (len(without) > MAX_HEADS)}"] if without else []
    led = {name: head for name, head in of_clusters.items() if head}
    if len(led) > MAX_HEADS:
        return [*parts, f"heads of {len(led)} clusters"]
    return [*parts, *(f"head of {name} {head}" for name, head in led.items())]


def fitting(parts: list[str], columns: int) -> str:
    """Return as many of the parts as fit into a line, at least the first one."""
    text = parts[0]
    for part in parts[1:]:
        if len(text) + 2 + len(part) > columns:
            break
        text += f"  {part}"
    return text


def _with_names(happening: Happening, names: list[str]) -> Happening:
    fields = {field: getattr(happening, field) for field in happening.__struct_fields__}
    return Happening(**{**fields, "uavs": names})
