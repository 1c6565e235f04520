"""Local metres to WGS84, against an independent library."""

import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edc_swarm.geodesy import to_wgs84

METRES = st.floats(-1000, 1000)


@given(x_m=METRES, y_m=METRES, lat_deg=st.floats(-85, 85), lon_deg=st.floats(-179, 179))
def test_positions_agree_with_pymap3d(x_m: float, y_m: float, lat_deg: float, lon_deg: float) -> None:
    """Seen from the tangent plane of another library, the point lies where it was put."""
    lat, lon = to_wgs84(x_m, y_m, lat_deg, lon_deg)
    east_m, north_m, _ = pymap3d.geodetic2enu(lat, lon, 0.0, lat_deg, lon_deg, 0.0)
    assert east_m == pytest.approx(x_m, abs=1e-4)
    assert north_m == pytest.approx(y_m, abs=1e-4)


def test_the_origin_is_itself() -> None:
    """No displacement, no change."""
    assert to_wgs84(0.0, 0.0, 60.1841, 24.8301) == pytest.approx((60.1841, 24.8301), abs=1e-13)
