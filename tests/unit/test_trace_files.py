"""Trace files: what is read from tables and lists, whatever their form, and one line for each file that is refused."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.mission.roster import complete_mission
from edc_swarm.mission.trace import MAX_PACKED, MAX_ROWS, Rows, Trace, check_traces, pack, unpack
from edc_swarm.mission.trace_file import MAX_TRACE_BYTES
from edc_swarm.mission.validation import load_mission, with_traces

COLUMNS: dict[str, str | int] = {"sent": "sent", "delay": "delay"}
TABLE = "sent,delay\n100,20\n155,21.5\n210,0\n"
EXCERPT = Path("scenarios/measured_5g.toml")


def read(folder: Path, content: str | bytes, **fields: object) -> Mission:
    """Return the mission with a link that reads a file of this content."""
    data = content.encode() if isinstance(content, str) else content
    (folder / "net.csv").write_bytes(data)
    link = Link(**{"trace": "net.csv", "trace_columns": COLUMNS, **fields})  # type: ignore[arg-type]
    return with_traces(Mission(link=[link]), folder)


def rows_of(mission: Mission) -> Rows:
    """Return the rows of the mission's only trace."""
    (trace,) = mission.trace
    return unpack(trace)


@pytest.mark.parametrize(
    "content",
    [
        TABLE,
        TABLE.replace(",", ";"),
        TABLE.replace(".", "!").replace(",", ";").replace("!", ","),
        TABLE.replace(",", "\t"),
        TABLE.replace(",", "   "),
        TABLE.replace("\n", "\r\n"),
        "# a comment\n\n" + TABLE,
        '"sent","delay"\n"100","20"\n155,21.5\n210,0\n',
        TABLE.encode("utf-8-sig"),
        TABLE.encode("utf-16"),
        TABLE.replace("delay", "delay,µ").encode("latin-1"),
    ],
)
def test_the_form_of_a_table_does_not_matter(tmp_path: Path, content: str | bytes) -> None:
    """Separators, decimal commas, line ends, quotes, comments and encodings."""
    rows = rows_of(read(tmp_path, content))
    assert (list(rows.at_us), list(rows.delay_us), rows.period_us) == (
        [0, 55_000, 110_000],
        [20_000, 21_500, 0],
        165_000,
    )


def test_columns_by_number_need_no_header(tmp_path: Path) -> None:
    """A header is skipped where there is one."""
    numbers: dict[str, str | int] = {"sent": 1, "delay": 2}
    bare = rows_of(read(tmp_path, "100,20\n155,21.5\n210,0\n", trace_columns=numbers))
    assert list(bare.delay_us) == [20_000, 21_500, 0]
    assert list(rows_of(read(tmp_path, TABLE, trace_columns=numbers)).delay_us) == [20_000, 21_500, 0]


def test_received_units_and_round_trips(tmp_path: Path) -> None:
    """A delay is received minus sent, in the unit of the columns; a round trip counts half."""
    columns: dict[str, str | int] = {"sent": "a", "received": "b"}
    both = rows_of(read(tmp_path, "a b\n1.5 1.504\n1.6 1.601\n", trace_columns=columns, trace_unit="s"))
    assert (list(both.at_us), list(both.delay_us)) == ([0, 100_000], [4_000, 1_000])
    half = read(tmp_path, "a b\n1722583338971000001 1722583338971004001\n1722583338971000501 1722583338971000501\n",
                trace_columns=columns, trace_unit="ns", round_trip=True)  # fmt: skip
    assert list(rows_of(half).delay_us) == [2, 0]


def test_delivery_opportunities(tmp_path: Path) -> None:
    """One millisecond a line; the list begins again at its last millisecond."""
    mission = read(tmp_path, "5\n5\n10\n", trace_columns={})
    rows = rows_of(mission)
    assert mission.trace[0].kind == "opportunities"
    assert (list(rows.at_us), rows.period_us) == ([0, 0, 5_000], 10_000)


