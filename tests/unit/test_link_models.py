"""What links do with a trace, a channel and Rayleigh fading."""

from __future__ import annotations

import math
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import pytest

from edc_swarm.emulation.delay_log import LEVELS_PCT, MAX_DELAYS, DelayLog, LinkDelays, quantiles
from edc_swarm.emulation.fading import RayleighGain, fading_loss, is_faded
from edc_swarm.emulation.links import LinkEmulator, have_queues
from edc_swarm.errors import MissionError
from edc_swarm.mission.configuration import Mission
from edc_swarm.mission.faults import parse_faults
from edc_swarm.mission.link import Link
from edc_swarm.mission.prospect import prospect_of
from edc_swarm.mission.trace import Rows, Trace, pack, unpack
from edc_swarm.mission.trace_schedule import Schedule
from edc_swarm.mission.validation import load_mission, mission_from_dict
from tests.builders import mission, row

MS = 1_000_000
STEPS = [0, 50, 100, 150, 650, 700]
DELAYS = [20, 30, 25, 20, 10, 15]


def trace(at_ms: list[int], delay_ms: list[int], period_ms: int, kind: str = "delays") -> Trace:
    """Return a trace of these rows."""
    rows = Rows([1000 * at for at in at_ms], [1000 * delay for delay in delay_ms], 1000 * period_ms)
    return Trace(name="t", kind=kind, rows=len(at_ms), period_us=rows.period_us, packed=pack(rows))  # type: ignore[arg-type]


def links(found: Trace | None = None, seed: int = 0, **fields: Any) -> LinkEmulator:
    """Return the links into UAV b, which by default play a trace from its beginning."""
    rule = {"trace": "t", "trace_offset": "none"} if found is not None else {}
    return LinkEmulator(Mission(seed=seed, link=[Link(**{**rule, **fields})], trace=[found] if found else []), "b")


def played(emulator: LinkEmulator, at_ms: list[float], sender: str = "a") -> list[float | None]:
    """Return the delays in milliseconds of messages sent at these times; None for one that is lost."""
    found = [emulator.arrivals_ns(sender, at / 1000) for at in at_ms]
    return [delays[0] / MS if delays else None for delays in found]


def test_the_quantiles_of_the_delays_are_those_of_the_file() -> None:
    """Messages that are sent with the probes of CICV5G have their delays, all of them, exactly."""
    base = load_mission(Path("scenarios/measured_5g.toml"))
    rows = unpack(base.trace[0])
    link = msgspec.structs.replace(base.link[0], trace_offset="none")
    emulator = LinkEmulator(msgspec.structs.replace(base, link=[link]), "b")
    found = [emulator.arrivals_ns("a", at_us / 1e6) for at_us in rows.at_us]
    assert quantiles([ns for (ns,) in found]) == quantiles([1000 * us for us in rows.delay_us])


def test_a_message_has_the_delay_of_the_row_before_it() -> None:
    """Between rows the older one holds; after the last row the first one follows."""
    assert played(links(trace(STEPS, DELAYS, 750)), [0, 49.9, 50, 149, 160.0, 700, 760]) == [
        20,
        20,
        30,
        25,
        500,
        15,
        20,
    ]


def test_a_stall_releases_in_order() -> None:
    """What is sent in a gap arrives with the row after it, and nothing that is sent later arrives earlier."""
    sent = [150.0, 200.0, 400.0, 649.0, 650.0, 651.0]
    delays = played(links(trace(STEPS, DELAYS, 750)), sent)
    assert delays == [20, 460, 260, 11, 10, 10]
    late = played(links(trace([0, 50, 550, 600], [5, 5, 90, 5], 650)), [300.0, 551.0, 600.0])
    assert late == [340, 90, 41]


def test_a_gap_as_loss() -> None:
    """What is sent in a gap is lost, and later messages are as fast as their rows."""
    assert played(links(trace(STEPS, DELAYS, 750), trace_gap="loss"), [150, 151, 649, 650]) == [20, None, None, 10]


def test_what_counts_as_a_gap_can_be_stated() -> None:
    """4 median steps by default; a step is a gap only if it is longer than stated."""
    assert played(links(trace(STEPS, DELAYS, 750), trace_gap="loss", trace_gap_ms=500), [151]) == [20]
    assert played(links(trace(STEPS, DELAYS, 750), trace_gap="loss", trace_gap_ms=49), [60]) == [None]


