"""A readable twin of the extended Kalman filter, in dense NumPy on its own models, and the dives on which both are run.

It shares with the package the stream of events and the configuration, and no formula: rotations are matrices, the Earth is taken
from latitude and radii, the transition is made of 3x3 blocks, the update is Joseph's.  What it follows is what models/inertial.py
states: which discrete algorithm, and which small derivatives are left out.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from math import atan2, cos, exp, isinf, pi, radians, sin, sqrt
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from leadline.data.log import Beacon, Log
from leadline.data.vehicle import Vehicle, vehicle_from_toml
from leadline.estimate.composition import Composition
from leadline.estimate.events import Events
from leadline.estimate.navigator import Navigator
from leadline.estimate.plan import IS_CLONE, IS_DROP, IS_INPUT, IS_OUTPUT
from leadline.estimate.solve import Stream, navigator_for, stream_of
from leadline.models.layout import Layout
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import AcousticRange, Attitude, Depth, Dvl, Gnss, Heading, Imu, PositionFix
from leadline.simulate.plans import Weave, circle
from leadline.simulate.trajectory import Place

A, E2, EARTH = 6378137.0, 0.00669437999014, np.array([0.0, 0.0, 7.292115e-5])
ROUGH = Weave((0.1, 6.1), (0.08, 7.3), (0.1, 9.0), (0.2, 11.0), (0.2, 5.0), (0.1, 4.0))
BEACONS = {
    "one": Beacon(north=550.0, east=-40.0, depth=30.0, turnaround=0.1),
    "two": Beacon(north=150.0, east=600.0, depth=32.0, turnaround=0.1),
}
LEVER = {"imu": (0.3, 0.1, -0.05), "dvl": (-0.5, 0.1, 0.2), "depth": (0.6, 0.0, -0.1), "usbl": (0.1, 0.0, -0.3), "ranges": (0.8, 0.1, -0.2)}
MOUNTING = (2.0, -3.0, 45.0)  # of the DVL, deg

NUISANCES = {  # per sensor, as the vehicle file has them
    "dvl": "scale = { sigma_percent = 0.5, walk_percent_per_rts = 0.001 }\nmounting = { sigma_deg = 0.5 }",
    "depth": "datum = { sigma_m = 0.1 }",
    "heading": "bias = { sigma_deg = 1.0, tau_s = 120.0, steady_deg = 0.7 }",
    "attitude": "bias = { sigma_deg = [0.3, 0.3, 1.0] }",
    "ranges": "bias = { sigma_m = 0.5 }",
}


def vehicle(*names: str, nuisances: tuple[str, ...] = (), more: str = "") -> Vehicle:
    """Return a vehicle with an IMU, the named sensors of `dive`, and nuisance states for some of them."""
    figures = {
        "dvl": f"sigma_mps = 0.01\nmounting_deg = {[*MOUNTING]}",
        "depth": "sigma_m = 0.02",
        "heading": "sigma_deg = 0.5",
        "attitude": "sigma_deg = 1.0\nsigma_tilt_deg = 0.5",
        "gnss": "sigma_m = 1.5",
        "usbl": 'kind = "position_fix"\nsigma_m = 1.5\nsigma_depth_m = 0.5',
        "ranges": 'kind = "acoustic_range"\nsigma_m = 0.3\nrange_max_m = 3000.0',
    }
    text = f"""
        name = "witness"
        [sensors.imu]
        rate_hz = 100.0
        gyro_noise_deg_per_rth = 0.1
        gyro_bias_deg_per_h = 10.0
        gyro_bias_instability_deg_per_h = 1.0
        accel_noise_ug_per_rthz = 100.0
        accel_bias_ug = 1000.0
        accel_bias_instability_ug = 50.0
        gap_accel_mps2_per_rthz = 1.0
        gap_rate_degps_per_rthz = 6.0
        lever_arm_m = {[*LEVER["imu"]]}
        """
    for name in names:
        text += f"\n[sensors.{name}]\nlever_arm_m = {[*LEVER.get(name, (0.0, 0.0, 0.0))]}\n{figures[name]}\n"
        if name in nuisances:
            text += f"[sensors.{name}.nuisance]\n{NUISANCES[name]}\n"
    return vehicle_from_toml(text + more)


def dive(
    duration: float, *, latitude: float = 32.84, rate: float = 100.0, gap: tuple[float, float] = (30.0, 30.6), pings: float = 2.0
) -> Log:
    """Return a rolling and pitching circle with all sensors, and without IMU rows inside `gap`; `pings` (Hz) of two-way ranges."""
    place = Place(radians(latitude), radians(179.9999), depth=15.0, surface_height=17.0)
    instruments: dict[str, Any] = {
        "imu": Imu(rate=rate, lever_arm_b=LEVER["imu"], gyro_density=3e-5, accel_density=1e-3),
        "dvl": Dvl(rate=5.0, offset=0.103, lever_arm_b=LEVER["dvl"], mounting_bs=tuple(np.radians(MOUNTING)), sigma=0.01, scale=0.004),
        "depth": Depth(rate=10.0, lever_arm_b=LEVER["depth"], sigma=0.02),
        "heading": Heading(rate=5.0, offset=0.05, sigma=0.01),
        "attitude": Attitude(rate=2.0, offset=0.207, sigma=(0.01, 0.01, 0.02)),
        "gnss": Gnss(rate=0.5, offset=3.0, sigma=(1.5, 1.5, 3.0)),
        "usbl": PositionFix(rate=0.2, offset=2.5, lever_arm_b=LEVER["usbl"], sigma=1.5, sigma_depth=0.5, outlier_fraction=0.2,
                            outlier_size=40.0),
        "ranges": AcousticRange(rate=pings, offset=1.3, lever_arm_b=LEVER["ranges"], beacons=BEACONS, sigma=2e-4),
    }  # fmt: skip
    log = simulate(circle(place, duration, speed=1.5, radius=60.0, weave=ROUGH), instruments, seed=1)
    imu = log["imu"]
    return replace(log, tables={**log.tables, "imu": imu.select((imu.time < gap[0]) | (imu.time > gap[1]))})


def prepared(log: Log, aboard: Vehicle, rate: float = 1.0) -> tuple[Navigator, Stream]:
    """Return a navigator at the start of a log, and its stream with outputs at `rate`."""
    navigator, _, _ = navigator_for(log, aboard)
    return navigator, stream_of(log, aboard, navigator, rate=rate)


WATER = 4 * pi * 6.6743e-11 * 1028.0  # what a layer of sea water takes off the gradient of gravity, s^-2


def skew(a: Any) -> np.ndarray:
    """Matrix of the vector product: skew(a) b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def rotation(vector: np.ndarray) -> np.ndarray:
    """Rodrigues: I + sin t / t [v]x + (1 - cos t) / t^2 [v]x^2."""
    half, k = 0.5 * sqrt(vector @ vector) / pi, skew(vector)
    return np.eye(3) + np.sinc(2 * half) * k + 0.5 * np.sinc(half) ** 2 * (k @ k)


