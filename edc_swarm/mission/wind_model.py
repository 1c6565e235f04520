"""The wind of a mission: table `[wind]`."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from edc_swarm.mission.field_types import Option

WindSpeed = Annotated[float, Meta(ge=0, le=100)]


class WindModel(Struct, frozen=True, kw_only=True):
    """A constant mean wind and turbulence. Only vehicles with inertia feel it.

    Source: MIL-F-8785C, "Flying Qualities of Piloted Airplanes", 1980, section 3.7.
    """

    mean_mps: Annotated[WindSpeed, Option("wind-mps")] = 0.0
    """Speed of the mean wind."""
    direction_deg: Annotated[float, Meta(ge=0, le=360)] = 270.0
    """Direction that the mean wind comes from, clockwise from north: 270 is a west wind.

    Source: this project.
    """
    gust_mps: Annotated[WindSpeed, Option("gust-mps")] = 0.0
    """Largest speed of the turbulence: the Dryden model with a third of it as intensity, cut off at this speed.

    The cut makes a bound on the deviation possible, since a normal distribution has no end.
    """