REFUSED: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "empty"),
    "no rows": ("sent,delay\n", "0 rows"),
    "one row": ("sent,delay\n1,1\n", "1 rows"),
    "no such column": ("sent,other\n1,1\n2,1\n", "sent, other"),
    "two such columns": ("sent,delay,delay\n1,1,1\n2,1,1\n", "sent, delay, delay"),
    "negative": ("sent,delay\n1,1\n2,-3\n", "line 3: 1 ms after the line above, delay -3 ms"),
    "unsorted": ("sent,delay\n2,1\n1,1\n", "line 3 was sent before the line above"),
    "nan": ("sent,delay\n1,1\n2,nan\n", "nan in column 2 of line 3"),
    "infinite": ("sent,delay\n1,1\n2,inf\n", "inf in column 2 of line 3"),
    "beyond all limits": ("sent,delay\n1,1\n2,1e300\n", "1e300 in column 2 of line 3"),
    "words": ("sent,delay\n1,1\n2,soon\n", "soon in column 2 of line 3"),
    "no number": ("sent,delay\n1,1\n2,\n", "nothing in column 2 of line 3"),
    "short": ("sent,delay\n1,1\n2\n", "line 3"),
    "binary": (bytes(range(256)), "a binary file"),
    "odd UTF-16": (b"\xff\xfea", "a binary file"),
    "many rows": ("sent,delay\n" + "1,1\n" * (MAX_ROWS + 1), f"more than {MAX_ROWS} rows"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    """The line names the file, where it is wrong, and what is allowed."""
    content, said = REFUSED[case]
    with pytest.raises(MissionError) as caught:
        read(tmp_path, content)
    line = str(caught.value)
    assert said in line
    assert "net.csv" in line
    assert line.startswith("link[0].trace")
    assert "\n" not in line


@pytest.mark.parametrize("content", ["1\n2\nx\n", "3\n2\n", "1.5\n2\n", "-1\n2\n", "0\n0\n"])
def test_bad_opportunities_are_refused(tmp_path: Path, content: str) -> None:
    """Whole milliseconds, in order, that end after 0."""
    with pytest.raises(MissionError, match=r"link\[0\]\.trace"):
        read(tmp_path, content, trace_columns={})


def test_a_table_needs_columns_and_known_ones(tmp_path: Path) -> None:
    """Either sent and received, or sent and delay; a number within the table."""
    for columns in ({}, {"sent": 1}, {"sent": 1, "delai": 2}, {"sent": 1, "delay": 3}):
        with pytest.raises(MissionError, match=r"trace_columns"):
            read(tmp_path, TABLE, trace_columns=columns)
    with pytest.raises(MissionError, match="separated by commas, semicolons, tabs or spaces"):
        read(tmp_path, TABLE.replace(",", "|"))
    with pytest.raises(MissionError, match="a whole number from 1 to 1000"):
        load_mission(written(tmp_path, '[[link]]\ntrace = "net.csv"\ntrace_columns = { sent = 0, delay = 2 }'))
    with pytest.raises(MissionError, match="left out without a trace"):
        complete_mission(load_mission(written(tmp_path, "[[link]]\ntrace_columns = { sent = 1, delay = 2 }")))


def written(folder: Path, text: str) -> Path:
    """Return a mission file with this text."""
    path = folder / "mission.toml"
    path.write_text(text)
    return path


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    """Nothing there, a folder, a device that never ends, a gigabyte: nothing of it is waited for or kept."""
    with open(tmp_path / "huge.csv", "wb") as huge:
        huge.truncate(1 << 30)
    for name, said in {
        "no.csv": "No such file",
        ".": "a folder",
        "/dev/zero": "a device",
        "huge.csv": "at most",
    }.items():
        text = f'[[link]]\ntrace = "{name}"\ntrace_columns = {{ sent = 1, delay = 2 }}\n'
        with pytest.raises(MissionError, match=said):
            load_mission(written(tmp_path, text))
    assert MAX_TRACE_BYTES < 1 << 30


def test_links_share_what_they_read_alike(tmp_path: Path) -> None:
    """Two links with the same reading share a table; another reading of the file is another table."""
    (tmp_path / "net.csv").write_text(TABLE)
    fast = Link(trace="net.csv", trace_columns=COLUMNS)
    slow = Link(trace="net.csv", trace_columns=COLUMNS, trace_unit="s")
    mission = with_traces(Mission(link=[fast, slow, fast]), tmp_path)
    assert [link.trace for link in mission.link] == ["net.csv", "net.csv 2", "net.csv"]
    assert [trace.name for trace in mission.trace] == ["net.csv", "net.csv 2"]
    assert with_traces(mission, Path("/nowhere")) == mission


def test_a_trace_that_is_not_read_is_refused() -> None:
    """A mission that comes without the rows of its trace cannot be flown."""
    with pytest.raises(MissionError, match=r"link\[0\]\.trace"):
        complete_mission(Mission(link=[Link(trace="net.csv")]))


def test_rows_pack_and_unpack() -> None:
    """The rows of the longest trace of any resolution fit into the mission message."""
    chance = Random(1)
    at_us, delay_us = [0], [chance.randrange(50_000) for _ in range(MAX_ROWS)]
    while len(at_us) < MAX_ROWS:
        at_us.append(at_us[-1] + 50_000 + chance.randrange(10_000))
    packed = pack(Rows(at_us, delay_us, at_us[-1] + 1))
    assert len(packed) < MAX_PACKED
    again = unpack(Trace(name="t", rows=MAX_ROWS, period_us=at_us[-1] + 1, packed=packed))
    assert (list(again.at_us), list(again.delay_us)) == (at_us, delay_us)


@pytest.mark.parametrize("fields", [{"rows": 3}, {"rows": 1}, {"packed": "????"}, {"packed": "AAAA"}, {"period_us": 4}])
def test_damaged_rows_are_refused(fields: dict[str, object]) -> None:
    """A mission from the bus may claim anything about its traces."""
    good = {"name": "t", "rows": 2, "period_us": 10, "packed": pack(Rows([0, 5], [1, 2], 10))}
    check_traces([Trace(**good)])  # type: ignore[arg-type]
    with pytest.raises(MissionError, match=r"trace\.packed"):
        check_traces([Trace(**{**good, **fields})])  # type: ignore[arg-type]


def test_the_excerpt_of_the_examples() -> None:
    """The example scenario carries its 113 rows of CICV5G."""
    mission = load_mission(EXCERPT)
    rows = rows_of(mission)
    assert (mission.trace[0].rows, max(rows.delay_us), rows.delay_us[0]) == (113, 542_000, 297_000)
