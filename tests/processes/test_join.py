"""`edc-swarm join`: UAVs on other hosts, and missions in which others run every part."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from edc_swarm.mission.roles import JOIN, OPERATOR
from edc_swarm.protocol.claims import IdClaim, Issued
from edc_swarm.protocol.keys import PREFIX, Keys
from edc_swarm.recording.model import Recording
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps, unknown_tails
from processes.bus.abort_notice import NOTICE_KEY
from processes.bus.address import free_endpoint
from processes.bus.credentials import Credentials
from processes.bus.operator_presence import OperatorPresence
from processes.bus.session import open_client, put
from processes.host.certificates import write_certificates
from processes.services.orders import asked, await_found
from tests.processes.conftest import Ended, Fly, Started, await_true

SAFE = {"G1", "G2", "G3", "G4", "G7"}
either = pytest.mark.parametrize("parts", ["open", "secured"], indirect=True)
FAST = ("--json", "--time-scale", "4", "--uavs", "5", "--area", "3000")
HOLD = ("--failsafe", "hold")
"""Options with which a UAV without a process does not land, however slow the machine is."""


def broken(ended: Ended) -> set[str]:
    """Return the guarantees that are broken."""
    return {verdict["guarantee"] for verdict in ended.json["guarantees"] if verdict["status"] == "broken"}


def ids_of(joined: Started, folder: Path, count: int = 1) -> set[str]:
    """Return the ids that a joiner with a state folder flies."""
    joined.await_file(lambda: len(list(folder.glob("missions/*/*.promise"))) == count)
    return {file.stem for file in folder.glob("missions/*/*.promise")}


def claimed(address: str, uavs: int, own: Credentials | None = None) -> set[str]:
    """Return the ids of a claimant that leaves without flying them; if it flew them, the mission would begin."""
    with open_client(address, own) as session:
        operators = OperatorPresence(session)
        mission = await_found(lambda: operators.only_mission(address), "the mission")
        claim = msgspec.json.encode(IdClaim(claimant="c" * 16, uavs=uavs))
        answer = asked(session, Keys(mission).claims, claim)
        assert answer is not None
        with session.liveliness().declare_token(Keys(mission).alive(JOIN, "c" * 16)):
            return set(msgspec.json.decode(answer, type=Issued).uavs)


def await_gone(address: str, name: str) -> None:
    """Wait until no process of that name is on the bus."""
    with open_client(address) as session:
        tokens = f"{PREFIX}/*/alive/{name}/*"
        await_true(lambda: not [reply for reply in session.liveliness().get(tokens) if reply.ok is not None])


Hosted = Callable[..., tuple[Started, str]]


@pytest.fixture
def hosted(start: Fly) -> Hosted:
    """Start a run of five UAVs that leaves `remote` of them to joiners; return it and its router's address."""

    def go(remote: int, *arguments: str) -> tuple[Started, str]:
        address = free_endpoint()
        return start("run", *FAST, "--listen", address, "--remote", str(remote), *arguments), address

    return go


@pytest.mark.long
def test_two_hosts_fly_one_mission(start: Fly, hosted: Hosted) -> None:
    """Each id has one claimant, and each joiner ends with the mission."""
    run, address = hosted(3)
    joined = [start("join", address, "--uavs", number) for number in ("2", "1")]
    ended = run.end()
    assert ended.status == 0, ended.stderr
    mission = ended.recording.mission
    flown = {(fix.uav, fix.instance) for fix in ended.recording.fixes}
    assert len(flown) == 5
    assert mission.claimants[:2] == ("", "")
    assert len(set(mission.claimants)) == 3
    assert all(instance.endswith(mission.claimant_of(uav)) for uav, instance in flown)
    assert [command.end().status for command in joined] == [0, 0]


@pytest.mark.long
@pytest.mark.parametrize(("seed", "leads"), [("2", False), ("1", True)], ids=["weakest", "strongest"])
def test_a_uav_alone_stays_small(start: Fly, hosted: Hosted, seed: str, leads: bool) -> None:
    """Neither the UAV nor its joiner imports numpy, unless the UAV may lead from the start."""
    run, address = hosted(1, "--seed", seed)
    joined = start("join", address)
    run.await_flight(4)
    assert any("numpy" in Path(f"/proc/{pid}/maps").read_text() for pid in joined.pids()) == leads
    for command in (run, joined):
        command.process.send_signal(signal.SIGINT)
        command.end()


