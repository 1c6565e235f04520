"""`edc-swarm merge`: the golden recording as several recorders have it, each a part, made one again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from edc_swarm.protocol.codec import encode
from edc_swarm.protocol.messages import Event
from edc_swarm.recording.mcap_file import McapFile, Raw
from edc_swarm.recording.reader import read_recording
from edc_swarm.recording.sequences import find_gaps
from edc_swarm.recording.writer import RecordingWriter
from processes.cli.main import main

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden.mcap"
Keep = Callable[[str, int], bool]
HERE, THERE = ("u001", "u002"), ("u003", "u004")
LOST = "u001/fix"


def written(path: Path, keep: Keep, change: Callable[[Raw], Raw] = lambda raw: raw) -> Path:
    """Write the golden recording's messages whose topic and number `keep` wants, as a recorder does, to `path`."""
    source = McapFile(GOLDEN)
    messages = list(source.messages())
    with path.open("wb") as stream:
        writer = RecordingWriter(stream, source.metadata["run"])
        for name, (media_type, data) in source.attachments.items():
            writer.attach(name, media_type, data)
        for channel, sequence, log_ns, sent_ns, payload in map(change, messages):
            if keep(channel.topic, sequence):
                writer.copy(channel, payload, log_ns, sent_ns, sequence)
        writer.finish({name: value for name, value in source.metadata["run_end"].items() if name != "messages"})
    return path


def without(uavs: tuple[str, ...], *lost: tuple[str, int]) -> Keep:
    """Return what a recorder keeps that hears all but the fixes, truths and commands of `uavs`, and loses `lost`."""

    def keep(topic: str, sequence: int) -> bool:
        is_other = any(f"/uav/{uav}/" in topic or topic.endswith(f"/command/{uav}") for uav in uavs)
        return not is_other and not any(part in topic and sequence == number for part, number in lost)

    return keep


def merged(capsys: pytest.CaptureFixture[str], *files: Path, status: int = 0) -> tuple[dict[str, Any], Path]:
    """Merge the files; return what is said as JSON, and the result."""
    out = files[0].with_name("all.mcap")
    assert main(["merge", *map(str, files), "-o", str(out), "--force", "--json"]) == status
    return msgspec.json.decode(capsys.readouterr().out), out


def verdicts(capsys: pytest.CaptureFixture[str], path: Path) -> dict[str, tuple[str, list[dict[str, str]]]]:
    """Return status and violations of each guarantee."""
    main(["check", str(path), "--json"])
    found = msgspec.json.decode(capsys.readouterr().out)
    return {each["guarantee"]: (each["status"], each["violations"]) for each in found}


def test_two_halves_with_an_overlap_are_the_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each host's recorder alone lacks the other's UAVs; together they are the recording of one that hears all."""
    here, there = (written(tmp_path / f"{uavs[0]}.mcap", without(uavs)) for uavs in (THERE, HERE))
    assert verdicts(capsys, here)["G5"][0] != "held"
    said, out = merged(capsys, here, there)
    assert (said["gaps"], said["contradictions"], said["torn"]) == (0, 0, [])
    assert all(lacking > 0 for lacking in said["lacking"])
    one, whole = read_recording(out), read_recording(GOLDEN)
    assert (one.lists(), one.duplicates, one.garbage) == (whole.lists(), whole.duplicates, whole.garbage)
    assert verdicts(capsys, out) == verdicts(capsys, GOLDEN)
    times = [log_ns for _, _, log_ns, _, _ in McapFile(out).messages()]
    assert times == sorted(times)
    assert merged(capsys, there, here)[0]["messages"] == said["messages"] == whole.message_count


def test_what_one_recorder_lost_the_other_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A gap of one file is closed; the same gap in both stays, is named by G5, and fails the merge."""
    files = [
        written(tmp_path / "a.mcap", without((), (LOST, 5), (LOST, 6))),
        written(tmp_path / "b.mcap", without((), (LOST, 6), (LOST, 7))),
    ]
    assert [sum(gap.count for gap in find_gaps(read_recording(file))) for file in files] == [2, 2]
    said, out = merged(capsys, *files, status=1)
    assert (said["gaps"], said["lacking"]) == (1, [1, 1])
    status, violations = verdicts(capsys, out)["G5"]
    assert status == "broken"
    assert [violation["kind"] for violation in violations] == ["gap"]
    assert "messages 6 to 6 are missing (1)" in violations[0]["text"]
    assert f"uav/{LOST}" in violations[0]["text"]
    said, out = merged(capsys, files[0], written(tmp_path / "c.mcap", without(())), status=0)
    assert verdicts(capsys, out)["G5"][0] == "held"


