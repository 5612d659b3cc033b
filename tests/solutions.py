"""Synthetic solutions for tests: small, exact, and made without an estimator."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from leadline.core import attitude, geodesy
from leadline.data.log import Origin
from leadline.data.outcome import Outcome
from leadline.data.records import Truth
from leadline.data.solution import Estimate, Innovations, Solution, Status

EPOCH = datetime(2024, 5, 1, 9, tzinfo=UTC)
HAIFA = Origin(np.radians(32.84), np.radians(34.92))
SIGMA = np.array([1.0, 1.0, 0.2, 0.02, 0.02, 0.02, 0.002, 0.002, 0.01])


def no_innovations():
    return innovations([])


def innovations(parts):
    """Join tables made by `group_rows`."""
    names = list(Innovations.__dataclass_fields__)
    if not parts:
        text, whole = np.empty(0, np.str_), np.empty(0, np.int64)
        kinds = {
            "sensor": text,
            "component": text,
            "row": whole,
            "group": whole,
            "dof": whole,
            "outcome": whole,
            "widened": np.empty(0, bool),
        }
        return Innovations(**{name: kinds.get(name, np.empty(0)) for name in names})
    shift, joined = 0, []
    for part in filter(len, parts):
        joined.append(replace(part, group=part.group + shift))
        shift += int(part.group.max()) + 1
    return Innovations(**{name: np.concatenate([getattr(part, name) for part in joined]) for name in names})


def group_rows(sensor, time, residual, sigma, components, *, gate=0.999, outliers=()):
    """One group per row of residual (n, d) with stated sigma (d,): gated by its own nis as an estimator would."""
    from scipy.stats import chi2

    residual = np.array(residual, float).reshape(len(time), -1)
    n, d = residual.shape
    residual[[row for row in outliers if row < n]] += 30.0 * np.asarray(sigma)
    sigma = np.broadcast_to(sigma, (n, d))
    nis = np.sum((residual / sigma) ** 2, axis=1)
    outcome = np.where(nis > chi2.ppf(gate, d), Outcome.GATED, Outcome.USED)
    each = np.repeat(np.arange(n), d)
    time = np.asarray(time, float)[each]
    return Innovations(
        sensor=np.full(n * d, sensor),
        row=each,
        group=each,
        time=time,
        applied=np.where(outcome[each] == Outcome.USED, time, np.nan),
        component=np.tile(np.array(components), n),
        residual=residual.ravel(),
        sigma=np.array(sigma).ravel(),
        nis=nis[each],
        dof=np.full(n * d, d),
        gate_probability=np.full(n * d, gate),
        widened=np.zeros(n * d, bool),
        outcome=outcome[each].astype(np.int64),
    )


def lost_rows(sensor, time, outcome):
    """Rows that were not looked at."""
    n = len(time)
    nothing = np.full(n, np.nan)
    return Innovations(
        sensor=np.full(n, sensor), row=np.arange(n) + 1_000_000, group=np.arange(n), time=np.asarray(time, float), applied=nothing,
        component=np.full(n, ""), residual=nothing, sigma=nothing, nis=nothing, dof=np.zeros(n, np.int64), gate_probability=nothing,
        widened=np.zeros(n, bool), outcome=np.full(n, int(outcome)),
    )  # fmt: skip


def solution(time, north, east, depth, velocity_n, heading, *, origin=HAIFA, covariance=None, table=None, roll=0.0, pitch=0.0, **more):
    """A solution on a given path, with constant covariance unless one is given."""
    time, north, east, depth, heading = (np.asarray(v, float) + 0.0 * np.asarray(time, float) for v in (time, north, east, depth, heading))
    latitude, longitude = geodesy.from_north_east(north, east, origin.latitude, origin.longitude)
    covariance = np.tile(np.diag(SIGMA**2), (len(time), 1, 1)) if covariance is None else covariance
    return Solution(
        epoch=EPOCH, origin=origin, time=time, latitude=latitude, longitude=longitude, height=17.0 - depth, depth=depth, north=north,
        east=east, velocity_n=np.asarray(velocity_n, float), quaternion_nb=attitude.quaternion_from_euler(roll, pitch, heading),
        covariance=covariance, status=more.pop("status", np.full(len(time), Status.AIDED, np.int64)),
        innovations=no_innovations() if table is None else table, **more,
    )  # fmt: skip


def straight(time, *, speed=1.5, heading=0.7, depth=20.0, **more):
    """A straight run from the origin."""
    time = np.asarray(time, float)
    velocity = np.tile([speed * np.cos(heading), speed * np.sin(heading), 0.0], (len(time), 1))
    return solution(time, velocity[:, 0] * time, velocity[:, 1] * time, depth, velocity, heading, **more)


def truth_of(estimate, rows=slice(None)):
    """The truth table that a solution without errors would have."""
    roll, pitch, heading = attitude.euler_from_quaternion(estimate.quaternion_nb[rows])
    return Truth(
        time=estimate.time[rows], latitude=estimate.latitude[rows], longitude=estimate.longitude[rows], depth=estimate.depth[rows],
        roll=roll, pitch=pitch, heading=heading, velocity=estimate.velocity_n[rows],
    )  # fmt: skip


def lawnmower(time, *, leg=250.0, spacing=60.0, speed=1.5, radius=30.0):
    """North, east, velocity (n, 3) and heading of a lawnmower with half-circle turns."""
    period = leg + np.pi * radius
    s = speed * np.asarray(time, float)
    number, along = np.divmod(s, period)
    up = np.where(number % 2 == 0, 1.0, -1.0)
    angle = np.clip((along - leg) / radius, 0.0, np.pi)
    north = np.where(up > 0, 0.0, leg) + up * np.minimum(along, leg) + up * radius * np.sin(angle)
    east = number * spacing + radius * (1 - np.cos(angle))
    heading = np.where(up > 0, angle, np.pi - angle)
    velocity = speed * np.stack([np.cos(heading), np.sin(heading), 0 * s], axis=1)
    return north, east, velocity, heading


def survey(seed=0, minutes=30, rate=2.0):
    """A survey of half an hour with DVL, pressure, GNSS at both ends and USBL: gated fixes, bottom lock lost for three minutes, truth."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 60.0 * minutes, 1.0 / rate)
    north, east, velocity, heading = lawnmower(time)
    depth = np.minimum(0.05 * time, 25.0) + 0.4 * np.sin(2 * np.pi * time / 300.0)
    velocity = velocity + np.array([0.0, 0.0, 1.0]) * np.gradient(depth, time)[:, None]
    lost = (time > 600) & (time < 780)
    truth = solution(time, north, east, depth, velocity, heading, roll=0.02 * np.sin(time / 5.0), pitch=0.03 * np.sin(time / 7.0))
    sigma = _survey_sigma(time, lost)
    error = _smooth(rng, len(time)) * sigma
    turned = attitude.product(attitude.exponential(error[:, 6:]), truth.quaternion_nb)
    roll, pitch, shown = attitude.euler_from_quaternion(turned)
    estimate = solution(
        time, north + error[:, 0], east + error[:, 1], depth + error[:, 2], velocity + error[:, 3:6], shown, roll=roll, pitch=pitch,
        covariance=sigma[:, :, None] * np.eye(9) * sigma[:, None, :], table=_survey_table(rng, time), status=_survey_status(time, lost),
        nuisances=_survey_nuisances(rng, time), altitude=40.0 - depth, summary=_survey_summary(),
    )  # fmt: skip
    return estimate, truth_of(truth)


