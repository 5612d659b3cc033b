"""The stream: order, arrival and delivery change no bit; trouble is an outcome; a plain-Python sensor equals a compiled one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from twin import BEACONS, dive, prepared, vehicle

from leadline.core.attitude import conjugate, product
from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.data.outcome import Outcome
from leadline.data.records import AcousticRange, Depth, Heading, Table
from leadline.data.solution import Solution
from leadline.data.vehicle import SensorConfig, Vehicle
from leadline.estimate import plan as at
from leadline.estimate.navigator import Navigator
from leadline.estimate.solve import navigator_for, solve
from leadline.models.sensor import Channel, Context, Sensor, finite_rows, nuisances, reading, usable

SENSORS = ("dvl", "depth", "heading", "attitude", "gnss", "usbl", "ranges")
ABOARD = vehicle(*SENSORS, nuisances=("dvl", "heading"))
Rows = list[tuple[str, np.ndarray]]
RUN = (Phase.explicit, Phase.reuse, Phase.generate)  # no shrinking: an example is a whole run


@cache
def example() -> Log:
    """Twenty seconds with all sensors, an IMU gap, and rows of all kinds before the start."""
    whole = dive(20.0, rate=50.0, gap=(8.0, 8.6))
    whole = changed(whole, ranges=whole["ranges"].select(whole["ranges"].time < 19.9))
    loose = {"sigma_position": 3.0, "sigma_velocity": 0.5, "sigma_tilt": 0.1, "sigma_heading": 0.1}
    return replace(whole, initial=replace(whole.initial, time=1.0, **loose))


@pytest.fixture(name="log")
def fixture_log() -> Log:
    return example()


def changed(log: Log, **tables: Table) -> Log:
    return replace(log, tables={**log.tables, **tables})


def assert_same(a: Solution, b: Solution, at_a: Any = slice(None), at_b: Any = slice(None)) -> None:
    """All estimates are equal, bit for bit."""
    for name in ("time", "latitude", "longitude", "height", "velocity_n", "quaternion_nb", "covariance"):
        assert_array_equal(getattr(a, name)[at_a], getattr(b, name)[at_b], err_msg=name)
    for name, estimate in a.nuisances.items():
        assert_array_equal(estimate.value[at_a], b.nuisances[name].value[at_b], err_msg=name)


# --- offline -----------------------------------------------------------------------------------------------------------------------


def test_same_input_same_bytes(log: Log) -> None:
    """Two runs of one log give the same estimates and the same innovations."""
    a, b = solve(log, ABOARD), solve(log, ABOARD)
    assert_same(a, b)
    for name in a.innovations.__dataclass_fields__:
        assert_array_equal(getattr(a.innovations, name), getattr(b.innovations, name))


@settings(max_examples=10, deadline=None, phases=RUN)
@given(more=st.lists(st.floats(1.0, 19.9, allow_nan=False), max_size=40))
def test_extra_outputs_change_nothing(more: list[float]) -> None:
    """Whatever other times are asked for, the estimates at the common times keep every bit."""
    log = example()
    common = np.linspace(1.0, 19.9, 8)
    times = np.union1d(common, more)
    assert_same(solve(log, ABOARD, times=common), solve(log, ABOARD, times=times), at_b=np.searchsorted(times, common))


@settings(max_examples=6, deadline=None, phases=RUN)
@given(seed=st.integers(0, 2**32 - 1), names=st.sets(st.sampled_from(("imu", *SENSORS)), min_size=1))
def test_the_order_of_rows_means_nothing(seed: int, names: set[str]) -> None:
    """Rows shuffled in any tables change no bit, where neither `received` nor `sequence` tells an order."""
    log = example()
    generator = np.random.default_rng(seed)
    shuffled = {name: log[name].select(generator.permutation(len(log[name]))) for name in sorted(names)}
    assert_same(solve(log, ABOARD), solve(changed(log, **shuffled), ABOARD))


def test_rows_of_equal_time_have_an_order(log: Log) -> None:
    """Depths that differ at one time are taken in an order of their own, not in that of the table."""
    depth = log["depth"]
    double = np.repeat(depth.time, 2), np.repeat(depth.depth, 2) + np.tile([0.0, 0.03], len(depth))
    one = Depth(time=double[0], depth=double[1])
    other = one.select(np.arange(len(one)).reshape(-1, 2)[:, ::-1].ravel())
    assert_same(solve(changed(log, depth=one), ABOARD), solve(changed(log, depth=other), ABOARD))


# --- live --------------------------------------------------------------------------------------------------------------------------


def by_arrival(log: Log, delay: dict[str, np.ndarray] | None = None, names: tuple[str, ...] = SENSORS) -> Rows:
    """All rows in order of arrival: time of validity plus delay; at one moment those of the IMU come last."""
    keys = []
    for i, name in enumerate((*names, "imu")):
        late = np.zeros(len(log[name])) if delay is None else delay.get(name, np.zeros(len(log[name])))
        keys += [(time, i, row, name) for row, time in enumerate(log[name].time + late)]
    return [(name, np.array([row])) for _, _, row, name in sorted(keys)]


def live(log: Log, aboard: Vehicle, arrivals: Rows, window: float = 30.0) -> tuple[Navigator, dict[tuple[str, int], int]]:
    """Feed rows as they arrive; returns the navigator and the outcome of each row of the tables."""
    navigator, _, _ = navigator_for(log, aboard, window=window)
    sent: dict[str, list[int]] = {}
    for name, rows in arrivals:
        navigator.add(name, log[name].select(rows))
        sent.setdefault(name, []).extend(rows.tolist())
    return navigator, {(name, sent[name][k]): outcome for (name, k), outcome in navigator.outcomes.items()}


def offline(log: Log, aboard: Vehicle) -> tuple[Navigator, dict[tuple[str, int], int]]:
    """Run the whole log; returns the navigator and the outcome of each row but the IMU's."""
    navigator, stream = prepared(log, aboard)
    results, events = navigator.run(stream.events, len(stream.times)), stream.events
    outcomes = {(name, row): int(code) for name, codes in stream.outcome.items() if name != "imu" for row, code in enumerate(codes)}
    for e in np.flatnonzero(events.measured):
        outcomes[navigator.composition.slots[events.kind[e]].sensor, int(events.row[e])] = int(results.outcome[events.index[e]])
    return navigator, outcomes