@pytest.mark.long
def test_a_fork_source_killed_by_hand_fails_the_joiner(start: Fly, hosted: Hosted) -> None:
    """The input is not at fault; the operator names the UAVs that are gone with the fork source."""
    run, address = hosted(2)
    joined = start("join", address, "--uavs", "2")
    joined.await_file(lambda: len(joined.uav_pids()) == 2)
    run.await_flight(3)
    (source,) = set(joined.pids("processes.host.fork_source")) - set(joined.uav_pids())
    os.kill(source, signal.SIGKILL)
    left = joined.end()
    assert left.status == 1
    assert left.stderr.splitlines()[-1].startswith("error: the fork-source was ended by SIGKILL: ")
    ended = run.end()
    assert ended.status == 1
    assert {who["cause"] for who in ended.json["not_home"]} == {"process-gone"}, ended.stdout


@pytest.mark.long
def test_a_uav_of_another_host_that_has_landed_may_leave(start: Fly, hosted: Hosted) -> None:
    """Its process ends in order: nobody calls that a loss, and the reason why it is not home is that it has landed."""
    run, address = hosted(1, "--fault", "partition u005|rest @8")
    joined = start("join", address)
    ended = run.end()
    assert [(who["uav"], who["cause"]) for who in ended.json["not_home"]] == [("u005", "landed")], ended.stdout
    assert not {"off-bus", "exited"} & {event.kind for event in ended.recording.events}
    assert (ended.status, joined.end().status) == (1, 0)


@pytest.mark.long
def test_a_uav_of_another_host_whose_battery_is_empty_may_leave(start: Fly, tmp_path: Path) -> None:
    """Its process ends in order, too."""
    path, address = tmp_path / "low.toml", free_endpoint()
    far = 'uav = "{}"\nstart_x_m = 0\nstart_y_m = {}\ntarget_x_m = 200\ntarget_y_m = {}\n'
    uavs = [far.format(uav, y_m, y_m) for uav, y_m in (("a", 0), ("b", 20), ("c", 40))]
    path.write_text("".join(f"[[roster]]\n{each}" for each in uavs) + "energy_j = 400\n")
    run = start("run", str(path), "--json", "--time-scale", "4", "--listen", address, "--remote", "1")
    joined = start("join", address)
    ended = run.end()
    assert [(who["uav"], who["cause"]) for who in ended.json["not_home"]] == [("c", "battery-empty")], ended.stdout
    assert not {"off-bus", "exited"} & {event.kind for event in ended.recording.events}
    assert (ended.status, joined.end().status) == (1, 0)


@pytest.mark.long
def test_faults_reach_the_uavs_of_other_hosts(start: Fly, hosted: Hosted) -> None:
    """Faults kill a UAV, restart one without memory, and freeze and resume one."""
    faults = ("kill u003 @8", "kill u004 @8 for 4", "freeze u005 @8 for 2s", "restart u004 lose-memory @20")
    run, address = hosted(3, "--speed-max", "2", *(word for fault in faults for word in ("--fault", fault)))
    joined = start("join", address, "--uavs", "3")
    ended = run.end()
    assert not broken(ended) & SAFE, ended.stdout
    instances = {uav: {fix.instance for fix in ended.recording.fixes if fix.uav == uav} for uav in ("u003", "u004")}
    assert [len(instances[uav]) for uav in ("u003", "u004")] == [1, 3]
    assert "u003" in ended.json["not_living"]
    assert any(not fix.voter for fix in ended.recording.fixes if fix.uav == "u004")
    assert joined.end().status == 0


