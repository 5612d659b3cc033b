"""Jacobians against central differences: every sensor channel, and the process model, at random places and attitudes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from math import radians

import numpy as np
import pytest
from twin import vehicle

from leadline.core import attitude, geodesy
from leadline.core.compiled import COMPONENTS, NUISANCES, WIDE
from leadline.core.earth import offset
from leadline.data.log import Origin
from leadline.data.vehicle import Vehicle, vehicle_from_toml
from leadline.estimate.displacement import displace, pull_back
from leadline.estimate.plan import CHANNEL, CHANNEL_SIZE, DRIFT_S, LEVER_S, OFFSET_S, TIME_S
from leadline.models.body_velocity import body_velocity
from leadline.models.inertial import inertial
from leadline.models.layout import INPUTS, MOTION, NOW_U, Layout, difference, retract
from leadline.models.nuisance import Nuisance
from leadline.models.processes import compose_process
from leadline.models.sensor import Channel, Context
from leadline.models.sensors import compose
from leadline.models.view import TANGENT, VIEW_SIZE, retract_view, view_of

ABOARD = """
    [sensors.imu]
    rate_hz = 100.0
    gyro_noise_deg_per_rth = 0.1
    gyro_bias_deg_per_h = 10.0
    accel_noise_ug_per_rthz = 100.0
    accel_bias_ug = 1000.0
    [sensors.dvl]
    sigma_mps = 0.01
    lever_arm_m = [-0.5, 0.1, 0.2]
    mounting_deg = [170.0, 3.0, 45.0]
    beam_azimuth_deg = [45.0, 135.0, 225.0, 315.0]
    beam_tilt_deg = 30.0
    [sensors.depth]
    lever_arm_m = [0.6, 0.1, -0.1]
    sigma_m = 0.02
    [sensors.heading]
    sigma_deg = 0.5
    [sensors.attitude]
    sigma_deg = 1.0
    sigma_tilt_deg = 0.5
    [sensors.gnss]
    lever_arm_m = [0.3, 0.2, -0.9]
    sigma_m = 1.5
    [sensors.usbl]
    kind = "position_fix"
    lever_arm_m = [0.1, 0.0, -0.3]
    sigma_m = 1.5
    [sensors.zero_velocity]
    sigma_mps = 0.01
    [sensors.water_velocity]
    sigma_mps = 0.02
    lever_arm_m = [-0.5, 0.1, 0.2]
    mounting_deg = [170.0, 3.0, 45.0]
    beam_azimuth_deg = [45.0, 135.0, 225.0]
    beam_tilt_deg = 30.0
    [sensors.speed]
    sigma_mps = 0.1
    lever_arm_m = [0.9, 0.1, 0.2]
    mounting_deg = [0.0, 5.0, 10.0]
    [sensors.pressure]
    sigma_pa = 200.0
    lever_arm_m = [0.6, 0.1, -0.1]
    [sensors.tank]
    kind = "pressure"
    sigma_pa = 200.0
    density_kgpm3 = 998.0
    gravity_mps2 = 9.79
    [sensors.altimeter]
    sigma_m = 0.1
    lever_arm_m = [0.6, 0.1, -0.1]
    mounting_deg = [10.0, 5.0, 0.0]
    [sensors.dvl_b]
    kind = "dvl"
    sigma_mps = 0.01
    altitude_sigma_m = 0.5
    lever_arm_m = [-0.5, 0.1, 0.2]
    [sensors.yaw_rate]
    noise_deg_per_rth = 0.1
    rate_hz = 100.0
    mounting_deg = [20.0, 30.0, 0.0]
    [sensors.navigation]
    use = "increments"
    sigma_m = 0.1
    sigma_depth_m = 0.1
    sigma_heading_deg = 0.1
    lever_arm_m = [0.4, 0.1, -0.2]
    [seabed]
    depth = { value_m = 150.0 }
    [sensors.ranges]
    kind = "acoustic_range"
    lever_arm_m = [0.8, 0.1, -0.2]
    sigma_m = 0.3