def _survey_sigma(time, lost):
    since = np.where(lost, time - 600.0, 0.0)
    sigma = np.tile(SIGMA, (len(time), 1))
    sigma[:, :2] += 0.03 * since[:, None] + 0.0008 * time[:, None]
    sigma[:, 3:5] += 0.0005 * since[:, None]
    return sigma


def _smooth(rng, n, memory=60):
    white = rng.standard_normal((n + 4 * memory, 9))
    kernel = np.exp(-np.arange(4 * memory) / memory)
    kernel /= np.linalg.norm(kernel)
    return np.stack([np.convolve(white[:, k], kernel, mode="full")[4 * memory : 4 * memory + n] for k in range(9)], axis=1)


def _survey_status(time, lost):
    status = np.where(lost, Status.DEAD_RECKONING, Status.AIDED)
    return np.where(time < 60, Status.ALIGNING, status).astype(np.int64)


def _survey_table(rng, time):
    dvl_time = np.arange(1.0, time[-1], 0.5)
    seen = (dvl_time <= 600) | (dvl_time >= 780)
    usbl_time = np.arange(90.0, time[-1], 20.0)
    gnss_time = np.concatenate([np.arange(1.0, 30.0), [time[-1] - 1.0]])
    depth_time = time[1:]
    return innovations(
        [
            group_rows("dvl", dvl_time[seen], 0.02 * rng.standard_normal((seen.sum(), 3)), [0.02] * 3, ["x", "y", "z"]),
            lost_rows("dvl", dvl_time[~seen], Outcome.INVALID),
            group_rows("pressure", depth_time, 0.15 * rng.standard_normal(len(depth_time)), [0.1], ["depth"]),
            group_rows(
                "usbl", usbl_time, 2.0 * rng.standard_normal((len(usbl_time), 2)), [2.0, 2.0], ["north", "east"], outliers=[7, 23, 24, 60]
            ),
            group_rows("gnss", gnss_time, 1.0 * rng.standard_normal((len(gnss_time), 2)), [1.0, 1.0], ["north", "east"]),
            lost_rows("modem", usbl_time[::4], Outcome.NOT_CONFIGURED),
        ]
    )


def _survey_nuisances(rng, time):
    settle = np.exp(-time / 300.0)
    walk = 0.1 * np.cumsum(rng.standard_normal(len(time))) / np.sqrt(len(time))
    return {
        "dvl.scale": Estimate(0.004 * (1 - settle) + 1e-4 * walk, 0.003 * settle + 3e-4, "1"),
        "imu.gyro_bias_z": Estimate(np.radians(0.3 + 0.1 * walk) / 3600, np.radians(1.0 * settle + 0.05) / 3600, "rad/s", "body"),
        "current_north": Estimate(0.12 + 0.05 * walk, 0.1 * settle + 0.02, "m/s", "north-east-down"),
    }


def _survey_summary():
    return {
        "version": "0.1.0",
        "command": "leadline solve survey --vehicle snapir.toml",
        "inputs": {"survey/log.toml": "9f2c41a07b1e", "snapir.toml": "12d3aa54c0ff"},
        "process": "inertial",
        "estimator": "ekf",
        "vehicle": "snapir",
        "wall_s": 1.42,
    }