@pytest.mark.long
def test_what_a_joiner_cannot_read_is_counted_and_told(start: Fly, hosted: Hosted, tmp_path: Path) -> None:
    """Garbage in the operator's name ends nothing; the joiner reports the first, second, fourth ... of it."""
    run, address = hosted(2)
    joined = start("join", address, "--state", str(tmp_path / "a"))
    ids_of(joined, tmp_path / "a")
    with open_client(address) as session:
        operators = OperatorPresence(session)
        await_true(lambda: bool(operators.missions()))
        for _ in range(3):
            put(session, Keys(operators.missions()[0]).event(OPERATOR), b"\xff")
    other = start("join", address)
    assert run.end().status == 0
    assert other.end().status == 0
    ended = joined.end()
    assert ended.status == 0
    told = [line for line in ended.stderr.splitlines() if line.startswith("malformed: ")]
    assert [line.split()[1] for line in told] == ["1", "2"]


@pytest.mark.long
def test_started_again_with_its_folder_it_is_the_same_uav(start: Fly, hosted: Hosted, tmp_path: Path) -> None:
    """The folder has the UAV's promise; another claimant gets no id meanwhile."""
    run, address = hosted(2, *HOLD)
    others = start("join", address)
    folder = tmp_path / "kept"
    joined = start("join", address, "--state", str(folder))
    run.await_flight(3)
    uavs = ids_of(joined, folder)
    joined.process.kill()
    await_true(lambda: not joined.pids())
    stranger = start("join", address)
    again = start("join", address, "--state", str(folder))
    refused = stranger.end()
    assert refused.status == 2
    assert "--uavs = 1: must be at most 0" in refused.stderr
    ended = run.end()
    assert not broken(ended) & SAFE, ended.stdout
    assert ended.json["arrived"] == 5
    (uav,) = uavs
    assert len({fix.instance for fix in ended.recording.fixes if fix.uav == uav}) == 2
    assert {fix.instance[-16:] for fix in ended.recording.fixes if fix.uav == uav} == {
        ended.recording.mission.claimant_of(uav)
    }
    assert [command.end().status for command in (others, again)] == [0, 0]


@pytest.mark.long
def test_ctrl_c_of_a_joiner_is_in_order(start: Fly, hosted: Hosted) -> None:
    """The UAVs of the joiner publish their last messages."""
    run, address = hosted(2)
    joined = start("join", address, "--uavs", "2")
    run.await_flight(3)
    joined.process.send_signal(signal.SIGINT)
    left = joined.end()
    assert left.status == 1
    assert "interrupted" in left.stderr
    assert "Traceback" not in left.stderr
    run.process.send_signal(signal.SIGINT)
    recording = run.end().recording
    assert {event.source for event in recording.events if event.kind == "closed"} >= {"u004", "u005"}
    assert not find_gaps(recording)


def test_more_than_are_left_is_refused(start: Fly, hosted: Hosted) -> None:
    """The joiner prints one line, and the mission waits for another claim."""
    run, address = hosted(2)
    greedy = start("join", address, "--uavs", "3").end()
    assert greedy.status == 2
    assert "--uavs = 3: must be at most 2" in greedy.stderr
    run.process.send_signal(signal.SIGINT)
    assert run.end().status == 1


@pytest.mark.long
def test_who_is_waited_for_is_named(start: Fly, hosted: Hosted) -> None:
    """The operator names the missing UAVs, and the joiner the state of its router."""
    run, _ = hosted(2)
    nowhere = free_endpoint()
    joined = start("join", nowhere)
    assert line_with(joined, "waiting for a router") == f"waiting for a router at {nowhere} (connection refused)"
    assert "u004, u005" in line_with(run, "to connect")
    for command in (run, joined):
        command.process.send_signal(signal.SIGINT)
        assert command.end().status == 1


def line_with(command: Started, words: str) -> str:
    """Return the line with these words that a command prints on standard error."""
    assert command.process.stderr is not None
    return next(line.strip() for line in command.process.stderr if words in line)


