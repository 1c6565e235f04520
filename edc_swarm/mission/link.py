"""One rule of the emulated network: table `[[link]]` of a mission."""

from __future__ import annotations

from typing import Annotated

from msgspec import Struct

from edc_swarm.mission.field_types import Distribution, Fraction, LinkEnd, NonNegative, Option, Positive

FOR_GOOD_S = 1e9
"""A link rule that ends then or later never ends."""


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
    start_s: NonNegative = 0.0
    """Mission time at which the rule begins."""
    end_s: NonNegative = FOR_GOOD_S
    """Mission time at which the rule ends; from 1e9 on it never ends."""
