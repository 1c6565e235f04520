"""One rule of the emulated network: table `[[link]]` of a mission."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from edc_swarm.errors import MissionError
from edc_swarm.mission.field_types import Distribution, Fraction, LinkEnd, NonNegative, Option, Positive

FOR_GOOD_S = 1e9
"""A link rule that ends then or later never ends."""


Fading = Literal["none", "rayleigh"]
TraceUnit = Literal["ns", "us", "ms", "s"]
TraceGap = Literal["stall", "loss"]
TraceEnd = Literal["repeat", "stop"]
TraceOffset = Literal["uav", "none"]
Column = Annotated[str, Meta(min_length=1, max_length=200)] | Annotated[int, Meta(ge=1, le=1000)]
Columns = Annotated[dict[Annotated[str, Meta(max_length=20)], Column], Meta(max_length=2)]


class Link(Struct, frozen=True, kw_only=True):
    """One rule of the emulated network: the quality of the directed links from `sender` to `receiver`.

    The last rule that matches a sender, a receiver and a time decides. A link without a rule is perfect.

    Source: this project.
    """

    sender: LinkEnd = "*"
    """Id of the sending UAV; "*" is every UAV."""
    receiver: LinkEnd = "*"
    """Id of the receiving UAV; "*" is every UAV."""
    delay_ms: Annotated[NonNegative, Option("delay-ms")] = 0.0
    """One-way delay of a link.

    It comes on top of the delay of the real transport. The emulator applies it in the receiving agent.
    """
    jitter_ms: Annotated[NonNegative, Option("jitter-ms")] = 0.0
    """Jitter of a link: an additional delay, drawn for each message as `distribution` says."""
    distribution: Distribution = "uniform"
    """Distribution of the jitter J.

    `constant` adds none, `uniform` adds U(0, J), `normal` adds |N(0, J)| clipped at 3 J, `lognormal` adds a lognormal
    delay of median J / 2.
    """
    loss: Annotated[Fraction, Option("loss")] = 0.0
    """Fraction of the messages that a link loses, each independently."""
    burst_enter: Fraction = 0.0
    """Probability per message that the link enters its bad state (Gilbert-Elliott); 0: no bursts.

    Source: E. N. Gilbert, Bell Syst. Tech. J. 39(5), 1960; E. O. Elliott, ibid. 42(5), 1963.
    """
    burst_leave: Fraction = 0.5
    """Probability per message that the link leaves its bad state."""
    burst_loss: Fraction = 1.0
    """Fraction of the messages that the link loses in its bad state, in place of `loss`."""
    duplicate: Fraction = 0.0
    """Probability that a message arrives twice."""
    reorder: Fraction = 0.0
    """Probability that a message is delayed by up to three slots more, so that later messages overtake it."""
    range_m: NonNegative = 0.0
    """Radio range: the distance at which half of the messages are lost; 0: no limit.

    More messages are lost beyond it, fewer within.

    Source: T. S. Rappaport, "Wireless Communications", 2nd ed., 2002, sections 4.9.1-4.9.3.
    """
    path_loss_exponent: Positive = 2.0
    """Exponent of the path loss: the received power falls as distance to this power.

    Source: free space.
    """
    shadowing_db: NonNegative = 4.0
    """Standard deviation of the received power, drawn for each message; 0: every message beyond `range_m` is lost."""
    fading: Fading = "none"
    """Fading of the radio: `none`, or `rayleigh`.

    With `rayleigh` the received power is exponentially distributed and changes with `coherence_ms`. A message is lost
    while the power is too low: as often as `loss` says without a range, and half of the time at `range_m`.
    `shadowing_db` and the bursts then have no effect.

    Source: T. S. Rappaport, "Wireless Communications", 2nd ed., 2002, sections 5.6 and 5.7.
    """
    coherence_ms: NonNegative = 0.0
    """Coherence time of the fading: after it, the correlation of the channel's gain has fallen to 1/e.

    Default: 0, which stands for a gain that is drawn anew for each message.
    """
    rate_kbps: NonNegative = 0.0
    """Rate of the channel that all senders of this rule share on their way to one receiver; 0: no limit.

    Messages leave a queue of `queue_bytes` one after another, first in, first out.
    """
    queue_bytes: Annotated[int, Meta(ge=1, le=1 << 30)] = 65_536
    """Size of the queue before a channel with a rate, or with delivery opportunities.

    A message that does not fit is dropped (drop tail).
    """
    trace: Annotated[str, Meta(max_length=4096)] = ""
    """File with the delays of a measured network, relative to the mission file.

    Its delay comes in addition to those of the other fields. A table has a row for each probe, separated by commas,
    semicolons, tabs or spaces. A file with one number a line lists the milliseconds in which 1500 bytes can leave the
    queue. At most 100000 rows.

    Default: empty, which stands for none.
    Source: for the second form, Mahimahi (R. Netravali et al., USENIX ATC 2015).
    """
    trace_columns: Columns = {}
    """Columns of the table, by name or number: `sent` and `received`, or `sent` and `delay`."""
    trace_unit: TraceUnit = "ms"
    """Unit of the columns."""
    round_trip: bool = False
    """True if the delays of the file are those of the way there and back; a message takes half of them."""
    trace_gap: TraceGap = "stall"
    """Meaning of a gap in the times of sending: a `stall`, or the `loss` of what is sent meanwhile.

    A stall delays what is sent until the next row arrives, and releases it in order: first in, first out.
    """
    trace_gap_ms: NonNegative = 0.0
    """Time between two rows beyond which there is a gap.

    Default: 0, which stands for 4 times the median time between two rows.
    """
    trace_start_ms: NonNegative = 0.0
    """Place in the trace at which the mission begins."""
    trace_offset: TraceOffset = "uav"
    """Place at which each UAV begins in addition: drawn from `seed` for each sending `uav`, or `none`.

    For delivery opportunities it is drawn for each receiving UAV.
    """
    trace_end: TraceEnd = "repeat"
    """What follows the last row: `repeat` from the first row, or `stop`, after which the trace delays nothing."""
    model: Annotated[str, Meta(max_length=200)] = ""
    """Link model of your own, package.module:Class, whose delay or loss comes in addition.

    Default: empty, which stands for none.
    """
    start_s: NonNegative = 0.0
    """Mission time at which the rule begins."""
    end_s: NonNegative = FOR_GOOD_S
    """Mission time at which the rule ends; from 1e9 on it never ends."""


def check_link(link: Link, where: str) -> None:
    """Raise `MissionError` unless the fields of a link, the table at `where`, fit together."""
    if link.fading == "rayleigh" and link.burst_enter:
        raise MissionError(f"{where}.burst_enter", link.burst_enter, 'left out beside fading = "rayleigh"')
    if link.trace_columns and not link.trace:
        raise MissionError(f"{where}.trace_columns", link.trace_columns, "left out without a trace")