@pytest.mark.long
def test_who_was_away_flies_what_is_left(start: Fly, hosted: Hosted, tmp_path: Path) -> None:
    """Before the mission the operator issues the id of an absent joiner to another; the joiner then claims again."""
    run, address = hosted(2)
    folder = tmp_path / "away"
    away = start("join", address, "--state", str(folder))
    (first,) = ids_of(away, folder)
    pids = away.pids()
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    await_gone(address, JOIN)
    assert claimed(address, 2) == {"u004", "u005"}
    await_gone(address, JOIN)
    third = start("join", address, "--state", str(tmp_path / "third"))
    assert ids_of(third, tmp_path / "third") == {first}
    for pid in pids:
        os.kill(pid, signal.SIGCONT)
    ended = run.end()
    assert ended.status == 0, ended.stderr
    claimants = {fix.uav: fix.instance[-16:] for fix in ended.recording.fixes}
    assert claimants[first] == (tmp_path / "third" / "claimant").read_text()
    assert (folder / "claimant").read_text() in claimants.values()
    assert [command.end().status for command in (away, third)] == [0, 0]


class Parts:
    """Router, recorder and visualiser as services, each started by itself; with `certs` on a secured bus."""

    def __init__(self, start: Callable[..., Started], folder: Path, certs: Path | None = None) -> None:
        self._start = start
        self.folder = folder
        self._own = ["--certs", str(certs)] if certs is not None else []
        self.address = free_endpoint("tls" if certs is not None else "tcp")
        self.parts = {name: self._run(name, self.address, *self._own) for name in ("recorder", "visualiser")}
        self.start_router()

    def start_router(self) -> None:
        """Start the router for one mission."""
        self.parts["router"] = self._run("router", self.address, "mission", *self._own[1:])

    def _run(self, module: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"processes.services.{module}", *arguments]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def operate(self, *arguments: str, **options: str) -> Started:
        """Start an operator."""
        secure = ["--secure", *self._own] if self._own else []
        return self._start("run", *FAST, "--operate", self.address, *secure, *arguments, **options)

    def join(self, name: str) -> Started:
        """Start a joiner with a folder of its own."""
        return self._start("join", self.address, "--state", str(self.folder / name), *self._own)

    def await_end(self) -> None:
        """Wait until every part has ended by itself."""
        assert [part.wait(30) for part in self.parts.values()] == [0] * len(self.parts)

    def kill(self) -> None:
        """Kill all parts."""
        for part in self.parts.values():
            part.kill()
            part.wait()


@pytest.fixture(params=["open"])
def parts(start: Fly, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Parts]:
    """Start the parts of a bus."""
    certs = tmp_path / "certs" if request.param == "secured" else None
    if certs is not None:
        write_certificates(certs, [f"u00{number}" for number in range(1, 6)])
    made = Parts(start, tmp_path, certs)
    yield made
    made.kill()


@pytest.mark.long
@either
def test_everything_run_by_others(parts: Parts) -> None:
    """The operator is the first to leave, and every part ends by itself."""
    joined = [parts.join(f"{number}") for number in range(5)]
    operator = parts.operate()
    operator.process.wait()
    assert all(command.process.poll() is None for command in joined)
    ended = operator.end()
    assert ended.status == 0, ended.stderr
    assert not find_gaps(ended.recording)
    assert ended.recording.run_end is not None
    assert [command.end().status for command in joined] == [0] * 5
    parts.await_end()


@pytest.mark.long
@either
def test_an_operator_that_died_is_taken_over_from(parts: Parts) -> None:
    """The mission continues in one recording, and no further claimant gets an id."""
    joined = [parts.join(f"{number}") for number in range(5)]
    first = parts.operate()
    part = first.path.with_name("run.mcap.part")
    first.await_file(first.has_fixes)
    first.process.kill()
    second = parts.operate()
    stranger = parts.join("stranger").end()
    assert stranger.status == 2
    ended = second.end()
    assert "taking over mission" in ended.stderr
    assert not part.exists()
    assert not broken(ended) & SAFE, ended.stdout
    assert ended.json["arrived"] == 5
    assert len({fix.instance for fix in ended.recording.fixes}) == 5
    assert [command.end().status for command in joined] == [0] * 5
    parts.await_end()


