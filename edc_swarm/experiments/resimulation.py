"""G6, same seed, same bytes: this module repeats a recorded simulation and compares every message.

The mission alone determines all messages of a simulation, so the second run must publish the same bytes. Another
version, library or machine may lead to other messages. In that case a difference proves nothing, but equality still
does. `judge` returns the verdicts on all guarantees, in order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Violation, not_applicable, not_judged, verdict
from edc_swarm.errors import MissionError
from edc_swarm.foreign_text import shown
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.plug_ins import plug_ins_of
from edc_swarm.planner.interface import Plan, Planner, PlanRequest, timeless
from edc_swarm.planner.registry import BUILT_IN, make_planner
from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.keys import Keys
from edc_swarm.protocol.messages import Message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.closed_loop import AS_PRINTED
from edc_swarm.simulation.simulator import Simulation

_G6 = ("G6", "Same seed, same bytes")
MAX_SLOTS = 10_000_000
"""Most slots of a recording that is simulated again."""
MAX_TOLD = 5
VIRTUAL, WALL = "virtual", "wall"
"""Values of `run.clock` for a simulation and for real processes."""

Identity = tuple[str, str, int]
"""Key, instance of the publisher and sequence number of a message."""
Watch = Callable[[int, int], None]
"""Progress callback of the second simulation: number of slots simulated so far, and number of all slots."""


def foreign_parts(mission: Mission) -> list[str]:
    """Return the parts of a mission, planner and plug-ins, whose code is not this project's."""
    planner = [mission.planner] if mission.planner not in {*BUILT_IN, AS_PRINTED} else []
    return [*planner, *plug_ins_of(mission)]


def judge(
    recording: Recording,
    otherwise: str = "",
    watch: Watch = lambda _done, _of: None,
    *,
    load_planner: bool = False,
) -> list[GuaranteeResult]:
    """Return the verdict on every guarantee, G1 to G8; see `check_same_bytes`."""
    results = [*check(recording), check_same_bytes(recording, otherwise, watch, load_planner=load_planner)]
    return sorted(results, key=lambda result: result.guarantee)


def check_same_bytes(
    recording: Recording,
    otherwise: str = "",
    watch: Watch = lambda _done, _of: None,
    *,
    load_planner: bool = False,
) -> GuaranteeResult:
    """Return the verdict on G6; it takes as long as the simulation itself.

    Parameters
    ----------
    recording
        The recording to judge.
    otherwise
        Description of the version, library or machine of the recording that differs from this one ("": none).
    watch
        Told how far the simulation is.
    load_planner
        Import the planner and the plug-ins that the recording names, whosever they are: a recording of a stranger may
        name any code.
    """
    clock = recording.run.get("clock")
    if clock == WALL:
        return not_applicable(*_G6, "real processes: what they say follows the machine's timing, not the seed alone")
    if clock != VIRTUAL:
        return not_judged(*_G6, "the record does not say that a simulation made it")
    foreign = foreign_parts(recording.mission)
    if not load_planner and foreign:
        what = "the planner" if foreign[0] == recording.mission.planner else "the part"
        why = f"{what} {shown(foreign[0])} is not one of this project's; give --load-planner to load it"
        return not_judged(*_G6, why)
    last = _last_slot(recording)
    if last > MAX_SLOTS:
        return not_judged(*_G6, f"slot {last} is beyond what is simulated again ({MAX_SLOTS} slots)")
    try:
        compared = _compare(recording, last, watch)
    except MissionError as error:
        return not_judged(*_G6, f"the recorded mission cannot be simulated here: {error}")
    except AssertionError as error:
        compared = _Comparison(failed=f"the second simulation broke off: {error}")
    return _verdict(compared, otherwise)


class Timeless:
    """A planner that reports a plan time of 0, like the planner of a recorded simulation."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner

    def plan(self, request: PlanRequest) -> Plan:
        """Return the plan of the wrapped planner with a plan time of 0."""
        return timeless(self._planner.plan(request))


@dataclass(slots=True)
class _Comparison:
    """The differences between a recorded run and its repetition.

    `absent` counts messages of the second run that the recording does not hold.
    """

    equal: int = 0
    absent: int = 0
    first_absent: str = ""
    different: list[Violation] = field(default_factory=list)
    failed: str = ""


def _verdict(compared: _Comparison, otherwise: str) -> GuaranteeResult:
    if compared.failed:
        compared.different.append(Violation("broke-off", compared.failed))
    if compared.different and otherwise:
        first = compared.different[0]
        return not_judged(*_G6, f"simulated again it is another run, but the recording was {otherwise}; first: {first}")
    if compared.different:
        return verdict(*_G6, compared.different)
    if compared.absent:
        why = f"the record lacks {compared.absent} messages of the run, first {compared.first_absent}"
        return not_judged(*_G6, f"{why}; the {compared.equal} others are equal")
    return verdict(*_G6, [], [f"simulated again: {compared.equal} messages are equal to the byte"])


def _compare(recording: Recording, last: int, watch: Watch) -> _Comparison:
    """Simulate the mission again up to the end of the first slot with a difference."""
    mission, compared = recording.mission, _Comparison()
    keys = Keys(mission.name)
    recorded = {_identity(keys, message): message for message in _said(recording)}

    def hear(key: str, message: Message, _now_ns: int) -> None:
        found = recorded.pop((key, message.instance, message.seq), None)
        if found is None:
            compared.absent += 1
            compared.first_absent = compared.first_absent or f"{key} {message.seq}"
        elif encode(found) == encode(message):
            compared.equal += 1
        elif len(compared.different) < MAX_TOLD:
            compared.different.append(_different(key, found, message))

    simulation = Simulation(mission, lambda: Timeless(make_planner(mission.planner, mission)), hear)
    limit = recording.message_count + len(mission.roster)
    for slot in simulation.slots():
        watch(slot + 1, last + 1)
        if compared.different or compared.absent > limit or slot > last:
            return compared
    simulation.end()
    unsaid = [Violation("unsaid", f"{key} {seq} is not repeated", _slot(m)) for (key, _, seq), m in recorded.items()]
    compared.different += unsaid[: MAX_TOLD - len(compared.different)]
    return compared


def _said(recording: Recording) -> Iterator[Message]:
    for messages in recording.lists().values():
        yield from messages


def _identity(keys: Keys, message: Message) -> Identity:
    return keys.of(message), message.instance, message.seq


def _slot(message: Message) -> int:
    return int(getattr(message, "slot", -1))


def _last_slot(recording: Recording) -> int:
    return max(map(_slot, _said(recording)), default=-1)


def _different(key: str, found: Message, again: Message) -> Violation:
    """Return a violation that names the fields in which two messages differ."""
    names = [name for name in found.__struct_fields__ if getattr(found, name) != getattr(again, name)]
    changes = [f"{name} was {getattr(found, name)!r:.60}, is {getattr(again, name)!r:.60}" for name in names[:2]]
    return Violation("different", f"{key} {found.seq}: {'; '.join(changes) or 'not the same bytes'}", _slot(found))
