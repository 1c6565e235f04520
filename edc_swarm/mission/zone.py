"""One zone of the airspace: table `[[zone]]` of a mission."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from edc_swarm.mission.field_types import MAX_CORNERS, Metres, NonNegative, Point, ZoneKind, ZoneRule

RIM_CORNERS = 64
"""Corners of the polygon inscribed in a circular inclusion zone. It is smaller than the circle by at most 0.12 %."""


class Zone(Struct, frozen=True, kw_only=True):
    """One zone of the airspace: a polygon or a circle that UAVs must not leave, or must not enter.

    A UAV stays inside all inclusion zones and outside all exclusion zones.

    Source: the user.
    """

    name: Annotated[str, Meta(min_length=1, max_length=64)]
    """Name of the zone, which no other zone has."""
    kind: ZoneKind
    """Kind of the zone: `inclusion` (a fence that no UAV leaves) or `exclusion` (no UAV enters)."""
    polygon: Annotated[list[Point], Meta(max_length=MAX_CORNERS)] = []
    """Corners (x, y) of a simple polygon, at least three, in either sense of rotation; or else `centre`, `radius_m`."""
    centre: Annotated[list[Metres], Meta(max_length=2)] = []
    """Centre (x, y) of a circle, for a zone without `polygon`."""
    radius_m: NonNegative = 0.0
    """Radius of the circle about `centre`, for a zone without `polygon`."""
    keep: ZoneRule = ""
    """Part of a UAV that keeps to the zone: its whole tracked `disc`, or the `centre` of the disc.

    Default: "", which stands for `centre` at an inclusion zone and `disc` at an exclusion zone.
    """

    @property
    def keeps_disc(self) -> bool:
        """True if the whole tracked disc keeps to the zone, False if only its centre does."""
        return self.keep == "disc" or (self.keep == "" and self.kind == "exclusion")

    @property
    def corners(self) -> int:
        """Number of corners, which a circle has too: one as an exclusion zone, else those of its rim."""
        return len(self.polygon) or (RIM_CORNERS if self.kind == "inclusion" else 1)

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """Left, low, right and high edge of the box around the zone, in metres."""
        corners = self.polygon or [
            (self.centre[0] - self.radius_m, self.centre[1] - self.radius_m),
            (self.centre[0] + self.radius_m, self.centre[1] + self.radius_m),
        ]
        xs_m, ys_m = zip(*corners, strict=True)
        return min(xs_m), min(ys_m), max(xs_m), max(ys_m)
