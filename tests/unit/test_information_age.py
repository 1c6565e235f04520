"""Ages of information and causes of holds: by hand, and on missions whose links have known faults."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from edc_swarm.analysis.holds import CAUSES
from edc_swarm.analysis.information_age import Age, age_of, command_updates, fix_updates, sawtooth_of
from edc_swarm.analysis.metrics import Metrics, compute_metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.link import Link
from edc_swarm.mission.roster import complete_mission
from edc_swarm.planner.registry import make_planner
from edc_swarm.protocol.messages import Message, mission_message
from edc_swarm.recording.model import Recording
from edc_swarm.simulation.simulator import Simulation
from processes.experiments.network_plots import draw_ages, draw_links

MS = 1_000_000


def flown(*rules: Link, **fields: object) -> Recording:
    """Return the recording of a mission of five UAVs with these links."""
    mission = complete_mission(msgspec.structs.replace(Mission(uavs=5, seed=2, link=list(rules)), **fields))
    message, said = mission_message(mission), list[Message]()
    Simulation(message, lambda: make_planner("edc", message), lambda _key, one, _ns: said.append(one)).run()
    return Recording.from_messages(said)


def test_a_sawtooth_by_hand() -> None:
    """Updates sent at 0, 10 and 30 ms, used at 5, 12 and 50 ms: the age goes 5 to 12, then 2 to 40 ms."""
    used = {"a": [(5 * MS, 0), (12 * MS, 10 * MS), (50 * MS, 30 * MS)]}
    sawtooth = sawtooth_of(used)
    assert list(zip(sawtooth.low_ms, sawtooth.high_ms, strict=True)) == [(5.0, 12.0), (2.0, 40.0)]
    age = age_of(sawtooth)
    assert age.mean == pytest.approx(((144 - 25) + (1600 - 4)) / 2 / 45)
    assert (age.max, age.peak_mean, age.peak_p50) == (40.0, 26.0, 26.0)
    below = sawtooth.share_below(np.array([2.0, 5.0, 12.0, 40.0]))
    assert below.tolist() == pytest.approx([0.0, 3 / 45, 17 / 45, 1.0])
    assert age.p50 == pytest.approx(12 + (22.5 - 17))


def test_updates_out_of_order_make_nothing_younger() -> None:
    """An update that is older than one that was used before it does not count."""
    assert sawtooth_of({"a": [(5, 4), (8, 2), (9, 7)]}).peak_ms.tolist() == [5 / MS]
    assert age_of(sawtooth_of({})) == Age()
    assert age_of(sawtooth_of({"a": [(5, 4)]})) == Age()


def test_ages_on_perfect_links() -> None:
    """Every slot has an update: ages run evenly over one slot, from the wait until the update is used."""
    metrics = compute_metrics(flown())
    slot_ms, age, command = 500.0, metrics.fix_age_ms, metrics.command_age_ms
    assert age.mean is not None
    assert command.mean is not None
    assert age.max == pytest.approx(slot_ms, abs=5)
    assert age.mean == pytest.approx(slot_ms / 2, abs=5)
    assert metrics.fix_to_step_ms.p50 == slot_ms
    assert command.mean == pytest.approx(1.5 * slot_ms, abs=50)  # sent as a slot begins, flown from the next one on
    assert metrics.slots_held_by == {}


def test_age_grows_with_loss() -> None:
    """On the same mission, losses make both ages older, and their peaks more so."""
    good, bad = (compute_metrics(flown(*links)) for links in ((), (Link(loss=0.4),)))
    for name in ("fix_age_ms", "command_age_ms"):
        for statistic in ("mean", "peak_mean", "max"):
            assert getattr(getattr(bad, name), statistic) > 1.1 * getattr(getattr(good, name), statistic)


def held_by(*rules: Link, **fields: object) -> Metrics:
    """Return the metrics, of which the causes of holds add up to the holds."""
    metrics = compute_metrics(flown(*rules, **fields))
    assert metrics.slots_held_by is not None
    assert sum(metrics.slots_held_by.values()) == metrics.slots_held
    assert set(metrics.slots_held_by) <= set(CAUSES)
    return metrics


def test_holds_have_the_causes_that_their_links_have() -> None:
    """Lost fixes, lost commands, silence and a slow solver each cause holds of their own kind."""
    head = compute_metrics(flown()).heads[0].head
    cases = {
        "fix-missed": held_by(Link(receiver=head, loss=0.5)),
        "command-missed": held_by(Link(sender=head, loss=0.4)),
        "no-plan": held_by(Link(loss=1.0, start_s=5.0, end_s=8.0)),
        "command-late": held_by(fault=["slow head 520 @5s for 5s"]),
    }
    for cause, metrics in cases.items():
        assert metrics.slots_held_by is not None
        assert cause in metrics.slots_held_by, (cause, metrics.slots_held_by)
    lost_fixes = cases["fix-missed"].slots_held_by or {}
    lost_commands = cases["command-missed"].slots_held_by or {}
    assert "command-missed" not in lost_fixes
    assert lost_commands["command-missed"] > 10 * lost_commands.get("fix-missed", 0)
    assert any("fix-missed" in text for name, text in metric_rows(cases["fix-missed"]) if name == "slots held")


def test_distributions_are_plotted(tmp_path: Path) -> None:
    """Ages and link delays as PNG, SVG and PDF, the same bytes each time; nothing without emulated links."""
    lossy, perfect = flown(Link(delay_ms=20, jitter_ms=30, loss=0.1), uavs=2), flown(uavs=2)
    for folder in ("one", "two"):
        draw_ages(lossy, tmp_path / folder / "ages")
    draw_links(lossy, tmp_path / "one" / "links")
    ages = {f"ages.{kind}" for kind in ("png", "svg", "pdf")}
    assert {path.name for path in (tmp_path / "one").glob("ages.*")} == ages
    assert {path.suffix for path in (tmp_path / "one").glob("links.*")} == {".png", ".svg", ".pdf"}
    assert all((tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes() for name in ages)
    draw_links(perfect, tmp_path / "one" / "none")
    assert not (tmp_path / "one" / "none.png").exists()
    assert len(fix_updates(perfect)) == len(command_updates(perfect)) == 2
