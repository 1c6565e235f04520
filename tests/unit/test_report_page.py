"""The report page shows the numbers of the metrics, in one document without references."""

from __future__ import annotations

import base64
import json
import re
from importlib.resources import files

import msgspec
import numpy as np
import pytest

from edc_swarm.analysis.guarantees.check import check
from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, Status, Violation, headline, safety
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.mission.routes import Course
from edc_swarm.mission.zone import Zone
from edc_swarm.protocol.messages import Event, Fix, Message, MissionMessage, Report
from edc_swarm.recording.model import Recording
from edc_swarm.report_page import data as page_data
from edc_swarm.report_page.data import Page
from edc_swarm.report_page.itineraries import Itinerary, itineraries
from edc_swarm.report_page.render import MAX_WHERE, SCRIPTS, Assets, Shown, render, render_all
from tests import builders
from tests.unit.synthetic import EPOCH_NS, change, flight, parallel, recorded, straight, whole


@pytest.fixture
def messages() -> list[Message]:
    """Return the messages of three UAVs that fly north side by side, with head u0."""
    return flight(parallel())


def page_of(messages: list[Message]) -> Page:
    """Return the page's data of a record."""
    recording = recorded(messages)
    return Page.of(recording, compute_metrics(recording).heads)


def document(recording: Recording, guarantees: list[GuaranteeResult] | None = None) -> str:
    """Return the whole page, made from the files that the command uses."""
    metrics = compute_metrics(recording)
    verdicts = check(recording) if guarantees is None else guarantees
    return render(Page.of(recording, metrics.heads), metrics, verdicts, {"command": "edc-swarm <x>"}, sources())


def sources() -> Assets:
    """Return the files that the command uses."""
    folder = files("edc_swarm.report_page")
    template, style = ((folder / f"page.{kind}").read_text() for kind in ("html", "css"))
    return Assets(template, style, "\n".join((folder / name).read_text() for name in SCRIPTS))


def test_centres_come_back_from_base64(messages: list[Message]) -> None:
    """There is one more row than frames, for the positions at the end."""
    page = page_of(messages)
    centres = np.frombuffer(base64.b64decode(page.centres), "<f4").reshape(page.frames + 1, 3, 2)
    assert centres[0].tolist() == [[0, 0], [12, 0], [24, 0]]
    assert centres[-1].tolist() == [[0, 16], [12, 16], [24, 16]]
    assert page.end_s == page.frames * page.frame_s == 4.5
    assert page.extent_m == (-5.0, -5.0, 29.0, 21.0)


def test_who_led_and_who_was_heard(messages: list[Message]) -> None:
    """A slot without a valid plan has no head, and a slot without a fix is not heard."""
    messages = [m for m in messages if not (isinstance(m, Report) and m.slot == 4)]
    messages = [m for m in messages if not (isinstance(m, Fix) and (m.uav, m.slot) == ("u2", 6))]
    report = next(m for m in messages if isinstance(m, Report))
    for boast in ({"slot": 4, "grants": ["u0"], "quorum": 1}, {"slot": 4, "status": "no-quorum"}, {"slot": 9}):
        messages.append(msgspec.structs.replace(report, **boast))
    page = page_of(messages)
    assert page.leader == [0, 0, 0, 0, -1, 0, 0, 0, 0]
    heard = np.frombuffer(base64.b64decode(page.heard), np.uint8).reshape(page.frames, 3)
    assert np.argwhere(heard == 0).tolist() == [[6, 2]]


ZONES = [
    Zone(name="fence", kind="inclusion", polygon=[(-20, -30), (60, -30), (60, 50), (-20, 50)]),
    Zone(name="<b>mast\n", kind="exclusion", centre=[40, 10], radius_m=4, keep="centre"),
    Zone(name="far", kind="exclusion", polygon=[(1e5, 0), (1e5, 9), (1.1e5, 0)]),
]


def test_zones_are_on_the_map_whose_scale_fits_the_fence(messages: list[Message]) -> None:
    """The map gets all zones with their names escaped; an exclusion zone far away does not make the swarm small."""
    change(messages, {}, type(messages[0]), zone=ZONES)
    page = page_of(messages)
    assert page.extent_m == (-20, -30, 60, 50)
    assert [(zone.kind, zone.corners_m, zone.centre_m, zone.radius_m) for zone in page.zones] == [
        (zone.kind, zone.polygon, zone.centre, zone.radius_m) for zone in ZONES
    ]
    assert page.zones[1].label_m == (40, 10, 8)
    assert page.zones[1].name == "<b>mast\\n"


