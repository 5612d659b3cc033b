"""The process model `dynamics`: its equation against dense matrices and energy, its motion against scipy and a voyage, its derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, logm

from leadline.core import attitude, geodesy
from leadline.core.compiled import WIDE
from leadline.core.earth import offset
from leadline.data.errors import InputError
from leadline.data.hull import Hull, hulls, read_hull
from leadline.data.records import Thruster
from leadline.data.vehicle import Vehicle, vehicle_from_toml
from leadline.models import cruise, driven, dynamics
from leadline.models.hull_motion import SLOPE, acceleration, slopes
from leadline.models.layout import INPUTS, Layout, difference, retract
from leadline.models.process import Pose, Process
from leadline.models.sensor import Context
from leadline.models.view import TANGENT, VELOCITY_T, VIEW_SIZE, WATER_T
from leadline.sea.water import Water
from leadline.simulate.routes import Plan, Spiral
from leadline.simulate.trajectory import Place, Trajectory
from leadline.simulate.voyage import TICK, Voyage

STATES = """
[water]
current = { value_mps = [0.1, -0.2], sigma_mps = 0.3, tau_s = 900.0 }
[process.dynamics.nuisance]
drag = { value_percent = 10.0, sigma_percent = 20.0 }
thrust = { sigma_percent = 5.0, walk_percent_per_rts = 0.1 }
buoyancy = { value_n = 1.0, sigma_n = 3.0 }
"""


def vehicle(hull: str, more: str = "") -> Vehicle:
    return vehicle_from_toml(f"""
        name = "driven"
        [process]
        model = "dynamics"
        [process.dynamics]
        hull = "{hull}"
        [sensors.thrusters]
        kind = "thruster"
        {more}
    """)


def composed(hull: str, more: str = "", surface: float = 0.0) -> Process:
    found = vehicle(hull, more)
    return dynamics.compose(found, Context(surface=surface, shared=found.shared))


def skew(a: np.ndarray) -> np.ndarray:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def dense(hull: Hull, nu: np.ndarray, rotation: np.ndarray, act: np.ndarray, g: float, water: float = 1025.0) -> np.ndarray:
    """Fossen's equation with full matrices, of the hull's own values and not of its flat array: nu'."""
    force = np.zeros(6)
    for thruster, n in zip(hull.thrusters, act, strict=False):
        map_b = np.concatenate([thruster.direction_b, np.cross(thruster.position_b, thruster.direction_b)])
        gain = thruster.ahead if n > 0 else thruster.astern
        force += map_b * (gain * n * abs(n) - thruster.decay * abs(n) * (map_b @ nu))
        force[3:] += thruster.torque * n * abs(n) * thruster.direction_b
    for fin, angle in zip(hull.fins, act[len(hull.thrusters) :], strict=True):
        inflow = (nu[:3] + np.cross(nu[3:], fin.position_b))[0]
        lift = fin.lift * inflow * abs(inflow) * angle * fin.axis_b
        force += np.concatenate([lift, np.cross(fin.position_b, lift)])
    for term in hull.terms:
        first = abs(nu[term.first]) if term.bare else nu[term.first]
        force[term.force] += term.coefficient * first * nu[term.second]
    down = rotation.T @ [0.0, 0.0, 1.0]
    for weight, at in ((hull.mass * g, hull.gravity_centre_b), (-water * hull.volume * g, hull.buoyancy_centre_b)):
        force += weight * np.concatenate([down, np.cross(at, down)])
    mass = hull.rigid_mass + hull.added_mass
    upper, lower = mass[:3] @ nu, mass[3:] @ nu
    coriolis = np.block([[np.zeros((3, 3)), -skew(upper)], [-skew(upper), -skew(lower)]])
    damping = hull.linear_damping + np.diag(hull.quadratic_damping * np.abs(nu))
    return np.linalg.solve(mass, force - coriolis @ nu - damping @ nu)


def actuated(hull: Hull, generator: np.random.Generator) -> np.ndarray:
    return np.concatenate([generator.uniform(-15, 15, len(hull.thrusters)), generator.uniform(-0.3, 0.3, len(hull.fins))])