@pytest.mark.long
def test_faults_in_force_are_told_again_after_a_takeover(parts: Parts) -> None:
    """A UAV that the next operator restarts is as cut off as its first instance.

    The restart comes late if it falls into the time without an operator: on a busy machine this is longer than 40 s of
    the mission.
    """
    faults = ("partition u001,u002,u004,u005>u003 @4 for 90s", "restart u003 @80")
    words = (*HOLD, "--speed-max", "1", *(word for fault in faults for word in ("--fault", fault)))
    joined = [parts.join(f"{number}") for number in range(5)]
    first = parts.operate(*words)
    part = first.path.with_name("run.mcap.part")
    first.await_file(lambda: first.has_fixes() and bool(_faults(_written(part))))
    first.process.kill()
    ended = parts.operate(*words).end()
    assert not broken(ended) & SAFE, ended.stdout
    recording = ended.recording
    assert [fault.split()[0] for fault in _faults(recording)] == ["partition", "restart"]
    again = [fix for fix in recording.fixes if fix.uav == "u003"]
    deaf = [fix for fix in again if fix.instance == again[-1].instance != again[0].instance and fix.slot < 180]
    assert deaf
    assert not any(fix.executing for fix in deaf)
    assert [command.end().status for command in joined] == [0] * 5
    parts.await_end()


@pytest.mark.long
def test_who_landed_before_a_takeover_is_not_missed_after_it(parts: Parts) -> None:
    """The process of such a UAV has ended in order: the next operator does not call it gone."""
    words = ("--speed-max", "1", "--fault", "partition u005|rest @4")
    joined = [parts.join(f"{number}") for number in range(5)]
    first = parts.operate(*words)
    part = first.path.with_name("run.mcap.part")
    first.await_file(lambda: first.has_fixes() and any(e.kind == "landed" for e in _written(part).events))
    first.process.kill()
    ended = parts.operate(*words).end()
    assert "taking over mission" in ended.stderr
    assert "u005 has gone from the bus" not in ended.stderr
    assert "exited" not in {event.kind for event in ended.recording.events}
    assert [command.end().status for command in joined] == [0] * 5
    parts.await_end()


def _written(part: Path) -> Recording:
    return read_recording(part, salvage=True)


def _faults(recording: Recording) -> list[str]:
    return [event.detail for event in recording.events if event.kind == "fault"]


@either
def test_an_operator_that_gives_up_ends_everything(parts: Parts) -> None:
    """Waiting parts and late parts get the notice; the operator's error is the one line about the option."""
    waiting = parts.join("waiting")
    given_up = parts.operate("--planner", "nonsense").end()
    assert given_up.status == 2
    assert given_up.stderr.startswith("error: --planner = 'nonsense': must be")
    for joined in (waiting, parts.join("late")):
        ended = joined.end()
        assert ended.status == 2
        assert f"there is no mission at {parts.address}: its operator has ended" in ended.stderr
    assert [parts.parts[name].wait(30) for name in ("recorder", "visualiser")] == [2, 2]
    parts.parts["router"].terminate()
    assert parts.parts["router"].wait(30) == 0


def test_who_gives_up_is_the_first_to_leave_and_keeps_its_status(parts: Parts) -> None:
    """Compose ends all services after the first that ends, and may return the status of the operator."""
    waiting = parts.join("waiting")
    given_up = parts.operate("--planner", "nonsense")
    await_there(parts.address, f"{NOTICE_KEY}/*")
    given_up.process.terminate()
    assert given_up.process.wait() == 2
    assert waiting.process.poll() is None
    assert waiting.end().status == 2


def await_there(address: str, token: str) -> None:
    """Wait for a liveliness token."""
    with open_client(address) as session:
        await_true(lambda: any(reply.ok is not None for reply in session.liveliness().get(token)))