"""
CHANNELS = [
    *(f"dvl {i} {label}" for i, label in enumerate(("sensor", "body", "level", "ned", "beam1", "beam2", "beam3", "beam4"))),
    *(f"water_velocity {i} {label}" for i, label in enumerate(("sensor", "body", "level", "ned", "beam1", "beam2", "beam3"))),
    "depth 0", "heading 0", "attitude 0", "gnss 0 horizontal", "gnss 1 vertical", "gnss 2 velocity", "usbl 0 horizontal", "usbl 1 depth",
    "zero_velocity 0", "speed 0", "pressure 0 sea", "tank 0 density", "altimeter 0", "imu 0 gyros", "imu 1 level",
    "dvl_b 4 altitude", "yaw_rate 0",
    "navigation 0 horizontal", "navigation 1 depth", "navigation 2 heading", "ranges 0 one way", "ranges 1 two ways",
]  # fmt: skip
# Per tangent direction, small enough for the third derivative and large enough for the rounding of an Earth-fixed position (1e-9 m).
STEPS = np.repeat([0.03, 1e-3, 1e-4, 1e-3, 1e-3, 1e-3], 3)


@cache
def aboard() -> Vehicle:
    return vehicle_from_toml('name = "all"\n' + ABOARD)


@cache
def channels() -> dict[str, tuple[Channel, ...]]:
    found = aboard()
    context = Context(np.array([0.2, -0.1, 0.05]), 17.0, Origin(0.5, 0.6), shared=found.shared)
    sensors = found.sensors
    return {name: sensor.channels for name, config in sensors.items() if (sensor := compose(config, context)) is not None}


def random_view(generator: np.random.Generator, near: np.ndarray | None = None) -> np.ndarray:
    """A view anywhere up to 89.95 degrees (or within 100 m of another), pitched up to 80 degrees, with wandering azimuth."""
    if near is None:
        latitude = generator.choice([generator.uniform(-1.4, 1.4), radians(89.95), radians(-89.9)])
        quaternion = attitude.quaternion_from_euler(*(generator.uniform(-1, 1, 3) * (np.pi, radians(80.0), np.pi)))
        view = view_of(
            latitude, generator.uniform(-np.pi, np.pi), -100.0, quaternion, generator.normal(0.0, 1.5, 3), generator.normal(0.0, 0.3, 3)
        )
        view[0:4] = attitude.product(view[0:4], attitude.quaternion_from_euler(0.0, 0.0, generator.uniform(-np.pi, np.pi)))
        view[15:21] = generator.normal(0.0, 3.0, 6)
        return view
    view, d = near.copy(), np.zeros(TANGENT)
    d[:9] = generator.normal(0.0, 1.0, 9) * np.repeat([30.0, 1.0, 0.3], 3)
    retract_view(view, d)
    return view


def position_e(view: np.ndarray) -> np.ndarray:
    up = -attitude.matrix_from_quaternion(view[0:4])[:, 2]
    return geodesy.ecef_from_geodetic(np.arcsin(up[2]), np.arctan2(up[1], up[0]), view[4])


def latitude_of(view: np.ndarray) -> float:
    return float(np.arcsin(-attitude.matrix_from_quaternion(view[0:4])[2, 2]))


def random_row(name: str, channel: Channel, view: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """A row as the sensor's `read` would make it: what the Jacobian depends on lies within what a gate lets through."""
    row = generator.normal(0.0, 1.0, channel.row_length + 1)
    if name == "attitude":
        north = attitude.quaternion_from_euler(0.0, 0.0, _wander(view))
        error = attitude.exponential(generator.normal(0.0, 0.05, 3))
        row[3:7] = attitude.product(error, attitude.product(north, view[8:12]))
        heading = attitude.euler_from_quaternion(row[3:7])[2]
        row[7:9] = np.cos(heading), np.sin(heading)
    elif "north" in channel.components and channel.epochs == 1:
        row[2:5] = position_e(view) + generator.normal(0.0, 5.0, 3)
    elif name == "ranges":
        away = generator.normal(0.0, 1.0, 3)
        row[2:5] = position_e(view) + generator.uniform(200.0, 3000.0) * away / np.linalg.norm(away)
    elif "beam" in channel.components[0]:
        row[2:5] /= np.linalg.norm(row[2:5])
    return row


def _wander(view: np.ndarray) -> float:
    axis = attitude.matrix_from_quaternion(view[0:4])[2]
    return float(np.arctan2(-axis[1], axis[0]))