def inputs(act: np.ndarray) -> np.ndarray:
    u = np.zeros(INPUTS)
    u[: len(act)] = act
    return u


@pytest.mark.parametrize("name", hulls())
def test_acceleration_is_that_of_full_matrices(name: str) -> None:
    hull, generator, g = read_hull(name), np.random.default_rng(1), 9.81
    for _ in range(20):
        nu = np.array([1.0, 0, 0, 0, 0, 0]) + generator.normal(0.0, 0.7, 6)
        rotation = attitude.matrix_from_euler(*generator.uniform(-1.4, 1.4, 3))
        act, out = actuated(hull, generator), np.zeros(8)
        down = tuple(rotation.T @ [0.0, 0.0, 1.0])
        acceleration(tuple(nu), down, inputs(act), hull.parameters, 1.0, 1.0, hull.mass * g, 1025.0 * hull.volume * g, 0.0, out, 2)
        expected = dense(hull, nu, rotation, act, g)
        np.testing.assert_allclose(out[2:], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", hulls())
def test_slopes_are_derivatives(name: str) -> None:
    """Central differences over 1e-5: products of two velocities have no third derivative, so rounding (1e-11 of the forces) is left."""
    hull, generator, weight = read_hull(name), np.random.default_rng(2), 300.0
    for _ in range(20):
        u = inputs(actuated(hull, generator))
        down = attitude.matrix_from_euler(*generator.uniform(-1.4, 1.4, 3))[2]
        at = np.concatenate([generator.normal(0.0, 0.7, 6), down, [1.1, 0.9, 305.0, 20.0]])

        def value(z: np.ndarray, u: np.ndarray = u) -> np.ndarray:
            out = np.zeros(6)
            acceleration(tuple(z[:6]), tuple(z[6:9]), u, hull.parameters, z[9], z[10], weight, z[11], z[12], out, 0)
            return out

        out = np.zeros(6 * SLOPE)
        slopes(tuple(at[:6]), tuple(at[6:9]), u, hull.parameters, at[9], at[10], weight, at[11], at[12], out, 0)
        numeric = np.stack([(value(at + e) - value(at - e)) / 2e-5 for e in 1e-5 * np.eye(SLOPE)], axis=1)
        np.testing.assert_allclose(out.reshape(6, SLOPE), numeric, rtol=0, atol=1e-9 * np.abs(numeric).max())


# --- motion ------------------------------------------------------------------------------------------------------------------------


def start(process: Process, nu: np.ndarray, quaternion: np.ndarray, latitude: float = 0.7, wander: float = 0.0, height: float = -100.0):
    """Return a nominal state, its values at their means."""
    place = attitude.quaternion_from_matrix(geodesy.rotation_en(latitude, 0.2))
    place = attitude.product(place, attitude.quaternion_from_euler(0.0, 0.0, wander))
    pose = Pose(place, height, np.zeros(3), quaternion, nu[3:], np.zeros((9, 9)))
    x, _ = process.begin(pose)
    x[dynamics.V : dynamics.V + 3] = nu[:3]
    return x


def moved(process: Process, x: np.ndarray, u: np.ndarray, dt: float, count: int) -> np.ndarray:
    x, m = x.copy(), np.zeros(WIDE * WIDE)
    for _ in range(count):
        process.step(x, u, dt, process.parameters, m)
    return x


def by_scipy(hull: Hull, nu: np.ndarray, quaternion: np.ndarray, act: np.ndarray, g: float, duration: float):
    """Return nu, rotation and the way travelled, of the dense equation by an integrator of eighth order."""

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        rotation = y[6:15].reshape(3, 3)
        return np.concatenate([dense(hull, y[:6], rotation, act, g), (rotation @ skew(y[3:6])).ravel(), rotation @ y[:3]])

    y0 = np.concatenate([nu, attitude.matrix_from_quaternion(quaternion).ravel(), np.zeros(3)])
    y = solve_ivp(slope, (0.0, duration), y0, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    return y[:6], y[6:15].reshape(3, 3), y[15:18]


def under_way(hull: Hull) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a start in the middle of a turn and a dive, and actuators."""
    nu = np.array([1.0, 0.05, 0.1, 0.1, 0.05, -0.1])
    act = np.concatenate([[12.0, 10.0, 3.0, -4.0, 2.0, 5.0, 1.0, -2.0][: len(hull.thrusters)], [0.05, -0.08][: len(hull.fins)]])
    return nu, attitude.quaternion_from_euler(0.2, -0.4, 1.0), act


@pytest.mark.parametrize("name", hulls())
def test_motion_is_that_of_scipy_to_second_order(name: str) -> None:
    """Halving the step quarters the error, of velocity, attitude and place; g within 1e-8 over the way, so 1e-6 m are below the first."""
    hull, process = read_hull(name), composed(name)
    nu, quaternion, act = under_way(hull)
    x0 = start(process, nu, quaternion)
    g = gravity_at(x0)
    expected = by_scipy(hull, nu, quaternion, act, g, 2.0)
    errors = []
    for count in (100, 200, 400):
        x = moved(process, x0, inputs(act), 2.0 / count, count)
        turned = attitude.matrix_from_quaternion(x[8:12]) @ expected[1].T
        way = np.array(offset(x, 0, x0, 0)) - expected[2]
        errors.append([np.abs(x[[5, 6, 7, 12, 13, 14]] - expected[0]).max(), np.abs(turned - np.eye(3)).max(), np.abs(way).max()])
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 3.0) & (ratios < 5.5)), (errors, ratios)


def gravity_at(x: np.ndarray) -> float:
    from leadline.core.earth import gravity, third_row

    return float(gravity(third_row(*x[:4]), x[4], 0.0))


def test_energy_does_not_grow_without_thrust() -> None:
    """Kinetic energy of hull and water, and of weight and buoyancy: falls with damping alone, and stays without it.

    The hull's products of two velocities are left out: a coefficient of lift may feed one motion from another.  What stays does so to the
    second order of the step: a quarter of the loss at half of it.
    """
    lost = []
    for damped, dt in ((True, 0.01), (False, 0.01), (False, 0.005)):
        hull = replace(read_hull("typhoon"), terms=())
        if not damped:
            hull = replace(hull, linear_damping=np.zeros((6, 6)), quadratic_damping=np.zeros(6))
        process = composed("typhoon")
        parameters = np.concatenate([process.parameters[: driven.HULL], hull.parameters])
        process = replace(process, parameters=parameters)
        x = start(process, np.array([1.0, 0.3, -0.2, 0.4, 0.2, -0.3]), attitude.quaternion_from_euler(0.6, 0.5, 0.0))
        g, mass, energies = gravity_at(x), hull.rigid_mass + hull.added_mass, []
        for _ in range(round(10.0 / dt)):
            nu, rotation = x[[5, 6, 7, 12, 13, 14]], attitude.matrix_from_quaternion(x[8:12])
            weight, lift = hull.mass * g, 1025.0 * hull.volume * g
            height = x[4] - np.array([(rotation @ c)[2] for c in (hull.gravity_centre_b, hull.buoyancy_centre_b)])
            energies.append(0.5 * nu @ mass @ nu + weight * height[0] - lift * height[1])
            x = moved(process, x, np.zeros(INPUTS), dt, 1)
        if damped:
            assert np.diff(energies).max() < 0.0
        else:
            lost.append(np.abs(np.array(energies) - energies[0]).max())
    assert lost[0] < 3e-4 * energies[0]
    assert lost[0] / lost[1] > 3.0


def of_truth(process: Process, trajectory: Trajectory, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the state that truth has at a time, and the place (5,) alone."""
    there = trajectory.at([time])
    latitude, longitude, height = (float(part[0]) for part in there.geodetic)
    turn = geodesy.rotation_en(latitude, longitude)
    back = turn.T @ trajectory.place.rotation_et
    quaternion = attitude.quaternion_from_matrix(back @ there.rotation_tb[0])
    velocity, place = back @ there.velocity_t[0], attitude.quaternion_from_matrix(turn)
    x, _ = process.begin(Pose(place, height, velocity, quaternion, there.rate_eb_b[0], np.zeros((9, 9))))
    return x, x[:5].copy()


@pytest.mark.parametrize(("name", "speed"), [("remus-100", 1.5), ("typhoon", 0.6)])
def test_a_voyage_is_repeated_from_its_actuators(name: str, speed: float) -> None:
    """A minute of a spiral in a current, with the actuators of truth: each second anew from truth, and for Typhoon in one go.

    Actuators are known ten times a second and follow their lags in between, which is exact unless they slew as fast as they can: seconds
    in which a fin does are left out.  The acceleration of truth, a curve through its knots, agrees with the hull's equation to 1e-5
    (m/s^2), and in roll to 1e-4 (rad/s^2): so do velocity and rate after a second.  Without a pilot a REMUS is not stable in pitch at
    this speed, and its errors grow tenfold in seconds; Typhoon's do not, and 1e-5 m/s for 60 s are 6e-4 m.
    """
    place = Place(radians(44.0), radians(9.8), water=Water(shear=((0.0, 0.15, -0.1),)))
    plan = Plan((Spiral(radius=20.0, turns=3.0, depth=8.0, end_depth=20.0, speed=speed),))
    hull = read_hull(name)
    voyage = Voyage(hull, plan, place, depth=8.0, speed=speed, limit=180.0)
    trajectory = voyage.run()
    times, acted = voyage.actuators()
    lags = np.array([part.lag for part in (*hull.thrusters, *hull.fins)])
    process = composed(name, "[water]\ncurrent = { value_mps = [0.15, -0.1], sigma_mps = 0.1, estimate = false }")
    m, steps = np.zeros(WIDE * WIDE), 8
    once, _ = of_truth(process, trajectory, 60.0)
    begun, worst, whole = once[:5].copy(), np.zeros(2), 0
    for second in range(60):
        x, _ = of_truth(process, trajectory, 60.0 + second)
        for k in range(10 * steps):
            i = int(np.searchsorted(times, 60.0 + second + 1e-6)) - 1 + k // steps
            on = np.expm1(-(k % steps + 0.5) / steps * TICK / lags) / np.expm1(-TICK / lags)
            u = inputs(acted[i] + on * (acted[i + 1] - acted[i]))
            process.step(x, u, TICK / steps, process.parameters, m)
            process.step(once, u, TICK / steps, process.parameters, m)
        true, _ = of_truth(process, trajectory, 61.0 + second)
        jumps = np.abs(np.diff(acted[i - 9 : i + 2], axis=0)).max(axis=0)[len(hull.thrusters) :]
        if np.all(jumps < [fin.quickest * fin.lag * -np.expm1(-TICK / fin.lag) for fin in hull.fins]):
            worst, whole = np.maximum(worst, [np.abs(x - true)[5:8].max(), np.abs(x - true)[12:15].max()]), whole + 1
    assert whole > 8
    assert worst[0] < 1e-5
    assert worst[1] < 1e-4
    if name == "typhoon":
        missed = np.array(offset(once, 0, begun, 0)) - offset(true, 0, begun, 0)
        assert np.abs(missed).max() < 6e-4


# --- derivatives -------------------------------------------------------------------------------------------------------------------


def anywhere(process: Process, generator: np.random.Generator) -> np.ndarray:
    """Return a state pitched up to 80 degrees, up to 89.9 degrees of latitude, with wandering azimuth."""
    latitude = generator.choice([generator.uniform(-1.4, 1.4), radians(89.9)])
    quaternion = attitude.quaternion_from_euler(*(generator.uniform(-1, 1, 3) * (np.pi, radians(80.0), np.pi)))
    nu = np.array([0.8, 0, 0, 0, 0, 0]) + generator.normal(0.0, 0.5, 6)
    return start(process, nu, quaternion, latitude, generator.uniform(-np.pi, np.pi))


STEPS = np.concatenate([np.repeat([0.3, 1e-3, 1e-3, 1e-3], 3), [1e-2, 1e-2, 1e-2, 1e-2, 0.1]])  # places are rounded to 1e-9 m


def push_against_differences(process: Process, x: np.ndarray, u: np.ndarray, dt: float, steps: np.ndarray) -> float:
    """Return the largest difference between a transition and central differences of `step`, as a share of its column's largest.

    Steps of three `steps` for the level place, whose rounding is 1e-9 m, of a tenth for all else, whose forces have kinks where a velocity
    changes its sign.
    """
    n = len(steps)
    plan = Layout(process.parts, (), 0, 1).head()

    def after(d: np.ndarray) -> np.ndarray:
        y = x.copy()
        retract(plan, y, d, n)
        process.step(y, u, dt, process.parameters, np.zeros(WIDE * WIDE))
        return y

    def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        d = np.zeros(n)
        difference(plan, a, b, d)
        return d

    here, columns = after(np.zeros(n)), []
    for j in range(n):
        both = [(apart(after(d), here) - apart(after(-d), here)) / (2 * d[j]) for d in np.eye(n)[j] * steps[j] * np.array([[3.0], [0.1]])]
        columns.append(np.concatenate([both[0][:2], both[1][2:]]))
    numeric, phi = np.stack(columns, axis=1), transition(process, x, u, dt, n)
    return float((np.abs(phi - numeric) / np.abs(numeric).max(axis=0)).max())


def transition(process: Process, x: np.ndarray, u: np.ndarray, dt: float, n: int) -> np.ndarray:
    y, m, B, A = x.copy(), np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
    B.reshape(WIDE, WIDE)[:] = np.eye(WIDE)
    process.step(y, u, dt, process.parameters, m)
    process.push(m, dt, process.parameters, B, A, n)
    return A.reshape(WIDE, WIDE)[:n, :n]


@pytest.mark.parametrize("name", hulls())
def test_push_is_the_derivative_of_step(name: str) -> None:
    process, generator = composed(name, STATES), np.random.default_rng(3)
    for _ in range(10):
        x, u = anywhere(process, generator), inputs(actuated(read_hull(name), generator))
        assert push_against_differences(process, x, u, process.longest_step, STEPS) < 1e-6


@pytest.mark.parametrize("name", hulls())
def test_push_is_the_derivative_of_step_afloat(name: str) -> None:
    """A quarter of the hull's height above where it is immersed, and so level that no strip of it dips or emerges whole."""
    process, hull, generator = composed(name, STATES), read_hull(name), np.random.default_rng(10)
    steps = STEPS.copy()
    steps[2] = 1e-3
    for _ in range(10):
        roll, pitch, heading = generator.uniform(-1.0, 1.0, 3) * [0.1, 0.1 * hull.height / hull.length, np.pi]
        nu = np.array([0.8, 0.2, 0.2, 0.2, 0.2, 0.2]) + generator.normal(0.0, 0.02, 6)  # none near zero, where drag has a kink
        quaternion = attitude.quaternion_from_euler(roll, pitch, heading)
        centre = (attitude.matrix_from_quaternion(quaternion) @ hull.buoyancy_centre_b)[2]
        x = start(process, nu, quaternion, 0.7, heading, centre - 0.25 * hull.height)
        state = driven.afloat(tuple(attitude.matrix_from_quaternion(quaternion).ravel()), x[4], process.parameters, 9.8, 1.0)
        assert state[5] == pytest.approx((1025.0 * hull.volume * 9.8 + 1.0) / hull.height)
        assert push_against_differences(process, x, inputs(actuated(hull, generator)), process.longest_step, steps) < 1e-6


def test_push_leaves_what_it_pushes_and_what_lies_beyond() -> None:
    process, generator = composed("typhoon", STATES), np.random.default_rng(4)
    x, m = anywhere(process, generator), np.zeros(WIDE * WIDE)
    process.step(x, np.zeros(INPUTS), 0.05, process.parameters, m)
    B = generator.normal(size=WIDE * WIDE)
    A, before = np.full(WIDE * WIDE, 7.0), B.copy()
    process.push(m, 0.05, process.parameters, B, A, 20)
    assert np.array_equal(B, before)
    assert np.all(A.reshape(WIDE, WIDE)[17:] == 7.0)
    assert np.all(A.reshape(WIDE, WIDE)[:, 20:] == 7.0)


def pull_against_differences(process: Process, x: np.ndarray, steps: np.ndarray) -> float:
    """Return the largest difference between `pull` and central differences of `view`; what lies beyond the motion is not touched."""
    n, u = len(steps), np.zeros(INPUTS)
    plan = Layout(process.parts, (), 0, 1).head()

    def seen(d: np.ndarray) -> np.ndarray:
        y, out = x.copy(), np.zeros(VIEW_SIZE)
        retract(plan, y, d, n)
        process.view(y, u, process.parameters, out)
        return out

    here = seen(np.zeros(n))

    def apart(a: np.ndarray) -> np.ndarray:
        turned = attitude.logarithm(attitude.product(a[8:12], attitude.conjugate(here[8:12])))
        return np.concatenate([offset(a, 0, here, 0), a[5:8] - here[5:8], turned, a[12:21] - here[12:21]])

    numeric = np.stack([(apart(seen(e * s)) - apart(seen(-e * s))) / (2 * s) for e, s in zip(np.eye(n), steps, strict=True)], axis=1)
    Hv, H = np.eye(TANGENT), np.full((TANGENT, WIDE), np.nan)
    process.pull(x, u, process.parameters, here, Hv, H, TANGENT)
    assert np.all(np.isnan(H[:, n:]))
    return float(np.abs(H[:, :n] - numeric).max())


def test_pull_is_the_derivative_of_view() -> None:
    process, generator = composed("remus-100", STATES), np.random.default_rng(5)
    for _ in range(20):
        assert pull_against_differences(process, anywhere(process, generator), STEPS) < 1e-6


def test_noise_is_that_of_white_accelerations() -> None:
    """Against Van Loan's integral, with F of the transition itself; Simpson's rule with half a step taken as the mean of none and a whole
    one misses (F dt)^2 / 8 of what grows in the step: of the variances that are driven a share below |F dt|^2."""
    process, generator, dt, n = composed("remus-100", STATES), np.random.default_rng(6), 0.02, 17
    x, m = anywhere(process, generator), np.zeros(WIDE * WIDE)
    process.step(x, inputs(np.array([10.0, 0.1, 0.1])), dt, process.parameters, m)
    B, A, P = np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
    B.reshape(WIDE, WIDE)[:] = np.eye(WIDE)
    process.push(m, dt, process.parameters, B, A, n)
    process.noise(m, dt, process.parameters, P)
    F = np.real(logm(A.reshape(WIDE, WIDE)[:n, :n])) / dt
    drive = np.zeros(n)
    drive[[3, 4, 5]] = np.square([0.005, 0.01, 0.01])
    drive[[9, 10, 11]] = np.square(np.radians([1.0, 0.5, 0.5]))
    drive[[12, 13, 15]] = 2 * 0.3**2 / 900.0, 2 * 0.3**2 / 900.0, 1e-3**2
    whole = expm(np.block([[-F, np.diag(drive)], [np.zeros((n, n)), F.T]]) * dt)
    expected = whole[n:, n:].T @ whole[:n, n:]
    Q = P.reshape(WIDE, WIDE)[:n, :n]
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) + 1e-300
    assert np.abs(Q - Q.T).max() == 0.0
    assert np.linalg.eigvalsh(Q)[0] > -1e-20
    fast = np.abs(np.linalg.eigvals(F[3:12, 3:12])).max() * dt
    assert fast < 1.0
    assert (np.abs(Q - expected) / scale).max() < fast**2


# --- start, input, water -----------------------------------------------------------------------------------------------------------


def test_begin_knows_the_way_over_ground() -> None:
    """What the view sees at the start is as certain as the pose; an error of the current is one of the way through the water."""
    process, generator = composed("typhoon", STATES), np.random.default_rng(8)
    root = generator.normal(size=(9, 9))
    place = attitude.product(attitude.quaternion_from_matrix(geodesy.rotation_en(0.7, 0.2)), attitude.quaternion_from_euler(0, 0, 0.8))
    pose = Pose(place, -20.0, np.array([0.5, 0.4, 0.1]), attitude.quaternion_from_euler(0.1, 0.5, 2.0), np.zeros(3), root @ root.T)
    x, P = process.begin(pose)
    out, H = np.zeros(VIEW_SIZE), np.zeros((TANGENT, WIDE))
    process.view(x, np.zeros(INPUTS), process.parameters, out)
    np.testing.assert_allclose(out[5:8], pose.velocity_n, atol=1e-15)
    north, east = np.array([np.cos(0.8), -np.sin(0.8), 0.0]), np.array([np.sin(0.8), np.cos(0.8), 0.0])
    np.testing.assert_allclose(out[18:21], pose.velocity_n - 0.1 * north + 0.2 * east, atol=1e-15)
    process.pull(x, np.zeros(INPUTS), process.parameters, out, np.eye(TANGENT), H, TANGENT)
    H[VELOCITY_T : VELOCITY_T + 2, :2] = H[WATER_T : WATER_T + 2, :2] = 0.0  # north turns with the place by 1e-7 rad/m
    seen = H[:, : len(P)] @ P @ H[:, : len(P)].T
    np.testing.assert_allclose(seen[:9, :9], pose.covariance, atol=1e-13)
    slope = -np.stack([north, east], axis=1)
    np.testing.assert_allclose((H[:, : len(P)] @ P)[WATER_T : WATER_T + 3, 12:14], slope * 0.3**2, atol=1e-15)
    np.testing.assert_allclose(np.sqrt(np.diag(P))[14:], [0.2, 0.05, 3.0])
    np.testing.assert_allclose(x[15:], [0.1, -0.2, 0.1, 0.0, 1.0])


def test_a_current_that_is_not_estimated_is_a_constant() -> None:
    process = composed("typhoon", "[water]\ncurrent = { value_mps = [0.1, -0.2], sigma_mps = 0.3, estimate = false }")
    assert [part.name for part in process.parts] == ["position", "velocity_water", "attitude", "rate"]
    x, out = start(process, np.zeros(6), np.array([1.0, 0.0, 0.0, 0.0])), np.zeros(VIEW_SIZE)
    process.view(x, np.zeros(INPUTS), process.parameters, out)
    np.testing.assert_allclose(out[5:8], [0.1, -0.2, 0.0], atol=1e-15)


def test_rows_of_thrusters_are_input() -> None:
    (feed,) = composed("remus-100").feeds
    table = Thruster(
        time=np.arange(3.0), thruster=np.array([[1.0], [2.0], [np.nan]]), rudder=np.full(3, 0.1), stern=np.array([0.2, np.nan, 0.3])
    )
    rows = feed.rows(table)
    assert feed.sensor == "thrusters"
    np.testing.assert_array_equal(rows[:, :3], [[1.0, 0.1, 0.2], [2.0, 0.1, np.nan], [np.nan, 0.1, 0.3]])
    assert np.all(np.isnan(rows[:, 3:]))
    assert rows.shape == (3, INPUTS)


def test_rows_that_are_not_of_the_hull_are_refused() -> None:
    (feed,) = composed("remus-100").feeds
    with pytest.raises(InputError, match="has 2 thrusters, and the hull 'REMUS 100' has 1"):
        feed.rows(Thruster(time=np.arange(1.0), thruster=np.zeros((1, 2))))
    with pytest.raises(InputError, match="has no angle of the rudder"):
        feed.rows(Thruster(time=np.arange(1.0), thruster=np.zeros((1, 1))))


def test_a_vehicle_that_cannot_be_driven_is_refused() -> None:
    found = vehicle_from_toml("""
        name = "x"
        [process]
        model = "dynamics"
        [process.dynamics]
        hull = "typhoon"
        [sensors.thrusters]
        kind = "depth"
        sigma_m = 0.1
    """)
    with pytest.raises(InputError, match="'thrusters' is of kind depth"):
        dynamics.compose(found, Context())
    with pytest.raises(InputError, match="no-such"):
        composed("no-such")


def test_what_floats_stays_at_the_surface() -> None:
    """Without thrust a buoyant hull rises, and then lies where the lift is its weight; also from above it."""
    process, hull = composed("typhoon", surface=3.0), read_hull("typhoon")
    level = np.array([1.0, 0.0, 0.0, 0.0])
    for height in (-7.0, 4.0):
        x = moved(process, start(process, np.zeros(6), level, height=height), np.zeros(INPUTS), 0.05, 12000)
        assert x[4] == pytest.approx(3.0 - hull.height * (hull.mass / (1025.0 * hull.volume) - 0.5), abs=1e-5)
        assert abs(x[7]) < 1e-5


# --- cruise with a hull ------------------------------------------------------------------------------------------------------------

FLAT_STEPS = np.concatenate([np.full(3, 0.3), np.full(11, 1e-3)])


def flat(name: str, more: str = "") -> Process:
    found = vehicle_from_toml(f"""
        name = "driven"
        [process]
        model = "cruise"
        [process.cruise]
        hull = "{name}"
        [sensors.thrusters]
        kind = "thruster"
        {more}
    """)
    return cruise.compose(found, Context(shared=found.shared))


CURRENT = "[water]\ncurrent = { value_mps = [0.1, -0.2], sigma_mps = 0.3, tau_s = 900.0 }"


@pytest.mark.parametrize("name", hulls())
def test_driven_cruise_derivatives(name: str) -> None:
    """At pitches of up to 60 degrees, as `test_push_is_the_derivative_of_step`; a roll is forgotten, so it starts at zero."""
    process, generator = flat(name, CURRENT), np.random.default_rng(9)
    for _ in range(10):
        latitude = generator.choice([generator.uniform(-1.4, 1.4), radians(89.9)])
        place = attitude.quaternion_from_matrix(geodesy.rotation_en(latitude, 0.2))
        place = attitude.product(place, attitude.quaternion_from_euler(0.0, 0.0, generator.uniform(-np.pi, np.pi)))
        quaternion = attitude.quaternion_from_euler(0.0, generator.uniform(-1.0, 1.0), generator.uniform(-np.pi, np.pi))
        velocity = attitude.matrix_from_quaternion(quaternion) @ (np.array([0.8, 0.0, 0.0]) + generator.normal(0.0, 0.3, 3))
        x, _ = process.begin(Pose(place, -100.0, velocity, quaternion, generator.normal(0.0, 0.3, 3), np.zeros((9, 9))))
        x[12:14] = 0.0
        u = inputs(actuated(read_hull(name), generator))
        assert push_against_differences(process, x, u, process.longest_step, FLAT_STEPS) < 1e-6
        assert pull_against_differences(process, x, FLAT_STEPS) < 1e-6


def test_driven_cruise_is_dynamics_in_the_vertical() -> None:
    """A dive on a straight course, with a current along it: nothing rolls, so both models integrate one motion, to second order."""
    current = "[water]\ncurrent = { value_mps = [0.3, 0.0], sigma_mps = 0.3 }"
    models = composed("typhoon", current), flat("typhoon", current)
    quaternion, u = attitude.quaternion_from_euler(0.0, -0.1, 0.0), inputs(np.array([10.0, 10.0, 0.0, 0.0, 6.0, 6.0]))
    place = attitude.quaternion_from_matrix(geodesy.rotation_en(0.7, 0.2))
    apart = []
    for count in (400, 800):
        ends = []
        for process in models:
            x, _ = process.begin(Pose(place, -50.0, np.array([0.9, 0.0, 0.0]), quaternion, np.zeros(3), np.zeros((9, 9))))
            x = moved(process, x, u, 20.0 / count, count)
            out = np.zeros(VIEW_SIZE)
            process.view(x, u, process.parameters, out)
            ends.append(out)
        way = np.array(offset(ends[0], 0, ends[1], 0))
        apart.append(np.abs(np.concatenate([way, (ends[0] - ends[1])[5:21]])).max())
    assert ends[0][4] < -50.5  # it went down
    assert apart[0] < 1e-3
    assert apart[0] / apart[1] > 3.0