def test_a_contradiction_is_told_and_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two files have message 5 of one UAV with different contents: no one can say which was published."""

    def changed(raw: Raw) -> Raw:
        channel, sequence, log_ns, sent_ns, payload = raw
        if LOST in channel.topic and sequence == 5:
            payload = payload.replace(b'"r_m":5.0', b'"r_m":5.5')
        return channel, sequence, log_ns, sent_ns, payload

    files = [written(tmp_path / "a.mcap", without(())), written(tmp_path / "b.mcap", without(()), changed)]
    said, out = merged(capsys, *files, status=1)
    assert said["contradictions"] == len(said["contradictory"]) == 1
    assert f"uav/{LOST} of " in said["contradictory"][0]
    status, violations = verdicts(capsys, out)["G5"]
    assert (status, [violation["kind"] for violation in violations]) == ("broken", ["duplicate"])


def test_a_torn_file_gives_what_it_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is torn off is told; the other recorder has it, or nobody knows whether there was more."""
    torn, whole = tmp_path / "torn.mcap", written(tmp_path / "whole.mcap", without(()))
    torn.write_bytes(GOLDEN.read_bytes()[:-3000])
    said, out = merged(capsys, torn, whole)
    assert (said["gaps"], len(said["torn"])) == (0, 1)
    assert said["torn"][0].startswith(f"{torn}: torn: ")
    assert verdicts(capsys, out) == verdicts(capsys, GOLDEN)
    other, data = tmp_path / "other.mcap", GOLDEN.read_bytes()
    for path, share in ((torn, 0.6), (other, 0.7)):
        path.write_bytes(data[: int(share * len(data))])
    assert main(["merge", str(torn), str(other), "-o", str(out), "--force"]) == 0
    said_of = [line.split(": ")[1] for line in capsys.readouterr().err.splitlines() if line.startswith("torn: ")]
    assert said_of == [str(torn), str(other)]
    assert verdicts(capsys, out)["G5"][0] == "not-judged"


@pytest.mark.parametrize("left", [0, 5, 30, 700], ids=lambda left: f"{left} bytes")
def test_a_file_that_is_torn_before_its_mission_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], left: int
) -> None:
    """The others make the recording, which says so; whether that recorder dropped messages is unknown."""
    early, whole = tmp_path / "early.mcap", written(tmp_path / "whole.mcap", without(()))
    early.write_bytes(GOLDEN.read_bytes()[:left])
    for files, lacking in (([early, whole], [None, 0]), ([whole, early], [0, None])):
        said, out = merged(capsys, *files)
        assert (said["lacking"], said["torn"]) == (lacking, [])
        (line,) = said["left_out"]
        assert line.startswith(f"{early}: ")
        assert verdicts(capsys, out) == verdicts(capsys, GOLDEN)
        end = McapFile(out)
        list(end.messages())
        assert end.metadata["run_end"]["merged"] == f"1 recordings; left out: {line}"
        assert "dropped" not in end.metadata["run_end"]
    assert main(["merge", str(early), str(whole), "-o", str(out), "--force"]) == 0
    assert f"left out: {early}: " in capsys.readouterr().err


def test_nothing_is_left_to_merge(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every file is torn before its mission: one line, and no result."""
    files = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for path, left in zip(files, (0, 700), strict=True):
        path.write_bytes(GOLDEN.read_bytes()[:left])
    assert main(["merge", *map(str, files), "-o", str(tmp_path / "all.mcap")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "holds no mission, and none of 2 files does" in line
    assert not (tmp_path / "all.mcap").exists()


def test_what_cannot_be_merged_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another mission, one file, a result that is one of the sources, a file that is no recording."""
    other = tmp_path / "other.mcap"
    assert main(["sim", "--uavs", "2", "--max-slots", "3", "--out", str(other)]) in {0, 1, 3}
    whole, result = written(tmp_path / "whole.mcap", without(())), tmp_path / "all.mcap"
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(b"noise")
    link = tmp_path / "link.mcap"
    link.symlink_to(whole)
    capsys.readouterr()
    for files, out, reason in (
        ([whole, other], result, "must be a readable recording; it has mission "),
        ([whole], result, "recordings = 1: must be from 2 to 100 files"),
        ([whole, GOLDEN, link], result, f"recordings = '{link}': must be another file than {whole}"),
        ([whole, GOLDEN], whole, "must be another file than those that are merged"),
        ([whole, noise], result, "is not an MCAP file"),
    ):
        assert main(["merge", *map(str, files), "-o", str(out)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert reason in line
    assert not result.exists()


def test_garbage_is_there_as_often_as_one_recorder_has_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two recorders hear the same two equal payloads, at times of their own."""
    files = []
    for delay_ns in (0, 1000):
        files.append(path := tmp_path / f"{delay_ns}.mcap")
        source = McapFile(GOLDEN)
        messages = list(source.messages())
        with path.open("wb") as stream:
            writer = RecordingWriter(stream, source.metadata["run"])
            for channel, _, log_ns, _, payload in messages:
                writer.write(channel.topic, payload, log_ns + delay_ns)
            for _ in range(2):
                writer.write(messages[-1][0].topic, b"noise", log_ns + delay_ns)
            writer.finish({})
    said, out = merged(capsys, *files)
    assert said["messages"] == read_recording(GOLDEN).message_count
    assert sum(payload == b"noise" for *_, payload in McapFile(out).messages()) == 2


@pytest.mark.parametrize("dropped", [["0", "0"], ["0", None], [None, None]])
def test_a_recorder_without_its_end_has_an_unknown_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], dropped: list[str | None]
) -> None:
    """A recorder is torn right after its event and that of the operator's end: no result says that it said no more."""
    files = []
    for number, count in enumerate(dropped):
        source = McapFile(GOLDEN)
        messages = list(source.messages())
        at_ns = messages[-1][3]
        said = Event(source="recorder", instance=f"{number}-{number:08}", sent_ns=at_ns, slot=24, kind="malformed")
        files.append(path := tmp_path / f"{number}.mcap")
        with path.open("wb") as stream:
            writer = RecordingWriter(stream, source.metadata["run"])
            for channel, sequence, log_ns, sent_ns, payload in messages:
                writer.copy(channel, payload, log_ns, sent_ns, sequence)
            writer.write(f"{messages[-1][0].topic.rpartition('/')[0]}/recorder", encode(said), messages[-1][2])
            writer.finish({"dropped": count} if count is not None else {})
    _, out = merged(capsys, *files)
    assert verdicts(capsys, out)["G5"][0] == ("not-judged" if None in dropped else "held")
