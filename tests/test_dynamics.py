"""The moving hull against Fossen's matrices in NumPy, closed forms, what physics conserves, and what is published of REMUS."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from leadline.data.errors import InputError
from leadline.data.hull import Hull, hulls, read_hull
from leadline.sea.flow import elevation, flow
from leadline.simulate import dynamics
from leadline.simulate.dynamics import STILL, accelerations, at_rest, motion, site_at

if TYPE_CHECKING:
    from collections.abc import Iterable

    from leadline.data.records import Array

EPS = np.finfo(float).eps
FLAT = np.array([50.0, 1e30, 1e30, 9.81, 1025.0])
HULLS = [read_hull(name) for name in hulls()]
IDS = list(hulls())
REMUS = read_hull("remus-100")
each_hull = pytest.mark.parametrize("hull", HULLS, ids=IDS)


def water_of(north: float = 0.0, east: float = 0.0, tide: Iterable[float] = (), wave: Iterable[float] = ()) -> Array:
    """Uniform current (m/s), one tide (angular frequency, cosine 2, sine 2), one wave (a, k, w, direction 2, phase)."""
    tide, wave = [*tide], [*wave]
    head = [0.0, len(tide) / 5, len(wave) / 6, 1.0, 0.0, 1.0, 0.0, 0.0]
    return np.array([*head, *tide, *([0.0] if tide else []), *wave, north, east])


SEA = water_of(0.4, -0.3, (0.05, 0.2, 0.1, -0.15, 0.3), (1.5, 0.09, np.sqrt(9.81 * 0.09), 0.6, 0.8, 0.4))


# --- A second implementation, written from the matrices of Fossen (2021).


def skew(a: Array) -> Array:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def coriolis(mass: Array, nu: Array) -> Array:
    """C(nu) from a mass matrix (Fossen, 2021, eq. 3.46)."""
    one, two = -skew(mass[:3, :3] @ nu[:3] + mass[:3, 3:] @ nu[3:]), -skew(mass[3:, :3] @ nu[:3] + mass[3:, 3:] @ nu[3:])
    return np.block([[np.zeros((3, 3)), one], [one, two]])


def rigid(hull: Hull) -> Array:
    """M_RB = H^T diag(m, m, m, I at the centre) H for vehicle and enclosed water together (Fossen, 2021, section 3.3)."""
    m = hull.mass + hull.enclosed
    centre = (hull.mass * hull.gravity_centre_b + hull.enclosed * hull.buoyancy_centre_b) / m
    h = np.block([[np.eye(3), skew(centre).T], [np.zeros((3, 3)), np.eye(3)]])
    about_centre = hull.inertia_b + m * skew(centre) @ skew(centre)
    return h.T @ np.block([[m * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), about_centre]]) @ h


def wrench(place: Array, force: Array) -> Array:
    return np.concatenate([force, np.cross(place, force)])


def thruster_wrenches(hull: Hull, x: Array, nu_r: Array) -> Array:
    total = np.zeros(6)
    for n, t in zip(x[13:], hull.thrusters, strict=False):
        inflow = t.direction_b @ (nu_r[:3] + np.cross(nu_r[3:], t.position_b))
        force = (t.ahead if n > 0 else t.astern) * n * abs(n) - t.decay * abs(n) * inflow
        total += wrench(t.position_b, force * t.direction_b)
        total[3:] += t.torque * n * abs(n) * t.direction_b
    for angle, fin in zip(x[13 + len(hull.thrusters) :], hull.fins, strict=True):
        u = (nu_r[:3] + np.cross(nu_r[3:], fin.position_b))[0]
        total += wrench(fin.position_b, fin.lift * u * abs(u) * angle * fin.axis_b)
    return total


def lag_rates(hull: Hull, x: Array, command: Array) -> Array:
    rates = []
    for value, order, part in zip(x[13:], command, (*hull.thrusters, *hull.fins), strict=True):
        order = 0.0 if abs(order) < getattr(part, "dead_band", 0.0) else np.clip(order, -part.most, part.most)
        rates.append(np.clip((order - value) / part.lag, -part.quickest, part.quickest))
    return np.array(rates)


def strips(hull: Hull) -> list[Array]:
    """Middles of five equal parts of the hull's length, about the centre of buoyancy."""
    return [hull.buoyancy_centre_b + np.array([hull.length * share, 0.0, 0.0]) for share in (-0.4, -0.2, 0.0, 0.2, 0.4)]