def predicted(channel: Channel, views: np.ndarray, nuisance: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, Hv and Hn as the kernel gives them."""
    z, R = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
    Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
    assert channel.predict(views, nuisance, row, channel.parameters, z, R, Hv, Hn) == 0
    c, n = len(channel.components), len(channel.nuisances)
    assert not Hv[c:].any()
    assert not Hv[:, TANGENT * channel.epochs :].any()
    return z[:c], Hv[:c, : TANGENT * channel.epochs], Hn[:c, :n]


def test_every_channel_is_tested() -> None:
    """Of a channel that stands in the sensor list of this page; those of several beams differ by a row alone."""
    named = {(name, int(index)) for name, index, *_ in map(str.split, CHANNELS)}
    whole = {(name, i) for name, parts in channels().items() for i in range(len(parts))}
    assert {name for name, _ in named} == {name for name, _ in whole}
    assert {pair for pair in whole - named if pair[0] != "dvl_b"} == set()


def central(value: Callable[[float], np.ndarray], step: float, angles: bool = False) -> np.ndarray:
    """Central difference; components that are angles may wrap."""
    change = value(step) - value(-step)
    return (attitude.wrapped(change) if angles else change) / (2 * step)


def moved(views: np.ndarray, j: int, h: float) -> np.ndarray:
    views, d, at = views.copy(), np.zeros(TANGENT), VIEW_SIZE * (j // TANGENT)
    d[j % TANGENT] = h
    retract_view(views[at : at + VIEW_SIZE], d)
    return views


@pytest.mark.parametrize("which", CHANNELS)
def test_sensor(which: str) -> None:
    """Hv and Hn of every channel are the derivatives of its value: to 2e-6 of the row's largest, at 30 random views and nuisances.

    Left out everywhere is how north turns against the navigation frame as that moves: tan(latitude) / R per metre, times the value.
    """
    name, index = which.split()[:2]
    channel, generator = channels()[name][int(index)], np.random.default_rng(7)
    for _ in range(30):
        first = random_view(generator)
        while name == "altimeter" and attitude.matrix_from_quaternion(first[8:12])[2, 2] < 0.5:  # it must see the sea bed
            first = random_view(generator)
        views = np.concatenate([first, random_view(generator, near=first)])
        nuisance, row = generator.normal(0.0, 0.05, NUISANCES), random_row(name, channel, first, generator)
        z, Hv, Hn = predicted(channel, views, nuisance, row)

        def value(h: float, j: int, views: np.ndarray = views, nuisance: np.ndarray = nuisance, row: np.ndarray = row) -> np.ndarray:
            if j < TANGENT * channel.epochs:
                return predicted(channel, moved(views, j, h), nuisance, row)[0]
            return predicted(channel, views, nuisance + h * np.eye(NUISANCES)[j - TANGENT * channel.epochs], row)[0]

        count, wraps = Hv.shape[1], any(channel.angles)
        by_view = [central(partial(value, j=j), STEPS[j % TANGENT], wraps) for j in range(count)]
        curved = name in ("navigation", "heading", "attitude")  # of a turned displacement, of a deviation
        turns = 1e-5 if curved else 1e-3
        by_nuisance = [central(partial(value, j=count + j), turns, wraps) for j in range(Hn.shape[1])]
        bar = np.repeat(2e-6 * (1.0 + np.abs(Hv).max(axis=1, keepdims=True)), Hv.shape[1], axis=1)
        bar[:, 0:2] += abs(np.tan(latitude_of(first))) / 6.3e6 * (1.0 + np.abs(z).max())
        np.testing.assert_array_less(np.abs(Hv - np.stack(by_view, axis=1)) / bar, 1.0)
        if by_nuisance:
            np.testing.assert_array_less(np.abs(Hn - np.stack(by_nuisance, axis=1)), 1e-8 * (1.0 + np.abs(Hn).max()))


# --- displaced views ---------------------------------------------------------------------------------------------------------------


def displaced_slope(view: np.ndarray, dt: float, lever: np.ndarray, time: float) -> np.ndarray:
    """The derivative of a displaced view against the view (18), then against time offset, clock offset, drift and lever arm (6)."""
    plan = np.zeros(CHANNEL + CHANNEL_SIZE, np.int64)
    plan[[CHANNEL + TIME_S, CHANNEL + OFFSET_S, CHANNEL + DRIFT_S, CHANNEL + LEVER_S]] = 0, 1, 2, 3
    Hv, H = np.eye(TANGENT), np.zeros((TANGENT, 6))
    pull_back(plan, 0, time, view, dt, tuple(lever), Hv, H, TANGENT)
    return np.hstack([Hv, H])


def displaced_numerically(view: np.ndarray, dt: float, lever: np.ndarray, time: float) -> np.ndarray:
    """The same by central differences of `displace`; a sensor that is late by o looked at dt - o."""

    def at(view: np.ndarray, late: float = 0.0, more: np.ndarray | float = 0.0) -> np.ndarray:
        out = view.copy()
        displace(out, dt - late, tuple(lever + more))
        return view_difference(out, origin)

    origin = view.copy()
    displace(origin, dt, tuple(lever))
    columns = []
    for j in range(TANGENT):
        d = np.eye(TANGENT)[j] * STEPS[j]
        ahead, behind = view.copy(), view.copy()
        retract_view(ahead, d)
        retract_view(behind, -d)
        columns.append((at(ahead) - at(behind)) / (2 * STEPS[j]))
    columns += [(at(view, 1e-3 * factor) - at(view, -1e-3 * factor)) / 2e-3 for factor in (1.0, 1.0, time)]
    columns += [(at(view, 0.0, arm) - at(view, 0.0, -arm)) / 2e-2 for arm in 1e-2 * np.eye(3)]
    return np.stack(columns, axis=1)


def test_displacement() -> None:
    """Where nothing is displaced yet the Jacobian is exact (1e-6); what it leaves out grows with the displacement.

    Left out everywhere is how velocity and the direction of gravity turn with place: 1/R.
    """
    generator, time = np.random.default_rng(19), 3.0
    for _ in range(20):
        view = random_view(generator)
        dt, lever = generator.uniform(-0.1, 0.1), generator.normal(0.0, 0.2, 3)
        wrong = {}
        for part in (0.0, 0.5, 1.0):
            wrong[part] = np.abs(
                displaced_slope(view, part * dt, part * lever, time) - displaced_numerically(view, part * dt, part * lever, time)
            )
        assert wrong[0.0].max() < 1e-6 * (1.0 + abs(np.tan(latitude_of(view))))
        size = abs(dt) + np.linalg.norm(lever)
        assert wrong[1.0].max() < 4.5 * wrong[0.5].max() + 1e-6  # at most as its square
        assert wrong[1.0][:, :TANGENT].max() < size


# --- process models ----------------------------------------------------------------------------------------------------------------

MODELS = ("inertial", "body-velocity", "cruise", "planar")
# Of the errors in their order.  Place 1 m: its rounding is 1e-9 m, the curvature of the Earth 1e-7 of it.
PROCESS_STEPS = np.repeat([1.0, 1e-3, 1e-4, 1e-4, 1e-3], 3)
STEPS_OF = {
    "inertial": PROCESS_STEPS,
    "body-velocity": np.repeat([1.0, 1e-3, 1e-4], 3),
    "cruise": np.repeat([1.0, 1e-3, 1e-4], [3, 3, 6]),
    "planar": np.repeat([1.0, 1e-3, 1e-4, 1e-3, 1e-4], [3, 4, 4, 1, 2]),  # the last three errors are remembered numbers: none
}


@cache
def process_and_plan(model: str = "inertial") -> tuple:
    process = {
        "inertial": lambda: inertial(vehicle()["imu"], 17.0),
        "body-velocity": lambda: body_velocity(vehicle()["imu"], 17.0),
        "cruise": lambda: compose_process(aboard().moved_by("cruise"), Context(surface=17.0)),
        "planar": lambda: compose_process(aboard().moved_by("planar"), Context(surface=17.0)),
    }[model]()
    return process, Layout(process.parts, (), 0, 1).head()


def random_motion(generator: np.random.Generator, model: str = "inertial") -> tuple[np.ndarray, np.ndarray]:
    """A nominal state and an input; of `cruise` and `planar` with a pitch of up to 60 degrees."""
    view, u = random_view(generator), np.zeros(INPUTS)
    angles = generator.uniform(-1.0, 1.0, 3) * (0.3, radians(60.0), np.pi)
    rates = generator.normal(0.0, 0.3, 3)
    if model == "cruise":
        return np.concatenate([view[0:8], angles[:0:-1], rates[:0:-1], [angles[0], rates[0]]]), u
    if model == "planar":
        u[:8] = 117.0, 99.9, 0.01, *(angles[:2] + 0.05), 99.95, 1e-4, 1e-4
        u[NOW_U] = 100.0
        level = [*view[5:7], *generator.normal(0.0, 0.3, 2), angles[2], rates[2]]
        return np.concatenate([view[0:5], level, angles[:2], view[7:8], rates[:2], [0.2, 116.0, generator.choice([99.4, 99.9])]]), u
    force = attitude.matrix_from_quaternion(view[8:12]).T @ np.array([0.0, 0.0, -9.8]) + generator.normal(0.0, 1.0, 3)
    bias = [generator.normal(0.0, 1e-4, 3), generator.normal(0.0, 1e-2, 3)] if model == "inertial" else []
    return np.concatenate([view[0:12], *bias]), np.array([*generator.normal(0.0, 0.3, 3), *force, 1.0, 0.01])


def shifted(x: np.ndarray, j: int, h: float, model: str = "inertial") -> np.ndarray:
    x, d = x.copy(), np.zeros(WIDE)
    d[j] = h
    retract(process_and_plan(model)[1], x, d, process_and_plan(model)[1][MOTION])
    return x


def differenced(x: np.ndarray, y: np.ndarray, model: str = "inertial") -> np.ndarray:
    d = np.zeros(WIDE)
    difference(process_and_plan(model)[1], x, y, d)
    return d[: len(STEPS_OF[model])]


def view_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    turned = attitude.logarithm(attitude.product(a[8:12], attitude.conjugate(b[8:12])))
    return np.concatenate([offset(a, 0, b, 0), a[5:8] - b[5:8], turned, a[12:21] - b[12:21]])


def test_a_gap_in_one_step_is_as_uncertain_as_in_many() -> None:
    """White acceleration through 0.3 s: q t^3 / 3, q t^2 / 2, q t, however the time is cut."""
    process, _ = process_and_plan()
    x, u = random_motion(np.random.default_rng(3))
    u[6] = 0.0

    def grown(steps: int) -> np.ndarray:
        here, P, memory = x.copy(), np.zeros((WIDE, WIDE)), np.zeros(64)
        for _ in range(steps):
            half, full = np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
            process.step(here, u, 0.3 / steps, process.parameters, memory)
            process.push(memory, 0.3 / steps, process.parameters, P.ravel(), half, 16)
            process.push(memory, 0.3 / steps, process.parameters, half.reshape(WIDE, WIDE).T.ravel(), full, 16)
            P = full.reshape(WIDE, WIDE).copy()
            process.noise(memory, 0.3 / steps, process.parameters, P.reshape(-1))
        return P[:6, :6]

    q = grown(1)[3, 3] / 0.3
    assert q > 0.0
    exact = q * np.kron([[0.3**3 / 3, 0.3**2 / 2], [0.3**2 / 2, 0.3]], np.eye(3))
    assert np.abs(grown(1) - exact).max() < 1e-12 * q
    assert np.abs(grown(30) - exact).max() < 1e-12 * q


@pytest.mark.parametrize("model", MODELS)
def test_pull(model: str) -> None:
    """`pull` of the identity is the derivative of the view; of the rate, what turns the Earth's and transport rate is left out (1/R)."""
    process, _ = process_and_plan(model)
    generator, steps = np.random.default_rng(11), STEPS_OF[model]
    n = len(steps)
    for _ in range(30):
        x, u = random_motion(generator, model)
        view, H = np.zeros(VIEW_SIZE), np.zeros((TANGENT, WIDE))
        process.view(x, u, process.parameters, view)
        process.pull(x, u, process.parameters, view, np.eye(TANGENT), H, TANGENT)

        def seen(x: np.ndarray, u: np.ndarray = u, origin: np.ndarray = view) -> np.ndarray:
            out = np.zeros(VIEW_SIZE)
            process.view(x, u, process.parameters, out)
            return view_difference(out, origin)

        numeric = np.stack([central(lambda h, j=j, x=x: seen(shifted(x, j, h, model)), steps[j]) for j in range(n)], axis=1)
        error = np.abs(H[:, :n] - numeric)
        if model in ("inertial", "body-velocity"):
            assert error[9:12, 3:6].max() < 2e-7  # transport rate by velocity: 1/R
            error[9:12, 3:6] = 0.0
            if model == "body-velocity":
                assert error[9:12, 6:9].max() < 2e-6  # and by attitude, which turns the velocity: v/R
                error[9:12, 6:9] = 0.0
        assert error.max() < 2e-8 * (1.0 + np.abs(H).max())  # the third derivative of an angle takes 1e-8 / 6 of a velocity


def transition_error(x: np.ndarray, u: np.ndarray, dt: float, model: str = "inertial") -> np.ndarray:
    """Transition by `push` of the identity, less that by differences of `step` over five points.

    Where angles turn velocities into places, whose rounding is 1e-9 m, the differences are wide: 0.02 rad leave h^4 / 30 of a velocity.
    """
    process, _ = process_and_plan(model)
    steps = STEPS_OF[model] if model in ("inertial", "body-velocity") else np.where(STEPS_OF[model] == 1e-4, 0.02, 1.0)
    n = len(steps)
    end, memory = x.copy(), np.zeros(WIDE * WIDE)
    process.step(end, u, dt, process.parameters, memory)
    unit, analytic = np.eye(WIDE).ravel(), np.full(WIDE * WIDE, np.nan)
    process.push(memory, dt, process.parameters, unit, analytic, 24)
    assert np.array_equal(unit, np.eye(WIDE).ravel())
    rows, whole = analytic.reshape(WIDE, WIDE), process_and_plan(model)[1][MOTION]
    assert np.isfinite(rows[:whole, :24]).all()
    assert np.isnan(rows[whole:]).all()

    def after(x: np.ndarray) -> np.ndarray:
        x = x.copy()
        process.step(x, u, dt, process.parameters, np.zeros(WIDE * WIDE))
        return differenced(x, end, model)

    def slope(j: int) -> np.ndarray:
        near, far = (central(lambda h: after(shifted(x, j, h, model)), factor * steps[j]) for factor in (1.0, 2.0))
        return (4.0 * near - far) / 3.0

    return rows[:n, :n] - np.stack([slope(j) for j in range(n)], axis=1)


@pytest.mark.parametrize("present", [1.0, 0.0], ids=["with input", "gap"])
def test_push(present: float) -> None:
    """The transition is right to first order: its error falls with dt^2, and error / dt extrapolates to what is left out.

    Left out: v / R, where it couples positions, or velocities, with each other; the attraction of the water in the gradient of
    gravity; and in a gap, that the held velocity and attitude do not feel the turning of the frame.
    """
    generator = np.random.default_rng(13)
    limit = np.full((15, 15), 1e-8)
    limit[:3, :3] = limit[3:6, 3:6] = 2e-6
    limit[5, 2] = 9e-7 if present else 4e-6
    limit[:3, 3:], limit[3:9, 6:] = 4e-3, 2e-3  # what is left of higher orders, (rate dt)^2, and the rounding of places
    limit[6:9, 3:6] = 1e-9 if present else 2e-7
    if not present:
        limit[3:6, 3:6] = 2e-4
    for _ in range(20):
        x, u = random_motion(generator)
        u[6] = present
        coarse, fine = transition_error(x, u, 0.02), transition_error(x, u, 0.01)
        if present:
            assert 3.8 < np.abs(coarse[3:6]).max() / np.abs(fine[3:6]).max() < 4.2
        np.testing.assert_array_less(np.abs(2.0 * fine / 0.01 - coarse / 0.02), limit)


@pytest.mark.parametrize("present", [1.0, 0.0], ids=["with input", "gap"])
def test_push_of_body_velocity_is_that_of_inertial(present: float) -> None:
    """In other variables: T'^-1 Phi T with d v_n = R d v_b + d theta x v_n before the step (T) and after it (T'), biases left aside.

    So it is right to first order, as that is, against differences of its own step.
    """
    generator = np.random.default_rng(14)

    def changed(x: np.ndarray) -> np.ndarray:
        rotation, change = attitude.matrix_from_quaternion(x[8:12]), np.eye(9)
        change[3:6, 3:6] = rotation
        change[3:6, 6:9] = np.cross(np.eye(3), rotation @ x[5:8]).T
        return change

    for _ in range(20):
        x, u = random_motion(generator, "body-velocity")
        u[6] = present
        process, y = process_and_plan("body-velocity")[0], x.copy()
        memory, found = np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
        process.step(y, u, 0.02, process.parameters, memory)
        process.push(memory, 0.02, process.parameters, np.eye(WIDE).ravel(), found, 16)
        plain, whole = process_and_plan()[0], np.zeros(WIDE * WIDE)
        z = np.concatenate([x[:5], attitude.matrix_from_quaternion(x[8:12]) @ x[5:8], x[8:12], np.zeros(6)])
        plain.step(z, u, 0.02, plain.parameters, memory := np.zeros(WIDE * WIDE))
        plain.push(memory, 0.02, plain.parameters, np.eye(WIDE).ravel(), whole, 16)
        expected = np.linalg.solve(changed(y), whole.reshape(WIDE, WIDE)[:9, :9] @ changed(x))
        np.testing.assert_allclose(found.reshape(WIDE, WIDE)[:9, :9], expected, rtol=0.0, atol=1e-14 * (1.0 + np.abs(expected).max()))
        coarse, fine = transition_error(x, u, 0.02, "body-velocity"), transition_error(x, u, 0.01, "body-velocity")
        limit = np.full((9, 9), 2e-6)  # 1/R, as of `inertial`
        limit[:3, 3:] = 4e-3  # the rounding of places
        np.testing.assert_array_less(np.abs(2.0 * fine / 0.01 - coarse / 0.02), limit)
        if present:
            assert 3.8 < np.abs(coarse[3:6]).max() / np.abs(fine[3:6]).max() < 4.2


@pytest.mark.parametrize("model", ["cruise", "planar"])
def test_push_is_the_derivative_of_a_step(model: str) -> None:
    """To 1e-6, at steps of up to 0.1 s; left out is v dt / R, how the directions turn with the place."""
    generator = np.random.default_rng(15)
    for dt in (0.1, 0.1, 0.03, 1e-3) * 10:
        x, u = random_motion(generator, model)
        error = np.abs(transition_error(x, u, dt, model))
        assert error.max() < 1e-6


def test_noise_adds_densities() -> None:
    """P grows by density times dt on the diagonal, and by the larger densities of a gap without input."""
    process, _ = process_and_plan()
    x, u = random_motion(np.random.default_rng(1))
    for present, (accel, gyro) in {1.0: process.parameters[1:3], 0.0: process.parameters[7:9]}.items():
        memory, P = np.zeros(64), np.zeros(WIDE * WIDE)
        u[6] = present
        process.step(x.copy(), u, 0.01, process.parameters, memory)
        process.noise(memory, 0.01, process.parameters, P)
        full = P.reshape(WIDE, WIDE)
        np.testing.assert_allclose(np.diag(full)[3:9], np.repeat([accel, gyro], 3) * 0.01, rtol=1e-14)
        shaken = full[:6, :6] if not present else np.zeros((6, 6))  # position and velocity in a gap: the test of a gap in one step
        full[:6, :6] -= shaken
        assert np.count_nonzero(full - np.diag(np.diag(full))) == 0


def test_retract_and_difference_are_inverse() -> None:
    """(x [+] d) [-] x = d, for motion and nuisances, to the rounding of a place."""
    process, _ = process_and_plan()
    layout = Layout(process.parts, (Nuisance("a", sigma=1.0), Nuisance("b", sigma=1.0)), 0, 1)
    generator, plan = np.random.default_rng(17), layout.head()
    for _ in range(100):
        x = np.concatenate([random_motion(generator)[0], generator.normal(size=2)])
        d, found, y = generator.normal(size=17) * np.repeat([100.0, 1.0, 0.5, 1e-4, 1e-2, 1.0], [3, 3, 3, 3, 3, 2]), np.zeros(17), x.copy()
        retract(plan, y, d, 17)
        difference(plan, y, x, found)
        np.testing.assert_allclose(found[:3], d[:3], atol=5e-9)
        np.testing.assert_allclose(found[3:], d[3:], atol=1e-14)
