"""Real files from which another tool has cut, or that hold nothing of a mission: no verdict and no count of nothing."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from processes.cli.main import main

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden.mcap"
UNKNOWN = ("potential_collisions", "true_collisions", "energy_propulsion_j", "path_m", "slots_missed", "slots_held")


def rewritten(
    path: Path, share: float = 1.0, run_end: bool = True, prefix: str = "", without: tuple[str, ...] = ()
) -> Path:
    """Write the golden recording's messages up to `share` of its time, as the official library does, to `path`.

    Topics that contain one of `without` are left out.
    """
    with GOLDEN.open("rb") as source, path.open("wb") as stream:
        reader, writer = make_reader(source), Writer(stream)
        writer.start()
        messages = list(reader.iter_messages(log_time_order=False))
        first_ns, last_ns = (pick(m.log_time for _, _, m in messages) for pick in (min, max))
        numbers: dict[str, int] = {}
        for schema, channel, message in messages:
            topic = prefix + channel.topic
            if any(part in topic for part in without):
                continue
            if topic not in numbers:
                described = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                numbers[topic] = writer.register_channel(topic, channel.message_encoding, described)
            if message.log_time <= first_ns + share * (last_ns - first_ns):
                times = message.publish_time, message.sequence
                writer.add_message(numbers[topic], message.log_time, message.data, *times)
        for attachment in reader.iter_attachments():
            times = attachment.create_time, attachment.log_time
            writer.add_attachment(*times, attachment.name, attachment.media_type, attachment.data)
        for metadata in reader.iter_metadata():
            if run_end or metadata.name != "run_end":
                writer.add_metadata(metadata.name, metadata.metadata)
        writer.finish()
    return path


def said(capsys: pytest.CaptureFixture[str], command: str, path: Path, status: int) -> dict[str, object]:
    """Return what a command says of a file as JSON; `check` by guarantee."""
    assert main([command, str(path), "--json"]) == status
    found = msgspec.json.decode(capsys.readouterr().out)
    return found if isinstance(found, dict) else {result["guarantee"]: result["status"] for result in found}


def test_a_page_is_named_like_its_file(tmp_path: Path) -> None:
    """With the number of UAVs; the mission of a run has a name of its own on the bus, which tells a reader nothing."""
    page = tmp_path / "page.html"
    assert main(["report", str(GOLDEN), "--out", str(page)]) == 0
    assert "<h1>golden, 4 UAVs</h1>" in page.read_text()


def test_the_whole_file_is_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rewritten by another tool, nothing of it changes."""
    path = rewritten(tmp_path / "whole.mcap", 1.0)
    assert said(capsys, "metrics", path, 0) == said(capsys, "metrics", GOLDEN, 0)
    assert said(capsys, "check", path, 0) == said(capsys, "check", GOLDEN, 0)
    assert main(["recover", str(path)]) == 0