def twin(time: float, x: Array, command: Array, hull: Hull, site: Array, water: Array) -> Array:
    """Return the derivative of the state by matrices."""
    rotation = Rotation.from_quat(x[3:7], scalar_first=True).as_matrix() * (x[3:7] @ x[3:7])
    nu, depth = x[7:13], site[0] + x[2] - x[0] ** 2 / (2 * site[1]) - x[1] ** 2 / (2 * site[2])
    found = np.array(flow(time, x[0], x[1], depth, water))
    stream, pull = rotation.T @ found[:3], rotation.T @ found[3:]
    nu_r = nu - np.r_[stream, 0, 0, 0]
    change = np.r_[pull - np.cross(nu[3:], stream), 0, 0, 0]
    own, added = rigid(hull), hull.added_mass
    down = rotation.T @ (np.array([-x[0] / site[1], -x[1] / site[2], 1.0]) / np.linalg.norm([x[0] / site[1], x[1] / site[2], 1.0]))
    hydrostatic = wrench(hull.gravity_centre_b, hull.mass * site[3] * down)
    for strip in strips(hull):
        at = x[:3] + rotation @ strip
        deep = site[0] + at[2] - at[0] ** 2 / (2 * site[1]) - at[1] ** 2 / (2 * site[2]) + elevation(time, x[0], x[1], water)
        wet = site[4] * hull.volume / 5 * np.clip(0.5 + deep / hull.height, 0, 1)
        hydrostatic += wrench(strip, (wet + hull.enclosed / 5) * pull - wet * site[3] * down)
    lift = np.zeros(6)
    for term in hull.terms:
        lift[term.force] += term.coefficient * (abs(nu_r[term.first]) if term.bare else nu_r[term.first]) * nu_r[term.second]
    damping = (hull.linear_damping + np.diag(hull.quadratic_damping * np.abs(nu_r))) @ nu_r
    tau = hydrostatic + thruster_wrenches(hull, x, nu_r) + lift
    acceleration = np.linalg.solve(own + added, tau + added @ change - coriolis(own, nu) @ nu - coriolis(added, nu_r) @ nu_r - damping)
    q = x[3:7]
    spin = 0.5 * np.r_[-q[1:] @ nu[3:], q[0] * nu[3:] + np.cross(q[1:], nu[3:])]
    return np.r_[rotation @ nu[:3], spin, acceleration, lag_rates(hull, x, command)]


def random_state(hull: Hull, generator: np.random.Generator) -> Array:
    x = at_rest(hull, position_t=generator.normal(0, [800, 800, 20]), nu=generator.normal(0, 1, 6) * [2, 1, 1, 0.5, 0.5, 0.5])
    x[3:7] = generator.standard_normal(4)
    x[3:7] /= np.linalg.norm(x[3:7])
    x[13:] = generator.uniform(-1, 1, hull.states - 13) * [part.most for part in (*hull.thrusters, *hull.fins)]
    return x