def matrix_of(q: np.ndarray) -> np.ndarray:
    """Rotation matrix of a unit quaternion: (w^2 - v.v) I + 2 v v^T + 2 w [v]x."""
    w, v = q[0], q[1:]
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * skew(v)


@dataclass
class Pose:
    """Place (rotation n to e, height) and attitude; moved by errors as the conventions say."""

    en: np.ndarray
    height: float
    nb: np.ndarray

    @property
    def radii(self) -> tuple[float, float]:
        """Radii of curvature of meridian and prime vertical, at height."""
        w = 1.0 - E2 * self.en[2, 2] ** 2
        return A * (1.0 - E2) / w**1.5 + self.height, A / sqrt(w) + self.height

    @property
    def turning(self) -> np.ndarray:
        """W (3, 3): rate of the navigation frame against the Earth, w_en = W v."""
        meridian, prime = self.radii
        north = self.en[2, :2] / np.hypot(*self.en[2, :2])
        curvature = np.eye(2) / prime + np.outer(north, north) * (1.0 / meridian - 1.0 / prime)
        full = np.zeros((3, 3))
        full[0, :2], full[1, :2] = curvature[1], -curvature[0]
        return full

    @property
    def position_e(self) -> np.ndarray:
        """Earth-fixed position."""
        prime, up = A / sqrt(1.0 - E2 * self.en[2, 2] ** 2), -self.en[:, 2]
        return (prime + self.height) * up - np.array([0.0, 0.0, E2 * prime * up[2]])

    @property
    def wander(self) -> float:
        """Angle of the first axis clockwise from north."""
        return atan2(-self.en[2, 1], self.en[2, 0])

    @property
    def heading(self) -> float:
        """Heading clockwise from true north."""
        return self.wander + atan2(self.nb[1, 0], self.nb[0, 0])

    @property
    def north_turning(self) -> np.ndarray:
        """How the wander angle grows with a move along n (rad/m): tan(latitude) / R per metre to the east."""
        latitude = np.arcsin(-self.en[2, 2])
        return np.tan(latitude) / self.radii[1] * np.array([sin(self.wander), cos(self.wander), 0.0])

    def gravity(self, surface: float) -> float:
        """Somigliana, second order in height, less the attraction of the water above."""
        s2, f, m = self.en[2, 2] ** 2, 1.0 - sqrt(1.0 - E2), 3.449786506841e-3
        normal = 9.7803253359 * (1.0 + 1.931852652458e-3 * s2) / sqrt(1.0 - E2 * s2)
        h = self.height / A
        return normal * (1.0 - 2.0 * (1.0 + f + m - 2.0 * f * s2) * h + 3.0 * h * h) - WATER * max(surface - self.height, 0.0)

    def moved(self, d: np.ndarray) -> np.ndarray:
        """Move by d (m) along n; returns the new place."""
        self.en, self.height = self.en @ rotation(self.turning @ d), self.height - d[2]
        return self.en

    def corrected(self, d: np.ndarray) -> None:
        """Take errors of place and attitude (6) in."""
        self.moved(d[:3])
        self.nb = rotation(d[3:]) @ self.nb