def test_a_router_that_has_just_begun_to_listen_hears_the_word(start: Fly) -> None:
    """SIGTERM reaches the aborting operator a second before that router sees its token."""
    address = free_endpoint()
    given_up = start("run", *FAST, "--operate", address, "--planner", "nonsense")
    assert given_up.process.stderr is not None
    assert given_up.process.stderr.readline().startswith("error: --planner = ")
    slowly = "router._route_one_mission = lambda *told: time.sleep(1) or route(*told)"
    script = f"import sys, time; from processes.services import router; route = router._route_one_mission; {slowly}"
    command = [sys.executable, "-c", f"{script}; sys.exit(router.main())", address, "mission"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as router:
        await_there(address, f"{NOTICE_KEY}/*")
        given_up.process.terminate()
        assert given_up.end().status == 2
        assert start("join", address).end().status == 2
        router.terminate()
        assert router.wait() == 0


def test_a_router_waits_for_an_operator_only_so_long(start: Fly) -> None:
    """Without any operator, every part ends with one line."""
    address = free_endpoint()
    script = "import sys; from processes.services import router; router.NO_OPERATOR_S = 0.5; sys.exit(router.main())"
    command = [sys.executable, "-c", script, address, "mission"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as router:
        joined = start("join", address).end()
        assert joined.status == 2
        assert f"there is no mission at {address}" in joined.stderr
        router.terminate()
        assert router.wait() == 1
        assert router.stderr is not None
        assert router.stderr.read() == "router: no operator has come within 0.5 s\n"


@pytest.mark.long
def test_told_to_stop_all_at_once_the_record_has_every_last_word(parts: Parts) -> None:
    """Compose stops all at once, the recorder too: the recorder waits for the others."""
    joined = [parts.join(f"{number}") for number in range(5)]
    operator = parts.operate("--speed-max", "1")
    part = operator.path.with_name("run.mcap.part")
    operator.await_file(lambda: part.exists() and operator.has_fixes())
    parts.parts["recorder"].terminate()
    for command in (operator, *joined):
        command.process.terminate()
    parts.parts["visualiser"].terminate()
    ended = operator.end()
    assert ended.status == 1
    assert "interrupted" in ended.stderr
    assert not find_gaps(ended.recording)
    assert not unknown_tails(ended.recording)
    assert {command.end().status for command in joined} <= {0, 1}
    parts.await_end()


def test_ctrl_c_of_an_operator_without_a_recorder(start: Fly, endpoint: str) -> None:
    """No mission was flown and no file is written; no line mentions a recording."""
    operator = start("run", *FAST, "--operate", endpoint)
    with open_client(endpoint) as session:
        operators = OperatorPresence(session)
        await_true(lambda: bool(operators.missions()))
    operator.process.send_signal(signal.SIGINT)
    ended = operator.end()
    assert (ended.status, ended.stdout) == (1, "")
    assert ended.stderr.splitlines()[-1] == "interrupted"
    assert not list(ended.path.parent.glob("run.*"))


@pytest.mark.long
def test_a_bad_option_ends_no_mission(parts: Parts) -> None:
    """A mistyped command of another user at the same router disturbs no flying or waiting part."""
    joined = [parts.join(f"{number}") for number in range(4)]
    operator = parts.operate()
    ids_of(joined[0], parts.folder / "0")
    assert parts.operate("--uavs", "none", name="mistyped.mcap").end().status == 2
    joined.append(parts.join("4"))
    assert operator.end().status == 0
    assert [command.end().status for command in joined] == [0] * 5
    parts.await_end()


@pytest.mark.long
@pytest.mark.parametrize("lost", ["operator", "router"])
def test_ids_are_known_again_after_a_restart(parts: Parts, tmp_path: Path, lost: str) -> None:
    """Before the mission, a new operator learns the ids from the tokens on the bus."""
    operator = parts.operate()
    early = [parts.join(name) for name in ("a", "b")]
    before = [ids_of(command, tmp_path / name) for command, name in zip(early, ("a", "b"), strict=True)]
    if lost == "operator":
        operator.process.kill()
        operator = parts.operate()
    else:
        parts.parts["router"].kill()
        parts.parts["router"].wait()
        parts.start_router()
    late = [parts.join(name) for name in ("c", "d", "e")]
    ended = operator.end()
    assert ended.status == 0, ended.stderr
    claimants = {fix.uav: fix.instance[-16:] for fix in ended.recording.fixes}
    for name, uavs in zip(("a", "b"), before, strict=True):
        assert {claimants[uav] for uav in uavs} == {(tmp_path / name / "claimant").read_text()}
    assert len(set(claimants.values())) == 5
    assert [command.end().status for command in early + late] == [0] * 5
    await_true(lambda: all(part.poll() is not None for part in parts.parts.values()), 30)