def test_a_trace_repeats_or_stops() -> None:
    """After a trace that stops, the other fields of the rule alone count."""
    assert played(links(trace(STEPS, DELAYS, 750)), [750, 800]) == [20, 30]
    assert played(links(trace(STEPS, DELAYS, 750), trace_end="stop", delay_ms=1), [749, 750]) == [16, 1]


def test_each_uav_and_seed_begins_elsewhere() -> None:
    """The offset is that of the sender, whoever receives, and another with another seed."""
    found = trace(list(range(0, 5000, 50)), list(range(100)), 5000)
    places = {
        (seed, sender, receiver): LinkEmulator(
            Mission(seed=seed, link=[Link(trace="t")], trace=[found]), receiver
        ).arrivals_ns(sender, 0.0)[0]
        for seed in (1, 2)
        for sender in ("a", "c")
        for receiver in ("b", "d")
    }
    assert all(places[seed, who, "b"] == places[seed, who, "d"] for seed in (1, 2) for who in ("a", "c"))
    assert len(set(places.values())) == 4
    assert played(links(found, trace_start_ms=1000), [0]) == [20]


def test_the_time_scale_does_not_stretch_a_trace() -> None:
    """A trace plays in wall time, as delays do."""
    fast = Mission(time_scale=10, link=[Link(trace="t", trace_offset="none")], trace=[trace(STEPS, DELAYS, 750)])
    assert LinkEmulator(fast, "b").arrivals_ns("a", 0.5)[0] == 30 * MS


def test_share_of_time_beyond_a_limit() -> None:
    """The share that G7 counts as late: by time, not by rows."""
    schedule = Schedule.of(unpack(trace(STEPS, DELAYS, 750)), Link(), 0, "a")
    assert schedule.share_beyond(22_000) == pytest.approx((50 + 50 + 488) / 750)
    lossy = Schedule.of(unpack(trace(STEPS, DELAYS, 750)), Link(trace_gap="loss"), 0, "a")
    assert lossy.share_beyond(1e9) == pytest.approx(500 / 750)


def test_what_is_promised_on_a_measured_network() -> None:
    """Nothing on a network that is late half of the time, or on a shared channel; a longer limit on a good one."""
    roster = row("abc", 20.0, 90.0)
    promised = prospect_of(mission(roster), []).limit_slots
    good, bad = trace([0, 950], [20, 900], 1000), trace([0, 400], [20, 900], 1000)
    for found, obstacle in ((good, ""), (bad, "loses or delays")):
        link = Link(trace="t", trace_gap_ms=1e6)
        prospect = prospect_of(mission(roster, link=[link], trace=[found]), parse_faults(Mission()))
        assert obstacle in prospect.obstacle
        assert obstacle or promised < prospect.limit_slots
    assert "shares a channel" in prospect_of(mission(roster, link=[Link(rate_kbps=1.0)]), []).obstacle


# --- channels ------------------------------------------------------------------------------------


def test_fixes_contend_for_a_channel() -> None:
    """K messages of 1000 bytes at 800 kbit/s leave 10 ms after one another, whoever sends them."""
    emulator = links(rate_kbps=800, queue_bytes=4000)
    sent = [emulator.arrivals_ns(f"u{k}", 0.0, 1000) for k in range(6)]
    assert sent == [[10 * MS], [20 * MS], [30 * MS], [40 * MS], [], []]
    assert emulator.arrivals_ns("u0", 0.015, 1000) == [35 * MS]
    assert emulator.arrivals_ns("u0", 1.0, 1000) == [10 * MS]