def assert_live_is_offline(log: Log, arrivals: Rows, aboard: Vehicle = ABOARD) -> None:
    """State and outcomes are the same, bit for bit; rows after the last inertial one still wait.

    Ranges that would wait are not sent: their clones are in the live state already, and offline never.
    """
    end = np.nanmax(log["imu"].time) - aboard["imu"].latency
    cut = {name: table.select(~(table.time > end)) for name, table in log.tables.items() if isinstance(table, AcousticRange)}
    arrivals = [(name, kept) for name, rows in arrivals if len(kept := rows[rows < len(cut.get(name, log[name]))])]
    log = changed(log, **cut)
    (a, mine), (b, whole) = live(log, aboard, arrivals), offline(log, aboard)
    waiting = {key for key, code in whole.items() if code == Outcome.OUTSIDE_RUN and log[key[0]].time[key[1]] > end}
    assert {k: v for k, v in mine.items() if k not in waiting} == {k: v for k, v in whole.items() if k not in waiting}
    assert all(mine[key] == Outcome.USED for key in waiting)
    assert_array_equal(a.state, b.state)


def test_row_by_row_is_the_whole_log(log: Log) -> None:
    """All sensors, two-way ranges with two clones, a gap, rows before the start: live equals offline in each bit of the state."""
    assert_live_is_offline(log, by_arrival(log))


def test_used_rows_are_most_rows(log: Log) -> None:
    """The comparison above is not one of empty runs: each sensor is used, and clones are found."""
    _, outcomes = offline(log, ABOARD)
    for name in SENSORS:
        codes = [code for (sensor, _), code in outcomes.items() if sensor == name]
        assert codes.count(Outcome.USED) > 0.7 * len(codes) - 2, name
        assert Outcome.NO_CLONE not in codes