def test_zones_have_a_table_and_a_legend(messages: list[Message]) -> None:
    """The legend has the kinds that there are, and a mission without zones has neither legend nor table."""
    plain = document(recorded(messages))
    assert "exclusion" not in plain.partition("<main>")[2].partition("<script")[0]
    change(messages, {}, type(messages[0]), zone=ZONES[:1])
    fenced = document(recorded(messages))
    assert '<i class="inclusion"></i>' in fenced
    assert '<i class="exclusion"></i>' not in fenced
    change(messages, {}, type(messages[0]), zone=ZONES)
    html = document(recorded(messages))
    assert '<i class="exclusion"></i>' in html
    assert "<tr><th scope=row>fence</th><td>inclusion, 4 corners; the centre stays inside</td></tr>" in html
    assert (
        "<tr><th scope=row>&lt;b&gt;mast\\n</th><td>exclusion, circle of radius 4 m; the centre stays outside" in html
    )
    assert "<tr><th scope=row>zones</th><td>1 inclusion, 2 exclusion</td></tr>" in html
    assert "<b>mast" not in html


def test_faults_stand_at_mission_time(messages: list[Message]) -> None:
    """At time scale 4, a second of wall time is four seconds of mission time."""
    fault = Event(source="operator", kind="fault", detail="kill u1 @6s", sent_ns=EPOCH_NS + 1_500_000_000)
    change(messages, {}, type(messages[0]), time_scale=4.0)
    (mark,) = page_of([*messages, fault]).faults
    assert (mark.time_s, mark.text) == (6.0, "kill u1 @6s")


def test_plots_show_what_the_metrics_sum_up(messages: list[Message]) -> None:
    """The least gap, the greatest plan times and latencies, and the whole energy agree with the metrics."""
    recording = recorded(messages)
    metrics, page = compute_metrics(recording), page_of(messages)
    gap, plan, latency, energy = page.plots
    assert min(gap.series[0].y) == metrics.min_disc_gap_m
    assert max(plan.series[0].y) == metrics.plan_ms.max
    assert max(latency.series[0].y) == metrics.fix_to_command_ms.max
    assert energy.series[0].y[-1] == pytest.approx(3 * 70 * 8 / 1e3)
    assert all(plot.unit for plot in page.plots)


def test_plots_stand_at_mission_time_with_their_limits() -> None:
    """The limit of the plan time is the rest of a slot in wall time; a command answers the fix of the slot before."""
    gap, plan, latency, _ = page_of(flight(parallel(), dt_s=1.0, time_scale=2.0)).plots
    assert (gap.limit, plan.limit) == (0.0, pytest.approx(1e3 * (1.0 - 0.2) / 2.0))
    assert gap.series[0].x == plan.series[0].x == latency.series[0].x == [float(slot) for slot in range(9)]


def test_no_gap_is_drawn_where_the_way_is_lost(messages: list[Message]) -> None:
    """In lost slots the place of the disc is unknown."""
    change(messages, {"uav": "u1", "slot": 6}, Fix, from_x_m=13.0)
    kept = [m for m in messages if not (getattr(m, "uav", "") == "u1" and 3 <= getattr(m, "slot", 0) <= 5)]
    assert page_of(kept).plots[0].series[0].x == [0.0, 0.5, 1.0, 3.0, 3.5, 4.0]


def test_energy_is_used_from_the_first_word_to_the_last(messages: list[Message]) -> None:
    """A UAV that is first heard late, or is silent at the end, counts between its first and last fix."""
    quiet = {("u1", 0), ("u1", 1), *(("u2", slot) for slot in range(4, 9))}
    kept = [m for m in messages if not (isinstance(m, Fix) and (m.uav, m.slot) in quiet)]
    assert page_of(whole(kept)).plots[3].series[0].y[-1] == pytest.approx(70 * (8 + 6 + 3) / 1e3)


def test_long_missions_are_thinned_out(messages: list[Message], monkeypatch: pytest.MonkeyPatch) -> None:
    """The page stays small, and ends at the end of the mission."""
    monkeypatch.setattr(page_data, "MAX_ANIMATED", 10)
    page = page_of(messages)
    assert (page.frames, page.frame_s) == (3, 1.5)
    centres = np.frombuffer(base64.b64decode(page.centres), "<f4").reshape(-1, 3, 2)
    assert centres[:, 0, 1].tolist() == [0, 4, 10, 16]