class Twin:
    """The filter: `run` consumes the stream, `outputs` gathers (x, covariance) at each output."""

    def __init__(self, navigator: Navigator, aboard: Vehicle, log: Log) -> None:
        """Start where the navigator starts."""
        composition, state = navigator.composition, navigator.state
        layout: Layout = composition.layout
        x, n = state[layout.x], layout.fixed
        self.time, self.composition, self.vehicle = float(state[0]), composition, aboard
        self.surface, self.reference = log.datum.geoid_undulation, aboard["imu"].lever_arm_b
        self.pose = Pose(matrix_of(x[0:4]), float(x[4]), matrix_of(x[8:12]))
        self.velocity, self.gyro_bias, self.accel_bias = x[5:8].copy(), x[12:15].copy(), x[15:18].copy()
        self.names = [nuisance.name for nuisance in layout.nuisances]
        self.nuisances, self.constants = x[18 : 18 + len(self.names)].copy(), layout.nuisances
        self.P = state[layout.covariance].reshape(layout.error, -1)[:n, :n].copy()
        self.clones: list[tuple[float, Pose]] = []
        self.input = np.zeros(8)
        self.outputs: list[tuple[np.ndarray, np.ndarray]] = []
        self.noise = process_noise(aboard)
        self.transition, self.drive = np.eye(n), np.zeros((n, n))  # of the last step: the matrix, and the covariance that it adds
        self.looked: tuple[np.ndarray, ...] = ()  # the last row that was looked at: Jacobian, residual, noise, correction
        self.gates = [chi2.ppf(slot.gate_probability, len(slot.channel.components)) for slot in composition.slots]

    def run(self, events: Events) -> list[int]:
        """Consume all events; returns the outcome of each measurement."""
        outcomes = []
        for time, kind, first, last in zip(events.time, events.kind, events.start, events.stop, strict=True):
            row = events.data[first:last]
            if kind == IS_OUTPUT:
                ahead = deepcopy(self) if self.time < time else self
                ahead.advance(time)
                self.outputs.append((ahead.x, ahead.P[: 15 + len(self.names), : 15 + len(self.names)].copy()))
                continue
            self.advance(time)
            if kind == IS_INPUT:
                self.input = row.copy()
            elif kind == IS_CLONE:
                self.clone()
            elif kind == IS_DROP:
                self.drop(row[0])
            else:
                outcomes.append(self.update(int(kind), row))
        return outcomes

    def __deepcopy__(self, memo: dict[int, Any]) -> Twin:
        """Copy the state alone."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.pose, other.P, other.nuisances = replace(self.pose), self.P.copy(), self.nuisances.copy()
        return other

    @property
    def x(self) -> np.ndarray:
        """All numbers of the estimate, rotations as matrices."""
        return np.concatenate(
            [self.pose.en.ravel(), [self.pose.height], self.velocity, self.pose.nb.ravel(), self.gyro_bias, self.accel_bias, self.nuisances]
        )

    def advance(self, time: float) -> None:
        """Propagate, in steps of a tenth of a second at most."""
        while self.time < time:
            dt = min(time - self.time, 0.1)
            self.propagate(dt)
            self.time = time if dt < 0.1 else self.time + 0.1

    def propagate(self, dt: float) -> None:
        """State, then covariance."""
        rotation_nb, curvature = self.pose.nb, 1.0 / self.pose.radii[1]
        force, w_in, w_coriolis, turning, gravity = self.mechanise(dt)
        f = np.zeros((15, 15))
        f[0:3, 3:6] = np.eye(3)
        f[3:6, 3:6], f[3:6, 6:9] = -skew(w_coriolis), -skew(force)
        f[5, 2] = 2.0 * gravity * curvature - (WATER if self.pose.height < self.surface else 0.0)
        f[6:9, 3:6], f[6:9, 6:9] = -turning, -skew(w_in)
        if not self.input[6]:
            f[3:9] = 0.0
        if self.input[6]:
            f[3:6, 12:15] = f[6:9, 9:12] = -rotation_nb
        n, k = len(self.P), len(self.names)
        decay = np.array([1.0 if isinf(c.tau) else exp(-dt / c.tau) for c in self.constants])
        transition = np.eye(n)
        transition[:15, :15] += f * dt
        transition[range(15, 15 + k), range(15, 15 + k)] = decay
        mean = np.array([c.value for c in self.constants])
        self.nuisances = mean + (self.nuisances - mean) * decay
        self.P = transition @ self.P @ transition.T
        drive = [c.walk**2 * dt if isinf(c.tau) else c.steady**2 * (1.0 - exp(-2.0 * dt / c.tau)) for c in self.constants]
        q = np.diag(np.concatenate([self.noise[int(self.input[6])] * dt, drive, np.zeros(n - 15 - k)]))
        if not self.input[6]:  # the unknown motion: q integrated once and twice
            place, velocity, shaken = np.arange(3), np.arange(3, 6), self.noise[0][3:6]
            q[place, place] = shaken * dt**3 / 3
            q[place, velocity] = q[velocity, place] = shaken * dt**2 / 2
        self.P += q
        self.transition, self.drive = transition, q

    def mechanise(self, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
        """Strapdown over dt; returns mean force, frame rates, W and gravity for the transition."""
        pose, v, present = self.pose, self.velocity, bool(self.input[6])
        earth, turning, gravity = pose.en.T @ EARTH, pose.turning, pose.gravity(self.surface)
        if not present:
            pose.moved(v * dt)
            return np.zeros(3), earth + turning @ v, 2 * earth + turning @ v, turning, gravity
        angle, push = (self.input[0:3] - self.gyro_bias) * dt, (self.input[3:6] - self.accel_bias) * dt
        body = push + np.cross(angle, push) / 2 + np.cross(angle, np.cross(angle, push)) / 6
        s = pose.nb @ body
        dv = s - 0.5 * dt * np.cross(earth + turning @ v, s) + np.array([0.0, 0.0, gravity * dt])
        middle = v + 0.5 * dv
        w_in, w_coriolis = earth + turning @ middle, 2 * earth + turning @ middle
        new = v + dv - np.cross(w_coriolis, middle) * dt
        pose.nb = rotation(-w_in * dt) @ pose.nb @ rotation(angle)
        pose.moved(0.5 * (v + new) * dt)
        self.velocity = new
        return s / dt, w_in, w_coriolis, turning, gravity

    def clone(self) -> None:
        """Augment by the pose of now."""
        n = len(self.P)
        jacobian = np.vstack([np.eye(n), np.eye(n)[[0, 1, 2, 6, 7, 8]]])
        self.P = jacobian @ self.P @ jacobian.T
        self.clones.append((self.time, replace(self.pose)))

    def drop(self, epoch: float) -> None:
        """Marginalise the clone of an epoch out."""
        k = [time for time, _ in self.clones].index(epoch)
        at = 15 + len(self.names) + 6 * k
        keep = np.r_[0:at, at + 6 : len(self.P)]
        self.P = self.P[np.ix_(keep, keep)]
        del self.clones[k]

    def value(self, name: str) -> tuple[float, int | None]:
        """A nuisance of a sensor (0 where it is no state), and its index."""
        return (self.nuisances[self.names.index(name)], 15 + self.names.index(name)) if name in self.names else (0.0, None)

    def update(self, kind: int, row: np.ndarray) -> int:
        """Gate, then Joseph's update."""
        slot = self.composition.slots[kind]
        H, residual, R = self.measure(slot.sensor, slot.channel.components, row)
        S = H @ self.P @ H.T + R
        self.looked = H, residual, R, np.zeros(len(self.P))
        if residual @ np.linalg.solve(S, residual) >= self.gates[kind]:
            return 1
        K = np.linalg.solve(S, H @ self.P).T
        d, rest = K @ residual, np.eye(len(self.P)) - K @ H
        self.P = rest @ self.P @ rest.T + K @ R @ K.T
        self.looked = H, residual, R, d
        self.pose.corrected(d[[0, 1, 2, 6, 7, 8]])
        self.velocity, self.gyro_bias, self.accel_bias = self.velocity + d[3:6], self.gyro_bias + d[9:12], self.accel_bias + d[12:15]
        self.nuisances += d[15 : 15 + len(self.names)]
        for k, (_, pose) in enumerate(self.clones):
            pose.corrected(d[15 + len(self.names) + 6 * k :][:6])
        return 0

    def measure(self, name: str, components: tuple[str, ...], row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Jacobian, residual and noise of a row."""
        H = np.zeros((len(components), len(self.P)))
        lever_b = self.vehicle[name].lever_arm_b - self.reference
        lever = self.pose.nb @ lever_b
        if name == "depth" or components == ("down",):
            datum, at = self.value(f"{name}.datum")
            H[0, 2], H[:, 6:9] = 1.0, -skew(lever)[2]
            self._nuisance(H, at, 1.0)
            return H, row[:1] - (self.surface - self.pose.height + lever[2] + datum), np.diag(row[1:2])
        if name == "heading":
            bias, at = self.value("heading.bias")
            ahead = self.pose.nb[:, 0]
            H[0, 0:3] = self.pose.north_turning
            H[0, 6:9] = np.array([-ahead[1], ahead[0], 0.0]) @ -skew(ahead) / (ahead[0] ** 2 + ahead[1] ** 2)
            self._nuisance(H, at, 1.0)
            return H, (row[:1] - self.pose.heading - bias + pi) % (2 * pi) - pi, np.diag(row[1:2])
        return {"usbl": self._fix, "dvl": self._dvl, "ranges": self._range, "attitude": self._attitude}[name](H, lever_b, lever, row)

    @staticmethod
    def _nuisance(H: np.ndarray, at: int | None, value: Any) -> None:
        if at is not None:
            H[:, at] = value

    def _attitude(
        self, H: np.ndarray, lever_b: np.ndarray, lever: np.ndarray, row: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rotation vector from the measured to the predicted attitude, along the measured heading; its slope to second order."""
        north, level = (
            rotation(np.array([0.0, 0.0, self.pose.wander])),
            np.array([[row[7], row[8], 0.0], [-row[8], row[7], 0.0], [0.0, 0.0, 1.0]]),
        )
        e = Rotation.from_matrix(north @ self.pose.nb @ matrix_of(row[3:7]).T).as_rotvec()
        bias = [self.value(f"attitude.bias_{axis}") for axis in "xyz"]
        H[:, 6:9] = level @ (np.eye(3) - skew(e) / 2 + skew(e) @ skew(e) / 12) @ north
        H[:, 0:3] = np.outer(H[:, 8], self.pose.north_turning)
        for i, (_, index) in enumerate(bias):
            self._nuisance(H, index, np.eye(3)[i])
        return H, -level @ e - [value for value, _ in bias], np.diag(row[9:12])

    def _fix(self, H: np.ndarray, lever_b: np.ndarray, lever: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c, s = cos(self.pose.wander), sin(self.pose.wander)
        north_east = np.array([[c, -s, 0.0], [s, c, 0.0]])
        offset = self.pose.en.T @ (self.pose.position_e - row[2:5]) + lever
        H[:, 0:3], H[:, 6:9] = north_east, -north_east @ skew(lever)
        return H, -north_east @ offset, np.array([[row[5], row[7]], [row[7], row[6]]])

    def _dvl(self, H: np.ndarray, lever_b: np.ndarray, lever: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c, w_in = self.pose.nb, self.pose.en.T @ EARTH + self.pose.turning @ self.velocity
        (scale, at), twist = self.value("dvl.scale"), [self.value(f"dvl.mounting_{axis}") for axis in "xyz"]
        rate = self.input[0:3] - self.gyro_bias - c.T @ w_in if self.input[6] else np.zeros(3)
        to_sensor = self.vehicle["dvl"].rotation_bs.T
        y, arm = to_sensor @ c.T @ self.velocity, to_sensor @ skew(lever_b)  # velocity; and -arm @ rate: of the transducer against it
        e = np.array([value for value, _ in twist])
        a = (1.0 + scale) * (np.eye(3) - skew(e)) @ to_sensor
        H[:, 3:6] = a @ c.T
        H[:, 6:9] = a @ c.T @ skew(self.velocity) + arm @ c.T @ skew(w_in)  # of the rate: by attitude and gyro bias alone
        H[:, 9:12] = arm
        self._nuisance(H, at, y - np.cross(e, y))
        for i, (_, index) in enumerate(twist):
            self._nuisance(H, index, (1.0 + scale) * skew(y)[:, i])
        xx, yy, zz, xy, xz, yz = row[3:9]
        shaken = (
            self.vehicle["imu"].value("gyro_noise") ** 2 / self.input[7] if self.input[6] else self.vehicle["imu"].value("gap_rate") ** 2
        )
        noise = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + shaken * arm @ arm.T
        return H, row[:3] - (1.0 + scale) * (y - np.cross(e, y)) + arm @ rate, noise

    def _range(self, H: np.ndarray, lever_b: np.ndarray, lever: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Half of the way back, at the pose of now, and half of the way there, at the clone."""
        (bias, at), k = self.value("ranges.bias"), [time for time, _ in self.clones].index(row[8])
        total, slope = 0.0, np.zeros(3)
        for pose, place, turn in ((self.pose, 0, 6), (self.clones[k][1], 15 + len(self.names) + 6 * k, 18 + len(self.names) + 6 * k)):
            arm = pose.nb @ lever_b
            gap = pose.position_e + pose.en @ arm - row[2:5]
            unit = pose.en.T @ gap / sqrt(gap @ gap)
            H[0, place : place + 3], H[0, turn : turn + 3] = 0.5 * unit, -0.5 * unit @ skew(arm)
            total += 0.5 * sqrt(gap @ gap)
            slope += 0.5 * pose.en @ unit
        self._nuisance(H, at, 1.0)
        along = rotation(np.array([0.0, 0.0, self.pose.wander])) @ self.pose.en.T @ slope
        return H, row[:1] - total - bias, row[1:2, None] + np.sum(row[5:8] * along**2)


def process_noise(aboard: Vehicle) -> dict[int, np.ndarray]:
    """Noise densities of the motion (15,): 1 with an input, 0 in a gap."""
    imu = aboard["imu"]
    bias = [imu.value(f"{b}_bias_instability") ** 2 / imu.value(f"{b}_bias_tau") for b in ("gyro", "accel")]
    drive = {1: ("accel_noise", "gyro_noise"), 0: ("gap_accel", "gap_rate")}
    return {k: np.repeat([0.0, *(imu.value(name) ** 2 for name in names), *bias], 3) for k, names in drive.items()}


def nominal(layout: Layout, x: np.ndarray) -> np.ndarray:
    """The package's nominal state (motion and nuisances) with rotations as matrices, in the order of `Twin.x`."""
    return np.concatenate(
        [matrix_of(x[0:4]).ravel(), x[4:8], matrix_of(x[8:12]).ravel(), x[12 : layout.motion_nominal + len(layout.nuisances)]]
    )


def covariance(composition: Composition, state: np.ndarray) -> np.ndarray:
    """The active covariance of a flat state."""
    layout = composition.layout
    n = int(state[1])
    return state[layout.covariance].reshape(layout.error, -1)[:n, :n]