@each_hull
@pytest.mark.parametrize("water", [STILL, SEA], ids=["still", "sea"])
def test_the_kernel_agrees_with_the_matrices(hull: Hull, water: Array) -> None:
    """To 1e-11 of the largest term that goes into each row: what cancels in a row is not counted as an error of it."""
    generator = np.random.default_rng(11)
    site = site_at(0.7, 30.0)
    for _ in range(60):
        x = random_state(hull, generator)
        command = generator.uniform(-1.5, 1.5, hull.states - 13) * [part.most for part in (*hull.thrusters, *hull.fins)]
        dx = np.empty(hull.states)
        dynamics.derivative(17.0, x, command, hull.parameters, site, water, dx)
        expected = twin(17.0, x, command, hull, site, water)
        np.testing.assert_allclose(dx[:7], expected[:7], rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(dx[7:13], expected[7:13], rtol=1e-11, atol=1e-11 * np.abs(expected[7:13]).max())
        np.testing.assert_allclose(dx[13:], expected[13:], rtol=1e-12)


@each_hull
def test_coriolis_forces_do_no_work(hull: Hull) -> None:
    """nu^T C(nu) nu = 0 to rounding of its twelve products."""
    generator = np.random.default_rng(12)
    for mass, at in ((rigid(hull), dynamics.RIGID), (hull.added_mass, dynamics.ADDED)):
        for nu in generator.standard_normal((100, 6)):
            force = np.array(dynamics.centripetal(dynamics.momentum(hull.parameters, at, tuple(nu)), tuple(nu)))
            np.testing.assert_allclose(force, coriolis(mass, nu) @ nu, rtol=0, atol=1e-12 * np.abs(mass).max() * (nu @ nu))
            assert abs(nu @ force) < 20 * EPS * np.abs(mass).sum() * np.linalg.norm(nu) ** 3


# --- Closed forms and what is conserved.


def neutral(hull: Hull, density: float = 1025.0) -> Hull:
    """The hull with just the volume that carries it, its centre of gravity below its centre of buoyancy."""
    return replace(hull, volume=hull.mass / density)


@each_hull
def test_a_neutral_level_body_at_rest_stays(hull: Hull) -> None:
    """For an hour, to 1e-12 m/s: m g and rho V g differ by one rounding, 2e-16 g, which drag balances or which adds up to 8e-12 m/s.

    Where gravity is 1 and density 1 m / V exactly, nothing is left: the body stays where it is, bit for bit.
    """
    body = replace(hull, volume=hull.mass)
    site = np.array([50.0, 1e30, 1e30, 1.0, 1.0])
    states, _ = motion(body, at_rest(body), np.zeros((2, body.states - 13)), site, step=0.1, every=36000)
    np.testing.assert_allclose(states[-1], at_rest(body), rtol=0, atol=1e-12)


def straight(hull: Hull, share: float) -> tuple[Array, float, float, float]:
    """Command with all thrusters forward at a share of their most; thrust at rest (N), decay (N s/m), and the speed that is reached (m/s).

    a n^2 s - d n s^2 u summed, with s the cosine of each to the centreline, against X_u u + X_uu u^2.
    """
    along = np.array([t.direction_b[0] for t in hull.thrusters])
    n = np.where(np.abs(along) > 0.5, np.sign(along) * share * np.array([t.most for t in hull.thrusters]), 0.0)
    push = sum((t.ahead if k > 0 else t.astern) * k * abs(k) * s for t, k, s in zip(hull.thrusters, n, along, strict=True))
    fade = sum(t.decay * abs(k) * s * s for t, k, s in zip(hull.thrusters, n, along, strict=True))
    a, b = hull.quadratic_damping[0], hull.linear_damping[0, 0] + fade
    return np.r_[n, np.zeros(len(hull.fins))], push, fade, (np.sqrt(b * b + 4 * a * push) - b) / (2 * a)


@pytest.mark.parametrize("hull", [h for h in HULLS if h.name != "RexROV"], ids=[i for i in IDS if i != "rexrov"])
def test_a_thrust_gives_the_speed_of_the_closed_form(hull: Hull) -> None:
    """M u' = T - b u - a u^2 from rest: (u - u1) / (u - u2) falls as exp(-a (u1 - u2) t / M); to the integrator's 1e-8.

    Thrusters at the height of the body origin and without torque, centres in the origin: nothing turns the body.  (RexROV, which has no
    plane of symmetry, is left out.)
    """
    flat = [replace(t, position_b=t.position_b * [1, 1, 0], torque=0.0) for t in hull.thrusters]
    body = replace(neutral(hull), thrusters=tuple(flat), gravity_centre_b=hull.buoyancy_centre_b)
    command, push, fade, speed = straight(body, 0.5)
    x = at_rest(body)
    x[13:] = command
    states, _ = motion(body, x, np.tile(command, (31, 1)), FLAT, step=0.02, every=50)
    a = body.quadratic_damping[0]
    other = -push / (a * speed)  # the product of the roots
    assert speed + other == pytest.approx(-(body.linear_damping[0, 0] + fade) / a)
    total = body.mass + body.enclosed + body.added_mass[0, 0]
    ratio = speed / other * np.exp(-a * (speed - other) / total * np.arange(31))
    np.testing.assert_allclose(states[:, 7], (speed - ratio * other) / (1 - ratio), rtol=0, atol=1e-8)


def energy(hull: Hull, x: Array, site: Array) -> float:
    """Kinetic energy with added mass, and potential of weight and buoyancy (of a hull that may emerge), flat site."""
    rotation = Rotation.from_quat(x[3:7], scalar_first=True).as_matrix()
    heavy = site[0] + x[2] + (rotation @ hull.gravity_centre_b)[2]
    half, carried = 0.5 * hull.height, 0.0
    for strip in strips(hull):
        deep = site[0] + x[2] + (rotation @ strip)[2]
        carried += (deep if deep > half else (deep + half) ** 2 / (4 * half) if deep > -half else 0.0) / 5
    return float(
        0.5 * x[7:13] @ (rigid(hull) + hull.added_mass) @ x[7:13] - hull.mass * site[3] * heavy + site[4] * hull.volume * site[3] * carried
    )


@each_hull
def test_a_hull_at_the_surface_is_righted(hull: Hull) -> None:
    """Held half out of the water with its nose up, it is turned down: the strips of the nose carry less than those of the tail."""
    for pitch in (0.3, -0.3):
        x = at_rest(hull, quaternion_tb=np.array([np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0]))
        deep = np.array([x[0], x[1], 40.0])
        site = np.array([0.0, 1e30, 1e30, 9.81, 1025.0])
        here, below = (
            ((rigid(hull) + hull.added_mass) @ accelerations(0.0, y, np.zeros(hull.states - 13), hull, site))[4]
            for y in (x, np.r_[deep, x[3:]])
        )
        assert np.sign(here - below) == -np.sign(pitch)


@each_hull
@pytest.mark.parametrize("depth", [40.0, 0.1], ids=["deep", "at the surface"])
def test_energy_never_grows_without_thrust(hull: Hull, depth: float) -> None:
    """Steps of 5 ms: what is left is rounding of the sum, 64 EPS of its largest part, and the integrator's error.

    The latter is bounded by what the same body without any drag gains or loses in the same steps (it should keep its energy), twice.
    """
    site = np.array([depth, 1e30, 1e30, 9.81, 1025.0])
    generator = np.random.default_rng(13)
    bare = replace(hull, linear_damping=np.zeros((6, 6)), quadratic_damping=np.zeros(6), terms=())
    for _ in range(3):
        x = random_state(hull, generator)
        x[:3], x[13:] = 0.0, 0.0
        x[7:13] *= 0.5
        commands = np.zeros((401, hull.states - 13))
        kept = [energy(bare, s, site) for s in motion(bare, x, commands, site, step=0.005)[0]]
        found = np.array([energy(hull, s, site) for s in motion(hull, x, commands, site, step=0.005)[0]])
        rounding = 64 * EPS * (hull.mass * 9.81 * (depth + 10) + np.abs(found).max())
        error = max(np.abs(np.diff(kept)).max(), np.ptp(kept) / 400)
        assert np.diff(found).max() < rounding + 2 * error
        assert found[-1] < found[0]


@each_hull
def test_without_drag_energy_and_momentum_stay(hull: Hull) -> None:
    """Free body: kinetic energy and the momentum M nu, turned into t, are those of the start (Kirchhoff); about the start, for the angular.

    Tolerance: sixteenth of the change from halving the step, as fourth order has it, and rounding.
    """
    bare = replace(hull, linear_damping=np.zeros((6, 6)), quadratic_damping=np.zeros(6), terms=())
    free = np.array([50.0, 1e30, 1e30, 0.0, 1025.0])
    x = random_state(hull, np.random.default_rng(14))
    x[:3], x[13:] = 0.0, 0.0
    x[7:13] *= 0.3

    def kept(state: Array) -> Array:
        rotation = Rotation.from_quat(state[3:7], scalar_first=True).as_matrix()
        momentum = (rigid(hull) + hull.added_mass) @ state[7:13]
        linear = rotation @ momentum[:3]
        return np.r_[0.5 * state[7:13] @ momentum, linear, rotation @ momentum[3:] + np.cross(state[:3], linear)]

    ends = [motion(bare, x, np.zeros((2, hull.states - 13)), free, step=5.0 / n, every=n)[0][-1] for n in (1000, 2000)]
    scale = np.abs(kept(x)).max()
    coarse, fine = (np.abs(kept(end) - kept(x)).max() for end in ends)
    assert fine < coarse / 8 + 2000 * EPS * scale
    assert fine < 1e-8 * scale


@each_hull
def test_a_body_at_rest_drifts_with_a_current(hull: Hull) -> None:
    """Drag pulls it along: within a per mille of the current's speed after long enough, and never faster."""
    body = neutral(hull)
    water = water_of(0.3, -0.2)
    states, _ = motion(body, at_rest(body), np.zeros((2, hull.states - 13)), FLAT, water, step=0.05, every=400_000)
    rotation = Rotation.from_quat(states[-1, 3:7], scalar_first=True).as_matrix()
    velocity = rotation @ states[-1, 7:10]
    miss = np.linalg.norm(velocity - [0.3, -0.2, 0.0])
    assert (
        miss < 1e-3 * np.hypot(0.3, 0.2) + 1.0 / 20000.0 * (hull.mass + hull.enclosed + hull.added_mass[1, 1]) / hull.quadratic_damping[0]
    )


@each_hull
def test_a_uniform_current_is_a_moving_frame(hull: Hull) -> None:
    """Galileo: the run in a current is the run in still water and a drift, to rounding grown by the run itself."""
    generator = np.random.default_rng(15)
    x = random_state(hull, generator)
    x[:3] = 0.0
    x[7:13] *= 0.3
    commands = generator.uniform(-0.5, 0.5, (21, hull.states - 13)) * [part.most for part in (*hull.thrusters, *hull.fins)]
    still, _ = motion(hull, x, commands, FLAT, step=0.02, every=10)
    moving = x.copy()
    current = np.array([0.7, -0.4, 0.0])
    moving[7:10] += Rotation.from_quat(x[3:7], scalar_first=True).inv().apply(current)
    carried, _ = motion(hull, moving, commands, FLAT, water_of(0.7, -0.4), step=0.02, every=10)
    away = carried[:, :3] - still[:, :3] - np.outer(np.arange(21) * 0.2, current)
    turned = Rotation.from_quat(still[:, 3:7], scalar_first=True).inv().apply(np.tile(current, (21, 1)))
    finer = motion(hull, x, commands, FLAT, step=0.01, every=20)[0]
    error = 4 * np.abs(finer - still).max() + 1e-10
    assert np.abs(away).max() < error
    np.testing.assert_allclose(carried[:, 7:10] - turned, still[:, 7:10], rtol=0, atol=error)
    np.testing.assert_allclose(carried[:, 3:7], still[:, 3:7], rtol=0, atol=error)


def test_a_neutral_body_goes_with_water_that_accelerates() -> None:
    """A tide in which the water accelerates: the body, as heavy as the water, goes with it and feels no drag; so Froude and Krylov."""
    body = replace(neutral(REMUS), gravity_centre_b=np.zeros(3))
    water = water_of(tide=(0.5, 0.4, -0.2, 0.0, 0.0))
    x = at_rest(body, nu=np.array([0.4, -0.2, 0, 0, 0, 0]))
    states, _ = motion(body, x, np.zeros((101, 3)), FLAT, water, step=0.01, every=10)
    time = np.arange(101) * 0.1
    swing = np.stack([0.4 * np.cos(0.5 * time), -0.2 * np.cos(0.5 * time), 0 * time], axis=1)
    np.testing.assert_allclose(states[:, 7:10], swing, rtol=0, atol=1e-9)


@each_hull
def test_the_integrator_is_of_fourth_order(hull: Hull) -> None:
    """Errors at half the step are a sixteenth: a ratio between 14 and 18, against steps 16 times finer.

    While no velocity changes its sign: there |u| u has a kink in its slope.
    """
    body = replace(hull, fins=tuple(replace(f, quickest=1e9) for f in hull.fins))
    x = at_rest(body, nu=np.array([0.8, 0.4, 0.4, 0.5, 0.5, 0.5]))
    x[13:] = [0.3 * part.most for part in (*body.thrusters, *body.fins)]
    command = np.tile([0.5 * part.most for part in (*body.thrusters, *body.fins)], (2, 1))
    ends = {n: motion(body, x, command, FLAT, step=0.08 / n, every=n)[0][-1] for n in (8, 16, 256)}
    errors = [np.linalg.norm((ends[n] - ends[256])[:13]) for n in (8, 16)]
    assert 14 < errors[0] / errors[1] < 18


def test_a_hull_floats_with_part_of_it_above_the_surface() -> None:
    """rho V (depth / height + 1 / 2) = m: the depth at which it rests, whatever it started from."""
    body = replace(REMUS, volume=1.2 * REMUS.mass / 1025.0, linear_damping=np.diag([10.0, 10, 20, 1, 5, 5]))
    states, _ = motion(body, at_rest(body), np.zeros((2, 3)), np.array([2.0, 1e30, 1e30, 9.81, 1025.0]), step=0.01, every=30000)
    assert 2.0 + states[-1, 2] == pytest.approx((1 / 1.2 - 0.5) * REMUS.height, abs=1e-9)


def test_the_surface_curves_away() -> None:
    """Depth of a point on the tangent plane 5 km off: minus its height over the ellipsoid (pymap3d), to a millimetre."""
    pymap3d = pytest.importorskip("pymap3d")
    site = site_at(0.7)
    for north, east in ((5000.0, 0.0), (0.0, 5000.0), (-3000.0, 4000.0)):
        _, _, height = pymap3d.enu2geodetic(east, north, 0.0, np.degrees(0.7), 10.0, 0.0)
        assert dynamics.depth_of(north, east, 0.0, site) == pytest.approx(-height, abs=2e-3)


def test_an_actuator_follows_with_its_lag_and_limits() -> None:
    """Closed forms: 1 - exp(-t / tau) for a small step; a ramp at the greatest rate, then the stop, for a large one."""
    main = replace(REMUS.thrusters[0], lag=0.5, dead_band=1.0)
    body = replace(REMUS, thrusters=(main,))
    commands = np.tile([10.0, 0.01, 3.0], (101, 1))
    states, _ = motion(body, at_rest(body), commands, FLAT, step=0.005, every=2)
    time = np.arange(101) * 0.01
    np.testing.assert_allclose(states[:, 13], 10 * (1 - np.exp(-time / 0.5)), rtol=0, atol=1e-8)
    np.testing.assert_allclose(states[:, 14], 0.01 * (1 - np.exp(-time / 0.1)), rtol=0, atol=1e-8)
    ramp = time < 0.39  # until (target - value) / lag falls below the rate
    np.testing.assert_allclose(states[ramp, 15], 0.7 * time[ramp], rtol=0, atol=1e-12)
    assert states[-1, 15] <= np.pi / 9
    quiet, _ = motion(body, at_rest(body), np.tile([0.9, 0, 0], (3, 1)), FLAT, every=50)
    assert np.all(quiet[:, 13] == 0)


def test_commands_must_fit_the_hull() -> None:
    with pytest.raises(InputError, match=r"commands have the shape \(4, 2\)"):
        motion(REMUS, at_rest(REMUS), np.zeros((4, 2)), FLAT)
    with pytest.raises(InputError, match=r"an array of the shape \(13,\); \(16,\)"):
        motion(REMUS, np.zeros(13), np.zeros((4, 3)), FLAT)


def test_rates_at_knots_are_the_derivatives() -> None:
    commands = np.tile([20.0, 0.1, -0.05], (5, 1))
    states, rates = motion(REMUS, at_rest(REMUS), commands, FLAT, SEA, time=3.0, every=10)
    for k in range(5):
        found = accelerations(3.0 + 0.2 * k, states[k], commands[k], REMUS, FLAT, SEA)
        np.testing.assert_allclose(rates[k, 7:13], found, rtol=0, atol=1e-14)


# --- What is published.


def prestero(time: float, y: Array, thrust: float, torque: float, rudder: float, stern: float) -> Array:
    """The equations of motion of Prestero (2001, chapter 4), every coefficient as he lists it; y: u v w p q r, x y z, phi theta psi.

    Three departures, named beside hulls/remus-100.toml: Y_v|v| as Z_w|w|, M_rp and N_pq from his own added masses (he rounds 4.81 to
    4.86), weight and buoyancy of the hull file.
    """
    u, v, w, p, q, r = y[:6]
    phi, theta, psi = y[9:12]
    m, zg, weight, buoyancy = 30.48, 0.0196, 30.48 * 9.81, 0.029922 * 1025.0 * 9.81
    ixx, iyy, izz = 0.177, 3.45, 3.45
    net = weight - buoyancy
    surge = -net * np.sin(theta) - 1.62 * u * abs(u) + (-35.5 - m) * w * q - 1.93 * q * q + (35.5 + m) * v * r - 1.93 * r * r
    surge += -m * zg * p * r + thrust
    sway = net * np.cos(theta) * np.sin(phi) - 131 * v * abs(v) + 0.632 * r * abs(r) - 28.6 * u * v + (35.5 + m) * w * p
    sway += (5.22 - m) * u * r - m * zg * q * r + 1.93 * p * q + 9.64 * u * u * rudder
    heave = net * np.cos(theta) * np.cos(phi) - 131 * w * abs(w) - 0.632 * q * abs(q) - 28.6 * u * w + (-5.22 + m) * u * q
    heave += (-35.5 - m) * v * p + m * zg * (p * p + q * q) + 1.93 * r * p - 9.64 * u * u * stern
    roll = -zg * weight * np.cos(theta) * np.sin(phi) - 0.13 * p * abs(p) - (izz - iyy) * q * r - m * zg * (w * p - u * r) + torque
    pitch = -zg * weight * np.sin(theta) + 3.18 * w * abs(w) - 188 * q * abs(q) - 2.0 * u * q - 1.93 * v * p
    pitch += (4.88 - 0.0704 - (ixx - izz)) * r * p + m * zg * (v * r - w * q) + 24.0 * u * w - 6.15 * u * u * stern
    yaw = -3.18 * v * abs(v) - 94 * r * abs(r) - 2.0 * u * r - 1.93 * w * p + (-4.88 + 0.0704 - (iyy - ixx)) * p * q
    yaw += -24.0 * u * v - 6.15 * u * u * rudder
    mass = np.array(
        [
            [m + 0.93, 0, 0, 0, m * zg, 0],
            [0, m + 35.5, 0, -m * zg, 0, -1.93],
            [0, 0, m + 35.5, 0, 1.93, 0],
            [0, -m * zg, 0, ixx + 0.0704, 0, 0],
            [m * zg, 0, 1.93, 0, iyy + 4.88, 0],
            [0, -1.93, 0, 0, 0, izz + 4.88],
        ]
    )
    velocity = Rotation.from_euler("ZYX", [psi, theta, phi]).apply([u, v, w])
    angles = [p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)), q * np.cos(phi) - r * np.sin(phi)]
    turn = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
    return np.r_[np.linalg.solve(mass, [surge, sway, heave, roll, pitch, yaw]), velocity, angles, turn]