@settings(max_examples=5, deadline=None, phases=RUN)
@given(seed=st.integers(0, 2**32 - 1))
def test_late_rows_are_put_in_their_place(seed: int) -> None:
    """Aiding rows that arrive up to 4 s late, in any order, lead to the same state."""
    log = example()
    generator = np.random.default_rng(seed)
    delay = {name: generator.uniform(0.0, 4.0, len(log[name])) * (generator.random(len(log[name])) < 0.3) for name in SENSORS}
    padded = by_arrival(log, delay)
    assert_live_is_offline(log, padded)


@settings(max_examples=5, deadline=None, phases=RUN)
@given(seed=st.integers(0, 2**32 - 1))
def test_several_rows_per_call(seed: int) -> None:
    """Rows that come in parcels of one sensor lead to the same state."""
    log = example()
    generator, parcels = np.random.default_rng(seed), []
    open_parcel: dict[str, list[int]] = {}
    for name, row in by_arrival(log):
        open_parcel.setdefault(name, []).append(int(row[0]))
        if generator.random() < 0.2:
            parcels.append((name, np.array(open_parcel.pop(name))))
    parcels += [(name, np.array(rows)) for name, rows in open_parcel.items()]
    assert_live_is_offline(log, parcels)


def test_rows_before_the_first_input(log: Log) -> None:
    """Depths between the start and the first inertial row are used offline, and live also where they arrive after that row."""
    early = replace(log, initial=replace(log.initial, time=0.0))
    early = changed(early, imu=early["imu"].select(early["imu"].time > 0.5))
    assert_live_is_offline(early, by_arrival(early))
    assert_live_is_offline(early, by_arrival(early, {"depth": np.full(len(early["depth"]), 1.0)}))


def test_latency_of_the_imu(log: Log) -> None:
    """An IMU whose rows are stamped late ends its coverage earlier, live and offline alike."""
    imu = replace(ABOARD["imu"], latency=0.05)
    aboard = replace(ABOARD, sensors={**ABOARD.sensors, "imu": imu})
    assert_live_is_offline(log, by_arrival(log), aboard)


def test_older_than_the_window_is_late(log: Log) -> None:
    """A depth that arrives 10 s after its time, with a window of 5 s, is LATE and changes nothing; the rest of the run goes on."""
    without = changed(log, depth=log["depth"].select(np.arange(len(log["depth"])) != 60))
    delay = {"depth": np.where(np.arange(len(log["depth"])) == 60, 10.0, 0.0)}
    a, outcomes = live(log, ABOARD, by_arrival(log, delay), window=5.0)
    b, _ = live(without, ABOARD, by_arrival(without), window=5.0)
    assert outcomes["depth", 60] == Outcome.LATE
    assert_array_equal(a.state, b.state)


def test_estimate_leaves_the_state(log: Log) -> None:
    """Asking for an estimate ahead of the state is an advanced copy."""
    navigator, _ = live(log, ABOARD, by_arrival(log)[:800])
    before = navigator.state.copy()
    ahead = navigator.output(navigator.time + 0.5)
    assert_array_equal(navigator.state, before)
    assert np.isfinite(ahead).all()
    assert ahead[at.OUT_COV] > navigator.output()[at.OUT_COV]


# --- two epochs --------------------------------------------------------------------------------------------------------------------


def lbl(log: Log, second: float = 0.21) -> Table:
    """Two replies to each transmission, from both beacons, the second one later by `second` (s)."""
    one = log["ranges"].select(log["ranges"].transmitter == "one")
    distance = {name: ranges_to(log, name, one.time + (second if name == "two" else 0.0)) for name in BEACONS}
    columns = {name: np.repeat(getattr(one, name), 2) for name in ("transmit",)}
    late = np.tile([0.0, second], len(one))
    return AcousticRange(
        time=np.repeat(one.time, 2) + late, transmitter=np.tile(["one", "two"], len(one)), path=np.repeat(["two_way"], 2 * len(one)),
        range=np.column_stack([distance["one"], distance["two"]]).ravel(), **columns,
    )  # fmt: skip