def test_an_empty_record_still_makes_a_page() -> None:
    """A run that ended before its first fix has a page."""
    assert "The record does not tell how many of 3 UAVs arrived" in document(recorded(flight(parallel())[:1]))


def test_the_page_needs_no_network_and_cannot_be_broken_out_of(messages: list[Message]) -> None:
    """The only address is the SVG name space, and texts of a recording stay texts."""
    evil = "</script><script>alert(1)</script>"
    messages[0] = msgspec.structs.replace(messages[0], name=evil)
    messages.append(Event(source="operator", kind="fault", detail=evil, sent_ns=EPOCH_NS))
    text = document(recorded(messages))
    assert set(re.findall(r"https?://[^\"'\s<]+", text)) == {"http://www.w3.org/2000/svg"}
    assert evil not in text
    assert text.count("</script>") == 3


def test_each_of_two_maps_says_what_flew_it(messages: list[Message]) -> None:
    """By its command, since both missions may have one name; by the name where the record has no command."""
    recording = recorded(messages)
    metrics = compute_metrics(recording)
    both = [
        Shown(Page.of(recording, metrics.heads), metrics, check(recording), run)
        for run in ({"command": "edc-swarm sim <x>"}, {})
    ]
    text = render_all(both, sources())
    assert "<figcaption>A: edc-swarm sim &lt;x&gt;</figcaption>" in text
    assert f"<figcaption>B: {recording.mission.name}</figcaption>" in text


def test_the_legend_of_two_maps_has_the_zones_of_both(messages: list[Message]) -> None:
    """A zone of the second mission alone is on a map too."""
    shown = []
    for zone in ([], ZONES):
        change(messages, {}, type(messages[0]), zone=zone)
        recording = recorded(messages)
        metrics = compute_metrics(recording)
        shown.append(Shown(Page.of(recording, metrics.heads), metrics, check(recording), {}))
    assert '<i class="exclusion"></i>' in render_all(shown, sources())


def test_a_mission_without_faults_says_so(messages: list[Message]) -> None:
    """The page says that there were no faults and that every guarantee held."""
    text = document(recorded(messages))
    assert "; every guarantee held" in text
    assert '<p class="broken">' not in text
    *others, progress, zones = check(recorded(messages))
    short = msgspec.structs.replace(progress, status="not-judged", notes=["cut short"])
    page = document(recorded(messages), [*others, short, zones])
    assert "every guarantee held" not in page
    assert "; not judged: G7; held: G1, G2, G3, G4, G5" in page
    assert "<tr><th scope=row>none</th><td></td></tr>" in text
    assert text.count("<ul>") == 1, "the reason why G8 does not apply"


@pytest.mark.parametrize(
    ("statuses", "said"),
    [
        (["held", "held"], "every guarantee held"),
        (["held", "not-applicable"], "held: G1; does not apply: G2"),
        (["not-judged", "held"], "not judged: G1; held: G2"),
        (["not-judged", "broken"], "broken: G2; not judged: G1"),
        (["not-applicable", "not-applicable"], "does not apply: G1, G2"),
        ([], "no guarantee was judged"),
    ],
)
def test_the_headline_says_of_every_guarantee_what_it_came_to(statuses: list[Status], said: str) -> None:
    """Every guarantee held only if each was judged and held."""
    assert headline([GuaranteeResult(f"G{i + 1}", "", status) for i, status in enumerate(statuses)]) == said


@pytest.mark.parametrize(
    ("statuses", "said"),
    [
        ({"G2": "broken", "G3": "held", "G8": "held"}, "safe: yes (G3 apart: held; G8 apart: held)"),
        ({"G3": "held", "G8": "not-applicable"}, "safe: yes (G3 apart: held; G8 apart: not applicable)"),
        ({"G3": "not-judged", "G8": "held"}, "safe: unknown (G3 apart: not judged; G8 apart: held)"),
        ({"G3": "not-applicable", "G8": "held"}, "safe: unknown (G3 apart: not applicable; G8 apart: held)"),
        ({"G3": "not-judged", "G8": "broken"}, "safe: no (G3 apart: not judged; G8 apart: broken)"),
        ({"G3": "held"}, "safe: unknown (G3 apart: held)"),
        ({}, "safe: unknown"),
    ],
)
def test_safe_is_apart_and_in_the_zones(statuses: dict[str, Status], said: str) -> None:
    """One broken verdict is enough for no; yes needs evidence for both."""
    assert safety([GuaranteeResult(name, "Apart", status) for name, status in statuses.items()]) == said