def remus_run(rudder: float, stern: float, span: float) -> tuple[Array, Array]:
    """Our run and Prestero's from 1.54 m/s with both fins there at once; the propeller gives what it gives him at any speed."""
    steady = replace(REMUS.thrusters[0], ahead=3.86 / 625.0, decay=0.0)
    body = replace(REMUS, thrusters=(steady,))
    x = at_rest(body, nu=np.array([1.54, 0, 0, 0, 0, 0]))
    x[13:] = command = np.array([25.0, rudder, stern])
    ours, _ = motion(body, x, np.tile(command, (round(span / 0.1) + 1, 1)), FLAT, step=0.01, every=10)
    torque = body.thrusters[0].torque * 625.0
    start = np.r_[1.54, np.zeros(11)]
    time = np.arange(len(ours)) * 0.1
    his = solve_ivp(prestero, (0, span), start, "DOP853", time, args=(3.86, torque, rudder, stern), rtol=1e-11, atol=1e-11)
    return ours, his.y.T


@pytest.mark.parametrize(("rudder", "stern"), [(0.0, 0.0), (0.07, 0.0), (0.0, 0.07), (-0.2, 0.05)])
def test_remus_moves_as_in_the_equations_of_prestero(rudder: float, stern: float) -> None:
    """Straight, turning, a step of the stern planes, both: 20 s.  Nothing is shared but the numbers.

    Added-mass cross terms and the Munk moment are written out in his list and follow from the added mass here.  What is left is the moment
    of a fin, 9.64 times 0.638 for 6.15: 5e-5 of it, so less than 5e-5 of the way of 31 m and of the rates.
    """
    ours, his = remus_run(rudder, stern, 20.0)
    assert np.abs(ours[:, :3] - his[:, 6:9]).max() < 5e-5 * 31
    np.testing.assert_allclose(ours[:, 7:13], his[:, :6], rtol=0, atol=5e-5)