def ranges_to(log: Log, beacon: str, time: np.ndarray) -> np.ndarray:
    """True distances, roughly (the truth has no lever arm): good enough to pass a wide gate."""
    truth, mark = log.truth, BEACONS[beacon]
    north, east = (np.interp(time, truth.time, values) for values in local(log))
    return np.sqrt((north - mark.north) ** 2 + (east - mark.east) ** 2 + (np.interp(time, truth.time, truth.depth) - mark.depth) ** 2)


def local(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """North and east of the truth."""
    from leadline.core.geodesy import north_east

    north, east = north_east(log.truth.latitude, log.truth.longitude, log.origin.latitude, log.origin.longitude)
    return north, east


def test_two_replies_to_one_transmission(log: Log) -> None:
    """Long baseline: both replies find the one clone of their transmission; live, the second reply may come seconds later."""
    shared = changed(log, ranges=lbl(log))
    _, outcomes = offline(shared, ABOARD)
    codes = [code for (name, row), code in outcomes.items() if name == "ranges" and 1.0 < shared["ranges"].time[row] < 20.0]
    assert codes.count(Outcome.USED) > 0.9 * len(codes)
    assert Outcome.NO_CLONE not in codes
    assert_live_is_offline(shared, by_arrival(shared))
    late = {"ranges": np.where(shared["ranges"].transmitter == "two", 2.5, 0.0)}
    assert_live_is_offline(shared, by_arrival(shared, late))


def test_two_tables_with_one_transmission(log: Log) -> None:
    """Two receivers, two tables, one transmission: the clone lives until the last row of either has looked at it, live and offline."""
    replies = lbl(log)
    one, two = (replies.select(replies.transmitter == name) for name in BEACONS)
    more = '\n[sensors.second]\nkind = "acoustic_range"\nsigma_m = 0.3\nrange_max_m = 3000.0\n'
    aboard = vehicle(*SENSORS, nuisances=("dvl",), more=more)
    shared = replace(log, tables={**log.tables, "ranges": one, "second": two})
    _, outcomes = offline(shared, aboard)
    codes = [code for (name, row), code in outcomes.items() if name == "second" and 1.0 < two.time[row] < 20.0]
    assert Outcome.NO_CLONE not in codes
    assert_live_is_offline(shared, by_arrival(shared, names=(*SENSORS, "second")), aboard)


@pytest.mark.parametrize(
    ("transmit", "reason"), [(0.5, "before the start"), (-500.0, "longer ago than any flight"), (5.2, "after the reception")]
)
def test_an_epoch_that_cannot_be_had(log: Log, transmit: float, reason: str) -> None:
    """A two-way range whose transmission lies where no pose is known is NO_CLONE, live and offline."""
    row = AcousticRange(time=[5.0], transmitter=["one"], path=["two_way"], range=[550.0], transmit=[transmit])
    lone = changed(log, ranges=row)
    assert offline(lone, ABOARD)[1]["ranges", 0] == Outcome.NO_CLONE
    assert_live_is_offline(lone, by_arrival(lone))


def test_more_flights_than_clones(log: Log) -> None:
    """Of more transmissions under way than there are clones the oldest is given up: NO_CLONE, never a wrong pose."""
    sent = np.arange(2.0, 18.0, 0.25)
    rows = AcousticRange(time=sent + 0.9, transmitter=np.repeat("one", len(sent)), path=np.repeat("two_way", len(sent)),
                         range=ranges_to(log, "one", sent + 0.5), transmit=sent)  # fmt: skip
    crowded, aboard = changed(log, ranges=rows), replace(ABOARD, process=replace(ABOARD.process, clones=2))
    codes = [code for (name, _), code in offline(crowded, aboard)[1].items() if name == "ranges"]
    assert codes.count(Outcome.NO_CLONE) > 0.8 * len(codes)
    assert_live_is_offline(crowded, by_arrival(crowded), aboard)


# --- trouble -----------------------------------------------------------------------------------------------------------------------


def appended(table: Table, **values: Any) -> Table:
    """The table with its row 50 once more at the end, changed."""
    longer = table.select(np.append(np.arange(len(table)), 50))
    columns = {name: getattr(longer, name).copy() for name in values}
    for name, value in values.items():
        columns[name][-1] = value
    return replace(longer, **columns)


def sequenced(table: Table) -> Table:
    return replace(table, sequence=np.arange(len(table), dtype=float))


TROUBLE: dict[str, tuple[Callable[[Depth], Table], Outcome]] = {
    "not a number": (lambda depth: appended(depth, depth=np.nan), Outcome.INVALID),
    "no time": (lambda depth: appended(depth, time=np.nan), Outcome.INVALID),
    "infinite": (lambda depth: appended(depth, depth=np.inf), Outcome.INVALID),
    "called invalid": (lambda depth: appended(replace(depth, valid=np.ones(len(depth))), valid=0.0), Outcome.INVALID),
    "twice": (lambda depth: appended(depth), Outcome.DUPLICATE),
    "clock jump": (lambda depth: sequenced(appended(depth, time=3.01)), Outcome.CLOCK_JUMP),
    "before the start": (lambda depth: appended(depth, time=-3.0), Outcome.OUTSIDE_RUN),
    "outlier": (lambda depth: appended(depth, depth=300.0, time=5.0), Outcome.GATED),
}


@pytest.mark.parametrize(("make", "outcome"), TROUBLE.values(), ids=TROUBLE.keys())
def test_trouble_is_an_outcome(log: Log, make: Callable[[Depth], Table], outcome: Outcome) -> None:
    """A row in trouble has the right outcome and changes no estimate, offline, live, and live in parcels."""
    troubled = changed(log, depth=make(log["depth"]))
    last = len(log["depth"])
    base, _ = offline(log, ABOARD)
    whole, outcomes = offline(troubled, ABOARD)
    assert outcomes["depth", last] == outcome
    assert_array_equal(whole.state, base.state)
    everything = [("imu", np.arange(len(log["imu"])))] + [(name, np.arange(len(troubled[name]))) for name in SENSORS]
    for arrivals in ([*by_arrival(log), ("depth", np.array([last]))], everything):
        navigator, mine = live(troubled, ABOARD, arrivals)
        assert mine["depth", last] == outcome
        assert_array_equal(navigator.state, base.state)


def test_a_duplicate_in_the_next_parcel(log: Log) -> None:
    """A row that comes again in another parcel is known again, as it is offline."""
    parcels = by_arrival(log)[:400]
    done = max(int(row[0]) for name, row in parcels if name == "depth")
    again = [("depth", np.array([done + 1, done + 2])), ("depth", np.array([done + 2, done + 3]))]
    navigator, _, _ = navigator_for(log, ABOARD)
    for name, rows in parcels + again:
        navigator.add(name, log[name].select(rows))
    assert navigator.outcomes["depth", done + 3] == Outcome.DUPLICATE


def test_held_values(log: Log) -> None:
    """Of a sensor that holds its values between measurements each value counts once; of another one each row counts."""
    depth = log["depth"]
    held = changed(log, depth=Depth(time=depth.time, depth=np.repeat(depth.depth[::5], 5)[: len(depth)]))
    aboard = replace(ABOARD, sensors={**ABOARD.sensors, "depth": replace(ABOARD["depth"], repeats="held")})
    codes = [code for (name, row), code in offline(held, aboard)[1].items() if name == "depth" and depth.time[row] > 1.0]
    assert abs(codes.count(Outcome.HELD) - 0.8 * len(codes)) < 2
    assert all(code != Outcome.HELD for code in offline(held, ABOARD)[1].values())
    assert_live_is_offline(held, by_arrival(held), aboard)


def test_rows_after_the_end(log: Log) -> None:
    """Rows after the last inertial one are OUTSIDE_RUN; live they wait, and none is an exception."""
    short = changed(log, imu=log["imu"].select(log["imu"].time < 15.0))
    _, outcomes = offline(short, ABOARD)
    assert all(code == Outcome.OUTSIDE_RUN for (name, row), code in outcomes.items() if log[name].time[row] > 15.0)
    assert_live_is_offline(short, by_arrival(short))


def test_a_table_that_nobody_configured(log: Log) -> None:
    """Rows of a table that the vehicle file does not name are NOT_CONFIGURED, left out on request EXCLUDED; live, both are refused."""
    named = {name: sensor for name, sensor in ABOARD.sensors.items() if name != "gnss"}
    assert solve(log, replace(ABOARD, sensors=named)).summary["counts"]["gnss"] == {"not_configured": len(log["gnss"])}
    aboard = ABOARD.without("gnss")
    assert solve(log, aboard).summary["counts"]["gnss"] == {"excluded": len(log["gnss"])}
    navigator, _, _ = navigator_for(log, aboard)
    with pytest.raises(InputError, match="has no sensor 'gnss'"):
        navigator.add("gnss", log["gnss"])


@pytest.mark.parametrize("wrong", ["nan", "backward", "equal"])
def test_bad_inertial_rows(log: Log, wrong: str) -> None:
    """Inertial rows that are not numbers or do not move on in time are INVALID; live in one parcel as one by one, and offline."""
    imu = log["imu"]
    k = 400
    broken = imu.gyro.copy()
    time = imu.time.copy()
    if wrong == "nan":
        broken[k] = np.nan
    else:
        time[k : k + 2] = time[k - 1] - np.array([1.003, 0.503]) if wrong == "backward" else time[k - 1]
    bad = changed(log, imu=replace(imu, gyro=broken, time=time))
    single, _ = live(bad, ABOARD, [("imu", np.array([i])) for i in range(len(imu))])
    parcel, _ = live(bad, ABOARD, [("imu", np.arange(len(imu)))])
    assert_array_equal(single.state, parcel.state)
    assert np.isfinite(solve(bad, ABOARD).latitude).all()


# --- sensors in plain Python -------------------------------------------------------------------------------------------------------


def python_depth(config: SensorConfig, context: Context) -> Sensor:
    """The depth sensor, written as a function."""
    lever, variance = context.lever(config), config.value("sigma") ** 2

    def predict(views: Any, nuisance: Any, row: Any) -> Any:
        return context.surface - views[0].height + (views[0].rotation_nb @ lever)[2], [variance]

    def read(table: Depth) -> Any:
        return reading(table, finite_rows(0, table.depth[:, None], usable(table)))

    return Sensor(config, (Channel(("depth",), predict, np.zeros(0), 1),), read)


def python_heading(config: SensorConfig, context: Context) -> Sensor:
    """The heading sensor: one component, an angle, and a bias as a state."""

    def predict(views: Any, nuisance: Any, row: Any) -> Any:
        return views[0].heading + nuisance[0], [config.value("sigma") ** 2]

    def read(table: Heading) -> Any:
        return reading(table, finite_rows(0, table.heading[:, None], usable(table)))

    return Sensor(config, (Channel(("heading",), predict, np.zeros(0), 1, nuisances(config, "bias", 1, "rad"), angles=(True,)),), read)


def python_dvl(config: SensorConfig, context: Context) -> Sensor:
    """The Doppler log with its scale and mounting errors."""
    lever, noise = context.lever(config), config.value("sigma") ** 2 * np.eye(3)
    states = nuisances(config, "scale", 1, "1") + nuisances(config, "mounting", 3, "rad", "sensor")

    def predict(views: Any, nuisance: Any, row: Any) -> Any:
        y = config.rotation_bs.T @ views[0].rotation_nb.T @ views[0].velocity_n
        arm = config.rotation_bs.T @ np.cross(views[0].rate_b, lever)
        return (1 + nuisance[0]) * (y - np.cross(nuisance[1:4], y)) + arm, noise

    def read(table: Any) -> Any:
        return reading(table, finite_rows(0, table.velocity, usable(table)))

    return Sensor(config, (Channel(("velocity_x", "velocity_y", "velocity_z"), predict, np.zeros(0), 3, states),), read)


@pytest.mark.parametrize("name", ["depth", "heading", "dvl"])
def test_a_sensor_in_plain_python_equals_the_compiled_one(log: Log, name: str) -> None:
    """Value by a function, Jacobian by differences: the estimates agree to 1e-8 (m/s, m, rad; covariances in sigmas).

    For heading less well: the kernel leaves out how north turns with position, tan(latitude) / R = 1e-7 rad/m.
    """
    config = replace(ABOARD[name], model=f"test_stream:python_{name}")
    plain = solve(log, replace(ABOARD, sensors={**ABOARD.sensors, name: config}))
    compiled = solve(log, ABOARD)
    sigma = np.sqrt(np.diagonal(compiled.covariance, axis1=1, axis2=2))
    assert plain.summary["counts"][name] == compiled.summary["counts"][name]
    scale = sigma[:, :, None] * sigma[:, None]
    assert_allclose(plain.covariance / scale, compiled.covariance / scale, atol=3e-5 if name == "heading" else 1e-8)
    turned = 2.0 * product(plain.quaternion_nb, conjugate(compiled.quaternion_nb))[:, 1:]
    for error in (plain.velocity_n - compiled.velocity_n, (plain.height - compiled.height)[:, None], turned):
        assert np.abs(error).max() < (1e-7 if name == "heading" else 1e-8)


def python_trouble(config: SensorConfig, context: Context) -> Sensor:
    """A depth sensor whose function gives no number every third time."""

    def read(table: Depth) -> Any:
        return reading(table, finite_rows(0, np.column_stack([table.depth, np.arange(len(table)) % 3]), usable(table)))

    return Sensor(
        config, (Channel(("depth",), lambda views, nuisance, row: (np.nan if row[1] == 0 else 20.0, [1e6]), np.zeros(0), 2),), read
    )


def test_a_python_sensor_without_an_answer(log: Log) -> None:
    """A value that is no number is the outcome INVALID."""
    aboard = replace(ABOARD, sensors={**ABOARD.sensors, "depth": replace(ABOARD["depth"], model="test_stream:python_trouble")})
    _, outcomes = offline(log, aboard)
    assert outcomes["depth", 120] == Outcome.INVALID
    assert outcomes["depth", 121] == Outcome.USED


# --- what does not fit -------------------------------------------------------------------------------------------------------------


def python_wide(config: SensorConfig, context: Context) -> Sensor:
    """A sensor with nine components."""
    return Sensor(config, (Channel(tuple("abcdefghi"), lambda *a: None, np.zeros(0), 9),), lambda table: None)


@pytest.mark.parametrize("case", ["states", "components", "clones"])
def test_what_does_not_fit_is_refused(log: Log, case: str) -> None:
    """Too many states or components, and two-way ranges without room for a clone, are refused in one line."""
    if case == "states":
        more = "[sensors.attitude.nuisance]\nbias = { sigma_deg = 1.0 }\n[sensors.imu.nuisance]\n"
        more += "\n".join(f"{unit}_misalignment = {{ sigma_deg = 0.1 }}" for unit in ("gyro", "accel"))
        aboard = vehicle(*SENSORS[:3], *SENSORS[4:], "attitude", nuisances=("dvl", "depth", "heading", "ranges"), more=more)
        aboard = replace(aboard, process=replace(aboard.process, clones=3))
    elif case == "components":
        aboard = replace(ABOARD, sensors={**ABOARD.sensors, "depth": replace(ABOARD["depth"], model="test_stream:python_wide")})
    else:
        aboard = replace(ABOARD, process=replace(ABOARD.process, clones=0))
    with pytest.raises(InputError) as caught:
        navigator_for(log, aboard)
    assert "\n" not in str(caught.value)
    assert case in str(caught.value) or case[:-1] in str(caught.value)