@pytest.mark.parametrize(("run_end", "status", "complete"), [(True, 1, "broken"), (False, 3, "not-judged")])
def test_a_cut_file_proves_nothing(
    run_end: bool, status: int, complete: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Half of the time is missing; only `run_end` knows how many messages there were."""
    path = rewritten(tmp_path / "cut.mcap", 0.5, run_end=run_end)
    verdicts = said(capsys, "check", path, status)
    assert verdicts["G5"] == complete
    assert {verdicts[name] for name in ("G1", "G2", "G3", "G4", "G7")} == {"not-judged"}
    metrics = said(capsys, "metrics", path, 0)
    assert [metrics[name] for name in (*UNKNOWN, "completed", "gaps")] == [None] * (len(UNKNOWN) + 2)


def test_a_file_of_foreign_topics_proves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Only the attached mission is one of ours: no message of the swarm is there to judge by."""
    path = rewritten(tmp_path / "foreign.mcap", 1.0, run_end=False, prefix="/other/")
    verdicts = said(capsys, "check", path, 3)
    assert {verdicts[name] for name in ("G1", "G2", "G3", "G4", "G5", "G7")} == {"not-judged"}
    metrics = said(capsys, "metrics", path, 0)
    assert [metrics[name] for name in (*UNKNOWN, "completed", "gaps", "ticks_late_pct")] == [None] * (len(UNKNOWN) + 3)
    assert main(["check", str(path)]) == 3
    assert "unknown topics: " in capsys.readouterr().out


def test_recover_tells_by_its_status_what_is_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """1 where bytes are unreadable, as text and as JSON; 0 where nothing is."""
    torn = tmp_path / "torn.mcap.part"
    torn.write_bytes(GOLDEN.read_bytes()[:-3000])
    assert main(["recover", str(torn)]) == 1
    assert "missing: torn: " in capsys.readouterr().err
    assert said(capsys, "recover", rewritten(tmp_path / "whole.mcap", 1.0), 0)["missing"] == []


NOTHING_FOUND = (
    "slots",
    "duration_s",
    "arrived",
    "completed",
    "goals_reached",
    "straight_m",
    "ticks_late_pct",
    "path_m",
)


@pytest.mark.parametrize(
    "without", [("/fix",), ("/fix", "/truth", "/report"), ("/fix", "/truth", "/report", "/command")]
)
def test_without_fixes_nobody_has_arrived_stayed_away_or_died(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], without: tuple[str, ...]
) -> None:
    """Nothing is known of the UAVs: no row of the metrics, no line of `check`, the story or the page says otherwise."""
    path = rewritten(tmp_path / "cut.mcap", without=without)
    metrics, uavs = said(capsys, "metrics", path, 0), ["u001", "u002", "u003", "u004"]
    assert {name: metrics[name] for name in NOTHING_FOUND} == dict.fromkeys(NOTHING_FOUND)
    assert (metrics["not_living"], metrics["unknown"], metrics["landed"], metrics["faults_undone"]) == (
        [],
        uavs,
        [],
        [],
    )
    assert main(["metrics", str(path)]) == 0
    rows = capsys.readouterr().out
    assert "- of 4; 4 unknown" in rows
    assert "not living" not in rows
    assert "not home" not in rows
    assert main(["check", str(path)]) == 1, "messages are missing"
    told = capsys.readouterr().out
    assert "not home" not in told
    assert "u003: unknown: the record holds no fix of it" in told
    assert main(["events", str(path)]) == 0
    assert "u001, u002, u003, u004: the record" in capsys.readouterr().out
    assert main(["report", str(path), "--out", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text()
    assert "The record does not tell how many of 4 UAVs arrived" in page
    assert "0 of 4" not in page


def test_one_uav_without_fixes_is_unknown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The others are counted; sums, shares and least values of all are unknown."""
    path = rewritten(tmp_path / "cut.mcap", without=("u001/fix",))
    metrics = said(capsys, "metrics", path, 0)
    assert (metrics["arrived"], metrics["unknown"], metrics["not_living"]) == (3, ["u001"], [])
    for name in ("completed", "min_disc_gap_m", "min_true_distance_m", "path_m", "ticks_late_pct", "slots_held"):
        assert metrics[name] is None, name


@pytest.mark.parametrize(
    ("without", "unknown"),
    [
        ("/truth", ("true_collisions", "min_true_distance_m", "max_deviation_m")),
        ("/command", ("slots_held", "slots_missed", "makespan_s", "energy_propulsion_j")),
        ("/report", ("failover_slots", "energy_compute_j", "slots_held_by")),
    ],
)
def test_what_only_a_missing_kind_tells_is_unknown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], without: str, unknown: tuple[str, ...]
) -> None:
    """Arrivals are told by fixes alone; each other kind takes its own metrics with it."""
    metrics = said(capsys, "metrics", rewritten(tmp_path / "cut.mcap", without=(without,)), 0)
    assert (metrics["arrived"], metrics["completed"], metrics["unknown"]) == (4, True, [])
    assert {name: metrics[name] for name in unknown} == dict.fromkeys(unknown)