def test_rules_have_channels_of_their_own() -> None:
    """A sender with a rule of its own does not wait for those of another rule."""
    rules = [Link(rate_kbps=8), Link(sender="a", rate_kbps=8)]
    emulator = LinkEmulator(Mission(link=rules), "b")
    assert [emulator.arrivals_ns(who, 0.0, 1)[0] // MS for who in ("c", "a", "d")] == [1, 1, 2]


def test_delivery_opportunities_carry_1500_bytes_each() -> None:
    """Small messages share one; a large one takes several; what is not used is wasted."""
    found = trace([0, 5, 6, 7], [0, 0, 0, 0], 10, "opportunities")
    emulator = links(found)
    sizes = [(0.001, 700), (0.001, 700), (0.001, 700), (0.001, 3000), (0.050, 1500)]
    delays = [emulator.arrivals_ns("a", at_s, size)[0] // MS for at_s, size in sizes]
    assert delays == [4, 4, 5, 9, 0]
    assert links(found, trace_end="stop").arrivals_ns("a", 0.008, 10) == []
    assert links(found, trace_end="stop").arrivals_ns("a", 0.011, 10) == [0]
    assert links(found, queue_bytes=100).arrivals_ns("a", 0.0, 101) == []


def test_only_queues_need_sizes() -> None:
    """Without a queue nobody has to measure messages."""
    assert not have_queues(Mission(link=[Link(trace="t", loss=0.1)], trace=[trace([0], [1], 1)]))
    assert have_queues(Mission(link=[Link(rate_kbps=1)]))
    assert have_queues(Mission(link=[Link(trace="t")], trace=[trace([0], [0], 1, "opportunities")]))


# --- fading --------------------------------------------------------------------------------------


def lost_runs(coherence_ms: float, count: int = 20_000) -> tuple[float, float]:
    """Return the share of lost messages, one every 10 ms, and the mean length of a run of losses."""
    emulator = links(fading="rayleigh", loss=0.2, coherence_ms=coherence_ms, seed=3)
    lost = [not emulator.arrivals_ns("a", 0.01 * k) for k in range(count)]
    runs = sum(now and not before for before, now in zip([False, *lost], lost, strict=False))
    return sum(lost) / count, sum(lost) / runs


def test_rayleigh_fading_loses_its_share_in_bursts() -> None:
    """The mean loss is `loss`; without coherence losses are independent, with it they come in runs."""
    share, run = lost_runs(0.0)
    assert share == pytest.approx(0.2, abs=0.01)
    assert run == pytest.approx(1 / 0.8, abs=0.05)
    share, run = lost_runs(100.0)
    assert share == pytest.approx(0.2, abs=0.03)
    assert run > 2.0


def test_the_power_of_a_rayleigh_channel_is_exponential() -> None:
    """Mean 1, and the share below x is 1 - exp(-x)."""
    gain = RayleighGain(Random(5))
    powers = [gain.power(k, 0.0) for k in range(20_000)]
    assert sum(powers) / len(powers) == pytest.approx(1.0, abs=0.02)
    assert sum(power < 0.5 for power in powers) / len(powers) == pytest.approx(1 - math.exp(-0.5), abs=0.01)


def test_rayleigh_fading_over_distance() -> None:
    """Half of the messages are lost at the range, few close by, nearly all far beyond."""
    rule = Link(range_m=100.0, fading="rayleigh")
    assert fading_loss(100.0, rule) == pytest.approx(0.5)
    assert fading_loss(10.0, rule) == pytest.approx(1 - 2**-0.01)
    assert fading_loss(1000.0, rule) == pytest.approx(1.0)
    assert is_faded(0.0, 0.1)
    assert not is_faded(9.0, 0.1)
    assert is_faded(9.0, 1.0)


def test_fading_and_bursts_exclude_each_other() -> None:
    """Both say when losses come together."""
    with pytest.raises(MissionError, match=r"link\[0\]\.burst_enter"):
        mission_from_dict({"link": [{"fading": "rayleigh", "burst_enter": 0.1}]})


# --- the log -------------------------------------------------------------------------------------


def test_a_log_tells_what_links_did() -> None:
    """Of each sender: how many arrived, how many were lost, and quantiles of the delays."""
    log = DelayLog()
    for k in range(101):
        log.arrive("a", k * MS)
    log.lose("a")
    log.lose("c")
    assert log.told() == {"a": LinkDelays(101, 1, [float(level) for level in LEVELS_PCT]), "c": LinkDelays(0, 1, [])}


def test_a_log_is_bounded() -> None:
    """Of more messages it keeps a sample, and counts them all."""
    log = DelayLog()
    for k in range(MAX_DELAYS + 5000):
        log.arrive("a", k)
    told = log.told()["a"]
    assert told.arrived == MAX_DELAYS + 5000
    assert told.delay_ms[-1] > MAX_DELAYS / 1e6