def test_remus_goes_as_fast_as_published() -> None:
    """1.54 m/s at 1500 rpm, from 3.86 N against 1.62 u^2 (Prestero, 2001), to his three digits; at most 2.5 m/s (MSS toolbox), to 5 %."""
    assert straight(REMUS, 25.0 / REMUS.thrusters[0].most)[3] == pytest.approx(1.54, rel=5e-3)
    assert straight(REMUS, 1.0)[3] == pytest.approx(2.5, rel=0.05)


def test_the_roll_of_remus_under_its_propeller() -> None:
    """sin(roll) = torque / (W z_g): 0.543 N m at 1500 rpm, 299 N, 0.0196 m (Prestero, 2001) give -5.3 degrees; to his three digits."""
    x = at_rest(neutral(REMUS))
    x[13] = 25.0

    def moment(roll: float) -> float:
        x[3:7] = Rotation.from_euler("x", roll).as_quat(scalar_first=True)
        found = accelerations(0.0, x, np.array([25.0, 0, 0]), neutral(REMUS), FLAT)
        return float(((REMUS.rigid_mass + REMUS.added_mass) @ found)[3])

    assert brentq(moment, -0.3, 0.3) == pytest.approx(-np.arcsin(0.543 / (299 * 0.0196)), rel=5e-3)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("remus-100", 2.4, 2.6), ("typhoon", 3.0, 3.3), ("medusa", 1.0, 2.0), ("rexrov", 1.5, 3.0), ("yellowfin", 1.0, 2.0)],
    ids=lambda value: str(value),
)
def test_a_hull_reaches_the_speed_of_its_kind(name: str, least: float, most: float) -> None:
    """REMUS 2.5 m/s, Typhoon 6 kn = 3.09 m/s (Allotta et al.); the others around a speed at which such vehicles work."""
    assert least < straight(read_hull(name), 1.0)[3] < most


def test_typhoon_rights_itself() -> None:
    """Its roll, which nothing drives, dies out from half a right angle."""
    hull = neutral(read_hull("typhoon"))
    q = Rotation.from_euler("x", 0.8).as_quat(scalar_first=True)
    states, _ = motion(hull, at_rest(hull, quaternion_tb=q), np.zeros((2, 6)), FLAT, every=6000)
    assert abs(Rotation.from_quat(states[-1, 3:7], scalar_first=True).as_euler("ZYX")[2]) < 1e-3