def test_so_many_violations_are_told(messages: list[Message]) -> None:
    """Beyond a limit, the page gives only the number of violations, and of which kinds they are."""
    for extra in (0, 1):
        violations = [Violation("gap", f"x{number}.") for number in range(MAX_WHERE - 1 + extra)]
        violations.append(Violation("unreadable", "x."))
        text = document(recorded(messages), [GuaranteeResult("G5", "No loss", "broken", violations)])
        assert text.count("<li>x") == MAX_WHERE
        counted = f"<li>... {MAX_WHERE + 1} violations in all: {MAX_WHERE} gap, 1 unreadable</li>"
        assert (counted in text) == bool(extra)


def test_a_list_of_the_roster_can_be_broken_into_lines(messages: list[Message]) -> None:
    """A list of the roster has no space, and names are not cut."""
    messages.append(Event(source="operator", kind="fault", detail="partition u0|u1,u2 @1s", sent_ns=EPOCH_NS))
    assert "<td>partition u0|u1,<wbr>u2 @1s</td>" in document(recorded(messages))


def test_the_page_says_what_the_terminal_says() -> None:
    """The page has the rows of the metrics, each part on a line, their JSON, and every broken guarantee."""
    recording = recorded(flight([straight((0, 0), (0, 20), 10), straight((9, 20), (9, 0), 10)], planner="straight"))
    text, metrics = document(recording), compute_metrics(recording)
    cells = re.findall(r"<tr><th scope=row>(.*?)</th><td>(.*?)</td></tr>", text)
    assert [row for row in metric_rows(metrics) if (row[0], row[1].replace("; ", ";<br>")) not in cells] == []
    embedded = re.search(r'id="metrics-json">(.*?)</script>', text)
    assert embedded is not None
    assert json.loads(embedded[1]) == msgspec.to_builtins(metrics)
    assert '<span class="broken">broken</span>' in text
    assert '<p class="broken">' in text
    assert f"broken: {', '.join(result.guarantee for result in check(recording) if result.broken)}" in text
    assert "u0 and u1: discs overlap by up to 1 m" in text


def test_a_uav_is_home_when_its_last_step_ends() -> None:
    """The table of the UAVs and the finish times of the metrics agree; one that starts at its target is home at 0 s."""
    mission, *messages = flight([straight((0, 0), (0, 20), 10), straight((40, 0), (40, 0), 10)])
    assert isinstance(mission, MissionMessage)
    roster = [msgspec.structs.replace(entry, finish_by_s=1.0) for entry in mission.roster]
    recording = recorded([msgspec.structs.replace(mission, roster=roster), *messages])
    finished = [each.finished_s for each in compute_metrics(recording).deadlines]
    assert finished[1] == 0
    assert re.findall(r"<td>arrived</td><td>(.*?)</td>", document(recording)) == [
        f"{time_s:.1f}" for time_s in finished
    ]


def test_one_uav_has_no_gap_rather_than_an_unknown_one() -> None:
    """A dash says that the record does not tell."""
    metrics = compute_metrics(recorded(flight([straight((0, 0), (0, 20), 10)])))
    assert dict(metric_rows(metrics))["least gap"] == "none, with one UAV"


def test_the_map_knows_the_goal_of_every_moment() -> None:
    """Points of the roster's route, then a later goal and its points; a course that goes back changes nothing."""
    roster = [builders.entry("a", route=[(1.0, 0.0), (2.0, 0.0), (0.0, 9.0)]), builders.entry("b")]
    later = [(5.0, 5.0), (6.0, 6.0)]
    courses = {
        2: Course(leg=1),
        3: Course(leg=1),
        4: Course(),
        6: Course(goal=4, route=later),
        8: Course(goal=4, leg=1, route=later[1:]),
        9: Course(leg=2),
    }
    said = [builders.fix("a", slot, course=course) for slot, course in reversed(courses.items())]
    boast = builders.fix("b", 3, course=Course(leg=7))
    first, second = itineraries(recorded([builders.mission_message(roster), *said, boast]))
    assert first.routes == [[(1.0, 0.0), (2.0, 0.0), (0.0, 9.0)], later]
    assert first.goals == [0, 4]
    assert first.turns == [(2, 0, 1), (6, 1, 0), (8, 1, 1)]
    assert second == Itinerary([[(0.0, 9.0)]], [0], [])
