"""Events of the bus: every kind once, with its publishers and the form of its detail.

Nodes, operator, recorder, viewers and readers import the kinds from here; `docs/metrics.md` has the same table.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class EventKind(StrEnum):
    """Kind of an event, as the field `kind` of `messages.Event` has it."""

    FAULT = "fault"
    FAULT_WITHOUT_TARGET = "fault-without-target"
    HOST_REQUEST = "host-request"
    EXITED = "exited"
    OFF_BUS = "off-bus"
    END = "end"
    CLOSED = "closed"
    TAKES_OFFICE = "takes-office"
    PLANNER_FAILED = "planner-failed"
    BATTERY_EMPTY = "battery-empty"
    LANDED = "landed"
    STRAYED = "strayed"
    AUTOPILOT = "autopilot"
    GROUNDED = "grounded"
    GOAL_REFUSED = "goal-refused"
    GOAL_UNANSWERED = "goal-unanswered"
    CLOCK_OFFSET = "clock-offset"
    CLOCK_JUMP = "clock-jump"
    DELAY_ERROR = "delay-error"
    LINK_DELAYS = "link-delays"
    MALFORMED = "malformed"
    GROUND_DENIED = "ground-denied"
    GROUND_COMMAND = "ground-command"
    GROUND_REFUSED = "ground-refused"
    RECORDER_BEHIND = "recorder-behind"
    RECORDER_DROPPED = "recorder-dropped"
    RECORDING_FAILED = "recording-failed"


@dataclass(frozen=True, slots=True)
class EventForm:
    """Form of one kind of event: its publisher, the content of its detail, and True if viewers show it as a warning."""

    sender: str
    detail: str
    warning: bool = False


EVENT_FORMS: dict[EventKind, EventForm] = {
    EventKind.FAULT: EventForm("operator", "the fault that begins now, with ids in place of words", warning=True),
    EventKind.FAULT_WITHOUT_TARGET: EventForm("operator", "the fault that nobody was the target of, as written"),
    EventKind.HOST_REQUEST: EventForm("operator", "JSON: a signal or a restart that a host carries out for a fault"),
    EventKind.EXITED: EventForm("operator", "the process that ended unasked, and how", warning=True),
    EventKind.OFF_BUS: EventForm("operator", "the process that left the bus, and may come back", warning=True),
    EventKind.END: EventForm("operator", "the reason why the mission ends, such as `completed` or `max_slots`"),
    EventKind.CLOSED: EventForm(
        "every publisher but the recorder", "JSON: the last `seq` of each of its keys; its last word"
    ),
    EventKind.TAKES_OFFICE: EventForm("UAV", "the term that it begins to lead in"),
    EventKind.PLANNER_FAILED: EventForm("UAV", "the error of a user's planner, and its line"),
    EventKind.BATTERY_EMPTY: EventForm("UAV", "nothing"),
    EventKind.LANDED: EventForm("UAV", "why it lands: since when it has accepted no step", warning=True),
    EventKind.STRAYED: EventForm("UAV", "why its autopilot no longer follows its commands", warning=True),
    EventKind.AUTOPILOT: EventForm("UAV", "what its autopilot is, has done, or says"),
    EventKind.GROUNDED: EventForm("UAV", "why its autopilot does not take off", warning=True),
    EventKind.GOAL_REFUSED: EventForm(
        "UAV", "JSON: the UAV, the number of the goal, why it does not fly it", warning=True
    ),
    EventKind.GOAL_UNANSWERED: EventForm("operator", "JSON: the UAV and the goal that it never answered", warning=True),
    EventKind.CLOCK_OFFSET: EventForm("UAV", "the UAV whose clock is ahead, and by how much at least"),
    EventKind.CLOCK_JUMP: EventForm("every publisher", "by how much its wall clock jumped"),
    EventKind.DELAY_ERROR: EventForm("UAV", "JSON: how late its emulated links handed messages over"),
    EventKind.LINK_DELAYS: EventForm("UAV", "JSON: of each sender, what arrived and was lost, quantiles of the delays"),
    EventKind.MALFORMED: EventForm("UAV, operator, recorder, visualiser", "what was rejected, and how often"),
    EventKind.GROUND_DENIED: EventForm(
        "bridge to a ground station",
        "the requests so far that would have steered a UAV, or were dropped, by kind",
        warning=True,
    ),
    EventKind.GROUND_COMMAND: EventForm(
        "bridge to a ground station", "JSON: the UAV, what it is to do, where", warning=True
    ),
    EventKind.GROUND_REFUSED: EventForm("operator", "the command from the ground that it refuses; why", warning=True),
    EventKind.RECORDER_BEHIND: EventForm("recorder", "by how many seconds and messages it is behind", warning=True),
    EventKind.RECORDER_DROPPED: EventForm("recorder", "the number of messages that it could not write", warning=True),
    EventKind.RECORDING_FAILED: EventForm("recorder", "the error that ended the file"),
}
