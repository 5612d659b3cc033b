"""Noise of inertial units, term by term, from their Allan deviations: that of each record by its definition, written here."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.optimize import nnls

from leadline.data import records
from leadline.simulate.drift import Drift
from leadline.simulate.gyros import Imu, Triad

RECORDS, RATE = 20, 10.0
FLOOR = np.sqrt(2 * np.log(2) / np.pi)  # of flicker noise (IEEE Std 952, 1997, annex C)


def allan_deviation(rate: np.ndarray, interval: float, counts: list[int]) -> np.ndarray:
    """Overlapping Allan deviations of rates (rows, series) at averaging times counts x interval, over all series.

    theta is the integral of the rate; variance(T) = <(theta(t + 2T) - 2 theta(t + T) + theta(t))^2> / (2 T^2), T = m interval.
    """
    theta = np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(rate * interval, axis=0)])
    found = []
    for m in counts:
        second = theta[2 * m :] - 2 * theta[m:-m] + theta[: -2 * m]
        found.append(np.mean(second**2) / (2 * (m * interval) ** 2))
    return np.sqrt(found)


@cache
def recorded(imu: Imu, rows: int) -> np.ndarray:
    """Gyro rates (rows, 3 RECORDS) of units that stand still against inertial space."""
    time = np.arange(rows) / RATE
    nothing = records.Imu(time=time, gyro=np.zeros((rows, 3)), accel=np.zeros((rows, 3)))
    return np.concatenate([imu.record(nothing, np.random.default_rng(seed)).gyro for seed in range(RECORDS)], axis=1)


def counts(first: float, last: float) -> list[int]:
    """A decade of averaging times or more (s), in whole rows."""
    return sorted({round(m) for m in np.geomspace(first * RATE, last * RATE, 9)})


def test_the_deviation_is_that_of_a_series_counted_by_hand() -> None:
    rate = np.array([1.0, 3.0, 2.0, 6.0])[:, None]
    pairs = [(1.0, 3.0), (3.0, 2.0), (2.0, 6.0)]
    by_hand = np.sqrt(np.mean([(b - a) ** 2 for a, b in pairs]) / 2)
    assert allan_deviation(rate, 0.5, [1])[0] == pytest.approx(by_hand)
    assert allan_deviation(rate, 0.5, [2])[0] == pytest.approx((4.0 - 2.0) / np.sqrt(2))


# Over a decade that starts well above a row and ends well below the record, each term alone has its own slope and size.


def test_white_noise_falls_with_the_root_of_the_averaging_time() -> None:
    imu = Imu(rate=RATE, gyro_density=3e-4)
    m = counts(1.0, 20.0)
    found = allan_deviation(recorded(imu, 6000), 1 / RATE, m) * np.sqrt(np.array(m) / RATE)
    assert found == pytest.approx(3e-4, rel=0.1)


def test_a_random_walk_grows_with_the_root_of_the_averaging_time() -> None:
    imu = Imu(rate=RATE, gyro_bias=Drift(walk=2e-5))
    m = counts(4.0, 40.0)
    found = allan_deviation(recorded(imu, 20_000), 1 / RATE, m) / np.sqrt(np.array(m) / RATE / 3)
    assert found == pytest.approx(2e-5, rel=0.1)


def test_flicker_is_flat_over_two_decades() -> None:
    imu = Imu(rate=RATE, gyro_bias=Drift(flicker=5e-5))
    m = counts(0.5, 120.0)
    found = allan_deviation(recorded(imu, 12000), 1 / RATE, m) / FLOOR
    assert found == pytest.approx(5e-5, rel=0.1)


def test_flicker_has_its_spectrum() -> None:
    """Two-sided B^2 / (2 pi |f|): by periodograms, averaged over 60 series and some tens of frequencies: 3 %; bends at the ends: 5 %."""
    rate, rows = recorded(Imu(rate=RATE, gyro_bias=Drift(flicker=5e-5)), 12000), 12000
    window = np.hanning(rows)[:, None]
    power = np.mean(np.abs(np.fft.rfft(rate * window, axis=0)) ** 2, axis=1) / (RATE * np.sum(window**2))
    frequency = np.fft.rfftfreq(rows, 1 / RATE)
    for low, high in ((0.01, 0.02), (0.03, 0.06), (0.1, 0.2), (0.3, 0.5)):
        inside = (frequency >= low) & (frequency < high)
        assert np.mean(power[inside] * 2 * np.pi * frequency[inside]) == pytest.approx((5e-5) ** 2, rel=0.1), low


def test_all_terms_of_one_unit_come_back_from_its_deviations() -> None:
    """variance(T) = N^2 / T + (2 ln 2 / pi) B^2 + K^2 T / 3; N leads below 3 s, K above 100 s, B in between."""
    n, b, k = 1e-3, 1.2e-3, 6e-5
    imu = Imu(rate=RATE, gyro_density=n, gyro_bias=Drift(flicker=b, walk=k))
    m = counts(0.1, 2000.0)
    variance, t = allan_deviation(recorded(imu, 100_000), 1 / RATE, m) ** 2, np.array(m) / RATE
    terms = np.stack([1 / t, np.full(len(t), FLOOR**2), t / 3], axis=1) / variance[:, None]
    fitted = np.sqrt(nnls(terms, np.ones(len(t)))[0])
    assert fitted == pytest.approx([n, b, k], rel=0.1)


def test_quanta_of_increments_fall_with_the_averaging_time() -> None:
    """Q = quantum / rate / sqrt(12) of angle, deviation sqrt(3) Q / T: what is left over is not lost (IEEE Std 952, annex C)."""
    rows, quantum = 20_000, 1e-3
    generator = np.random.default_rng(5)
    imu = Imu(rate=RATE, sample="increment", gyro_axes=Triad(quantum=quantum))
    turning = np.cumsum(generator.standard_normal((rows, 3)), axis=0)  # far more than a quantum a row: errors of rounding are independent
    table = records.Imu(time=np.arange(rows) / RATE, delta_angle=turning, delta_velocity=0 * turning, interval=np.full(rows, 1 / RATE))
    error = (imu.record(table, generator).delta_angle - turning) * RATE
    m = counts(0.5, 50.0)
    found = allan_deviation(error, 1 / RATE, m) * np.array(m) / RATE
    assert found == pytest.approx(np.sqrt(3) * quantum / RATE / np.sqrt(12), rel=0.1)


def test_flicker_leaves_all_other_noise_as_it_is() -> None:
    time, nothing = np.arange(500) / RATE, np.zeros((500, 3))
    table = records.Imu(time=time, gyro=nothing, accel=nothing)
    plain = Imu(rate=RATE, gyro_density=1e-3, accel_density=1e-2, gyro_bias=Drift(0.0, 1e-3, 1e-3, 10.0, 1e-4))
    more = Imu(rate=RATE, gyro_density=1e-3, accel_density=1e-2, gyro_bias=Drift(0.0, 1e-3, 1e-3, 10.0, 1e-4, 1e-2))
    first, second = (imu.record(table, np.random.default_rng(3)) for imu in (plain, more))
    assert_array_equal(first.accel, second.accel)
    assert np.std(second.gyro - first.gyro) > 5e-3


def test_flicker_at_uneven_times_is_that_of_the_times() -> None:
    """Rows at random times, brought to seconds by their means: the floor lies where it belongs."""
    generator = np.random.default_rng(8)
    time = np.sort(generator.uniform(0.0, 1200.0, 6000))
    drawn = Drift(flicker=1.0).draw(time, 60, generator)
    bins = np.floor(time).astype(int)
    mean = np.stack([np.bincount(bins, column, 1200) / np.maximum(np.bincount(bins, minlength=1200), 1) for column in drawn.T], axis=1)
    mean[np.bincount(bins, minlength=1200) == 0] = np.nan
    filled = np.stack([np.interp(np.arange(1200), np.flatnonzero(np.isfinite(c)), c[np.isfinite(c)]) for c in mean.T], axis=1)
    assert allan_deviation(filled, 1.0, [4, 8, 16, 32, 64]) == pytest.approx(FLOOR, rel=0.1)
