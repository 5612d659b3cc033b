"""Declination against the test values that are published with the World Magnetic Model."""

from datetime import UTC, datetime
from math import degrees, radians

import pytest

from leadline.data.errors import InputError
from leadline.sea.magnetic import declination

# Of WMM2020 and WMM2025 (NOAA, test values within the reports): date, latitude, longitude, declination (degrees), at the ellipsoid.
PUBLISHED = [
    (datetime(2020, 1, 1, tzinfo=UTC), 80.0, 0.0, -1.28),
    (datetime(2020, 1, 1, tzinfo=UTC), 0.0, 120.0, 0.16),
    (datetime(2020, 1, 1, tzinfo=UTC), -80.0, 240.0, 69.36),
    (datetime(2025, 1, 1, tzinfo=UTC), 80.0, 0.0, 1.28),
    (datetime(2025, 1, 1, tzinfo=UTC), 0.0, 120.0, -0.16),
    (datetime(2025, 1, 1, tzinfo=UTC), -80.0, 240.0, 68.78),
    (datetime(2027, 7, 2, 12, tzinfo=UTC), 80.0, 0.0, 2.59),
    (datetime(2027, 7, 2, 12, tzinfo=UTC), -80.0, 240.0, 68.49),
]


@pytest.mark.parametrize(("date", "latitude", "longitude", "expected"), PUBLISHED)
def test_declination_has_its_published_values(date, latitude, longitude, expected):
    found = declination(radians(latitude), radians(longitude), 0.0, date, "x")
    assert degrees(found) == pytest.approx(expected, abs=0.0051)


def test_models_meet_at_their_ends_and_hold_to_the_last_moment():
    for year in (2015, 2020, 2025):
        before = declination(0.6, 0.6, 0.0, datetime(year - 1, 12, 31, 23, 59, 59, tzinfo=UTC), "x")
        after = declination(0.6, 0.6, 0.0, datetime(year, 1, 1, tzinfo=UTC), "x")
        assert degrees(abs(before - after)) < 0.3


@pytest.mark.parametrize(
    ("year", "latitude", "words"), [(2009, 0.6, "field of 2009"), (2030, 0.6, "field of 2030"), (2025, 1.5, "magnetic pole")]
)
def test_what_has_no_declination_is_refused(year, latitude, words):
    with pytest.raises(InputError, match=words):
        declination(latitude, -1.9, 0.0, datetime(year, 6, 1, tzinfo=UTC), "x")
