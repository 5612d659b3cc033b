"""Trouble at sea: a survey of twenty minutes under each of ten conditions; errors stay inside their sigmas and each event is told.

A tactical fibre-optic unit (and a MEMS unit that stands in for it), Doppler log, depth, heading, and a position fix every half minute.
`python tests/test_trials.py [RUNS] [SEEDS ...]` runs a hundred of each; the test runs a few.  Seeds `sailed`: a hull sails the survey.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy.stats import chi2, norm

from leadline.assess.consistency import Answer
from leadline.assess.happenings import Happening
from leadline.data.errors import InputError
from leadline.data.hull import read_hull
from leadline.data.outcome import Outcome
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.missions.instruments import instruments_of
from leadline.missions.montecarlo import monte_carlo, seed_of
from leadline.missions.trials import AT_ONCE, FILTERED, SMOOTHED, Condition, Trials, known_at_once, trials
from leadline.sea.water import Water
from leadline.simulate import routes
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.faults import BeamsFailing, ClockJump, CompassSwinging, EmptyRows, LateDelivery, Outage, WildFixes, troubled
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place
from leadline.simulate.voyage import Voyage

RUNS, FEW = 100, 5
DURATION, SIGMA = 1200.0, 3
EVERY = 7.0  # s between looks at the truth: no fraction of the half minute between fixes, so that each delay is met
START = StartSigmas(position=2.0, depth=0.2, velocity=0.05, tilt=radians(0.3), heading=radians(1.0))
PLACE = Place(radians(45.0), radians(10.0), depth=20.0, surface_height=10.0)
PLAN = Lawnmower(legs=6, length=250.0, spacing=40.0, speed=1.5, heading=radians(30.0))

ABOARD = """
name = "kvh-1775"
{process}
[sensors.imu]
preset = "kvh-1775"
rate_hz = {rate}
lever_arm_m = [0.3, 0.0, -0.05]
{second}
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
lever_arm_m = [-0.6, 0.1, 0.3]
mounting_deg = [0.0, 0.0, 45.0]
{beams}
[sensors.dvl.nuisance]
scale = {{ sigma_percent = 0.3 }}
mounting = {{ sigma_deg = 0.5 }}
[sensors.depth]
rate_hz = 5.0
sigma_m = 0.05
lever_arm_m = [0.7, 0.0, -0.1]
nuisance = {{ datum = {{ sigma_m = 0.1 }} }}
[sensors.heading]
rate_hz = 5.0
sigma_deg = 0.5
nuisance = {{ bias = {{ sigma_deg = 0.5 }} }}
[sensors.usbl]
kind = "position_fix"
rate_hz = 0.033333333333333333
sigma_m = 1.0
vertical = false
lever_arm_m = [0.2, 0.0, -0.3]
"""
BEAMS = """
use = "beams"
beam_azimuth_deg = [45.0, 135.0, 225.0, 315.0]
beam_tilt_deg = 30.0
"""
SECOND = """
[sensors.imu_b]
kind = "imu"
preset = "xsens-mti-30"
rate_hz = {rate}
lever_arm_m = [0.1, 0.1, 0.0]
"""


def vehicle(rate=100.0, *, beams=False, second=False):
    parts = {"beams": BEAMS if beams else "", "second": SECOND.format(rate=rate) if second else ""}
    return vehicle_from_toml(ABOARD.format(rate=rate, process='[process]\nstandby = "imu_b"' if second else "", **parts))


AIDING = ("dvl", "depth", "heading", "usbl")
LATE = "fixes 2 to 8 s late"


def sailed():
    """The same survey by a hull that is steered along it in a current, instead of by formulas."""
    way = routes.Lawnmower(
        legs=PLAN.legs, length=PLAN.length, spacing=PLAN.spacing, bearing=PLAN.heading, speed=PLAN.speed, depth=PLACE.depth
    )
    place = replace(PLACE, water=Water(shear=((0.0, 0.15, 0.05), (30.0, 0.05, 0.0))))
    return Voyage(
        read_hull("remus-100"), routes.Plan((way,)), place, depth=PLACE.depth, heading=PLAN.heading, speed=1.0, limit=DURATION
    ).run()


def dives(rate=100.0, duration=DURATION, trajectory=None):
    """The dive of three vehicles: plain, by beams, with a second inertial unit."""
    trajectory = trajectory or survey(PLACE, PLAN, duration=duration)
    vehicles = {"plain": vehicle(rate), "beams": vehicle(rate, beams=True), "second": vehicle(rate, second=True)}
    return {k: (Recorder(trajectory, instruments_of(v), truth_rate=1.0 / EVERY, start=START), v) for k, v in vehicles.items()}


def conditions(rate=100.0, trajectory=None):
    """What is tried: faults by condition, and what must be told of them."""
    by_vehicle = dives(rate, trajectory=trajectory)
    empty = (*(EmptyRows(sensor=name, fraction=0.05) for name in AIDING), EmptyRows(sensor="imu", fraction=0.01))
    tried = {
        ("calm", "plain"): ((), ()),
        (LATE, "plain"): ((LateDelivery(sensor="usbl"),), (("delayed", "usbl"),)),
        ("10 % wild fixes", "plain"): ((WildFixes(sensor="usbl", fraction=0.1, low=10.0, high=100.0),), (("outliers", "usbl"),)),
        ("Doppler log lost for 10 min", "plain"): ((Outage(sensor="dvl", begin=300.0, end=900.0),), (("invalid", "dvl"),)),
        ("beams failing one by one", "beams"): (
            (BeamsFailing(sensor="dvl", times=(300.0, 500.0, 700.0, 900.0)),),
            (("beam_silent", "dvl"), ("invalid", "dvl")),
        ),
        ("compass swinging 30 deg for 2 min", "plain"): (
            (CompassSwinging(sensor="heading", begin=600.0, end=720.0, amplitude=radians(30.0), period=30.0),),
            (("gated", "heading"),),
        ),
        ("clock 1 s ahead for 1 min", "plain"): (
            (ClockJump(sensor="dvl", begin=400.0, end=460.0, step=1.0),),
            (("clock_step", "dvl"), ("clock_jump", "dvl")),
        ),
        ("clock 1 s back, and stays", "plain"): (
            (ClockJump(sensor="dvl", begin=400.0, step=-1.0),),
            (("clock_step", "dvl"), ("clock_jump", "dvl")),
        ),
        ("5 % of rows nan", "plain"): (empty, tuple(("invalid", fault.sensor) for fault in empty)),
        ("inertial gap of 2 s", "plain"): ((Outage(sensor="imu", begin=601.0, end=603.0, rows="absent"),), (("inertial_gap", "imu"),)),
        ("second inertial unit takes over", "second"): (
            (Outage(sensor="imu", begin=600.0, rows="absent"),),
            (("inertial_standby", "imu_b"),),
        ),
    }
    return [
        Condition(name, *by_vehicle[aboard], faults, named, at_once=name in ("calm", LATE))
        for (name, aboard), (faults, named) in tried.items()
    ]


def shortfalls(found: dict[str, Trials]) -> list[str]:
    """What of the bars does not hold: the 99 % interval of each statistic must reach its limit."""
    short = []
    for name, these in found.items():
        for estimate in these.studies:
            inside = enumerate(these.within(estimate))
            short += [f"{name}: {estimate} error {k} inside {SIGMA} sigma: {i}" for k, i in inside if not i.reaches(at_least=0.99)]
        short += [f"{name}: smoothed error {k} over filtered: {i}" for k, i in enumerate(these.smoothing()) if not i.reaches(1.0)]
        short += [f"{name}: not told: {kind} of {sensor}" for kind, sensor in these.untold()]
        short += [f"{name}: {sentence}" for sentence in these.found_wrong()]
    if LATE in found:
        cost = enumerate(found[LATE].cost(found["calm"], AT_ONCE))
        short += [f"late fixes: error {k} over that on time: {i}" for k, i in cost if not i.reaches(1.1)]
    return short


@pytest.mark.slow
def test_trouble_is_told_and_errors_stay_inside_their_sigmas():
    """A few runs of each: bars of many runs are reached by intervals that are wide, and what is told must be told in each."""
    assert shortfalls(trials(conditions(rate=50.0), range(FEW), mission="trouble")) == []


def short(*faults, name="short", duration=60.0, **keywords):
    """A condition of a minute at 50 Hz."""
    recorder, aboard = dives(50.0, duration)["plain"]
    return Condition(name, recorder, aboard, faults, **keywords)


def test_trials_of_a_calm_sea_are_monte_carlo():
    condition = short()
    found = trials([condition], range(3))["short"]
    plain = monte_carlo(condition.recorder.trajectory, condition.vehicle, range(3), start=START, every=EVERY)
    assert np.array_equal(found.studies[FILTERED].error, plain.error)
    for sensor, groups in plain.groups.items():
        assert np.array_equal(groups.nis, found.studies[FILTERED].groups[sensor].nis)


def test_runs_are_paired_and_the_same_in_any_process():
    """A fault of one instrument leaves the noise of the others; conditions and processes may come in any order."""
    wild = short(WildFixes(sensor="usbl", fraction=0.5, low=50.0, high=60.0), name="wild")
    one, two = trials([short(), wild], (0, 1)), trials([wild, short()], (0, 1), processes=2)
    for name in ("short", "wild"):
        assert np.array_equal(one[name].studies[SMOOTHED].error, two[name].studies[SMOOTHED].error)
        assert one[name].seeds == tuple(seed_of("mission", run) for run in (0, 1))
    cost = one["wild"].cost(one["short"])
    assert all(i.estimate == 1.0 for i in one["short"].cost(one["short"]))
    assert max(i.estimate for i in cost) < 1.5  # the wild ones are turned away
    with pytest.raises(InputError, match="other seeds"):
        one["wild"].cost(trials([short()], (5,))["short"])


def test_what_is_known_at_once_lacks_what_has_not_arrived():
    condition = short(LateDelivery(sensor="usbl", low=4.0, high=4.0))
    log, aboard, times = condition.recorder.draw(1), condition.vehicle, np.arange(0.0, 60.0, 1.0)
    whole, on_time = solve(log, aboard, times=times), known_at_once(log, aboard, times)
    assert np.abs(whole.position_n - on_time.position_n).max() < 1e-7
    assert np.abs(on_time.sigma / whole.sigma - 1.0).max() < 1e-9
    late = known_at_once(troubled(log, condition.faults, 1), aboard, times)
    waiting = (times % 30.0) < 4.0  # fixes at 0 and 30 s
    assert np.all(late.sigma[waiting, 0] > 1.01 * whole.sigma[waiting, 0])
    assert np.abs(late.position_n - whole.position_n)[~waiting].max() < 1e-7


def synthetic(scale, runs=200, times=200, happened=()):
    """Trials of independent unit errors, `scale` times as large as stated, and smoothed ones half as large."""
    error = scale * np.random.default_rng(4).standard_normal((runs, times, 9))
    one = trials([short(duration=10.0)], (0,))["short"]
    inside = {FILTERED: np.mean(np.abs(error) < 3.0, axis=1), SMOOTHED: np.mean(np.abs(error) < 3.0, axis=1)}
    told = tuple((Happening("gated", "usbl", 0.0, 1.0, 1, "."),) if k in happened else () for k in range(runs))
    answers = tuple(Answer.CONSISTENT if k % 2 else Answer.INCONSISTENT for k in range(runs))
    condition = replace(one.condition, named=(("gated", "usbl"),))
    studies = {name: replace(one.studies[name], error=factor * error) for name, factor in ((FILTERED, 1.0), (SMOOTHED, 0.5))}
    return replace(one, condition=condition, studies=studies, inside=inside, answers=answers, happened=told, spared=(frozenset(),) * runs)


def test_bars_are_judged_by_their_intervals():
    right, wrong = synthetic(1.0), synthetic(1.3)
    expected = 2.0 * norm.cdf(3.0) - 1.0
    assert all(i.reaches(expected, at_least=expected) for i in right.within())
    assert not any(i.reaches(at_least=0.99) for i in wrong.within())
    assert all(i.estimate == pytest.approx(0.5) and i.reaches(1.0) for i in right.smoothing())
    worse = replace(right, studies={FILTERED: right.studies[SMOOTHED], SMOOTHED: right.studies[FILTERED]})
    assert not any(i.reaches(1.0) for i in worse.smoothing())
    assert right.rmse() == pytest.approx(1.0, abs=0.05)
    assert [i.estimate for i in wrong.cost(right)] == pytest.approx([1.3] * 9)
    assert right.answered().estimate == 0.5


def test_what_must_be_told_must_be_told_in_each_run():
    assert synthetic(1.0, happened=range(200)).untold() == []
    some = synthetic(1.0, happened=range(199))
    assert some.untold() == [("gated", "usbl")]
    assert some.telling("gated", "usbl").estimate == 0.995
    assert some.telling("gated", "dvl").estimate == 0.0
    assert [s for s in shortfalls({"it": some}) if "not told" in s] == ["it: not told: gated of usbl"]
    lucky = replace(some, spared=(*[frozenset()] * 199, frozenset({"usbl"})))
    assert lucky.untold() == []
    assert replace(some, spared=(frozenset({"usbl"}),) * 200).untold() == [("gated", "usbl")]


def test_a_run_that_a_fault_spares_is_known():
    """Of two fixes that are wild with a chance of 0.3, half of the runs have one."""
    condition = short(WildFixes(sensor="usbl", fraction=0.3, low=50.0, high=60.0), Outage(sensor="dvl", begin=40.0), duration=50.0)
    found = trials([condition], range(8))["short"]
    for seed, left, happened in zip(found.seeds, found.spared, found.happened, strict=True):
        wild = troubled(condition.recorder.draw(seed), condition.faults, seed)["usbl"].extra["outlier"]
        assert left == (frozenset() if wild.any() else frozenset({"usbl"}))
        assert any(h.sensor == "usbl" for h in happened) == bool(wild.any())
    assert 0 < sum(map(len, found.spared)) < 8


def test_shortfalls_find_an_overconfident_vehicle_file():
    """A vehicle file that takes the Doppler log for far better than it is: errors leave their sigmas, and the verdict names it."""
    condition = short(duration=120.0)
    text = ABOARD.format(rate=50.0, process="", beams="", second="").replace("sigma_mps = 0.01", "sigma_mps = 0.001")
    found = trials([replace(condition, vehicle=vehicle_from_toml(text))], range(6))["short"]
    assert any("dvl" in sentence for sentence in found.found_wrong())
    assert any("inside" in sentence for sentence in shortfalls({"short": found}))


def test_a_widened_gate_says_nothing_of_a_sigma():
    """Fixes off by 7 m that pass because the gate has widened in the half minute before are left out of what is pooled."""
    text = ABOARD.format(rate=50.0, process="", beams="", second="")
    wide = vehicle_from_toml(text.replace('kind = "position_fix"', 'kind = "position_fix"\ngate_widening_s = 10.0'))
    condition = replace(short(WildFixes(sensor="usbl", fraction=1.0, low=7.0, high=7.0, begin=10.0), duration=70.0), vehicle=wide)
    found = trials([condition], (0,))["short"]
    assert found.telling("widened", "usbl").estimate == 1.0
    assert found.studies[FILTERED].groups["usbl"].nis.max() < chi2.ppf(0.999, 2)
    narrow = trials([replace(condition, vehicle=vehicle_from_toml(text))], (0,))["short"]
    assert narrow.studies[FILTERED].groups["usbl"].outcome[1] == Outcome.GATED


def test_nonsense_is_refused():
    with pytest.raises(InputError, match="at least one run"):
        trials([short()], ())
    with pytest.raises(InputError, match="name of its own"):
        trials([short(), short()], (0,))


def rows(mission, runs, processes=2):
    """Yield the rows of the table of docs/accuracy.md for one set of seeds, and what falls short; "sailed": by a hull."""
    found = trials(conditions(trajectory=sailed() if mission == "sailed" else None), range(runs), mission=mission, processes=processes)
    for name, these in found.items():
        inside = " / ".join(f"{min(i.estimate for i in these.within(estimate)):.4f}" for estimate in (FILTERED, SMOOTHED))
        rmse, ratio = these.rmse(), [i.estimate for i in these.smoothing()]
        told = ", ".join(f"{kind} {sensor} {these.telling(kind, sensor).estimate:.2f}" for kind, sensor in these.condition.named)
        yield (
            f"| {name} | {inside} | {np.hypot(*rmse[:2]):.2f} | {np.hypot(*rmse[3:5]):.4f} | {np.degrees(rmse[8]):.3f} "
            f"| {min(ratio):.2f} to {max(ratio):.2f} | {these.answered().estimate:.2f} | {len(these.found_wrong())} | {told} |"
        )
    late = found[LATE].cost(found["calm"], AT_ONCE)
    yield "\nlate fixes over fixes on time, nine errors at once: " + ", ".join(f"{i.estimate:.3f} ({i})" for i in late)
    yield from (f"falls short: {sentence}" for sentence in shortfalls(found))


COLUMNS = (
    "condition", "least share inside 3 sigma, filtered / smoothed", "RMS horizontal m", "velocity m/s", "heading deg",
    "smoothed over filtered", "runs consistent", "pooled verdicts against", "told, share of runs",
)  # fmt: skip

if __name__ == "__main__":
    import sys

    count = int(sys.argv.pop(1)) if sys.argv[1:] and sys.argv[1].isdigit() else RUNS
    for seeds in sys.argv[1:] or ["trouble"]:
        print(f"seeds {seeds}\n\n| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
        for row in rows(seeds, count):
            print(row, flush=True)
