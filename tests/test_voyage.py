"""Voyages: routes are followed, currents stemmed, depths kept, the surface reached on schedule; what cannot be done is said."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from leadline.core.geodesy import from_north_east, north_east
from leadline.data.errors import InputError
from leadline.data.hull import hulls, read_hull
from leadline.data.records import Array
from leadline.sea.terrain import Chart, plane
from leadline.sea.water import Level, Water, Waves
from leadline.simulate import routes, sailing
from leadline.simulate.pilot import Pilot
from leadline.simulate.routes import Circle, Ell, Hold, Lawnmower, Plan, Polygon, Rotate, Sine, Spiral, Surfacing, Waypoints
from leadline.simulate.trajectory import Kinematics, Place, Trajectory, euler
from leadline.simulate.voyage import Voyage

PLACE = Place(radians(44.0), radians(9.8), surface_height=40.0)
SPEEDS = {"remus-100": 1.5, "typhoon": 0.6, "medusa": 0.6, "rexrov": 0.6, "yellowfin": 0.3}
DENSITY = {"yellowfin": 1000.0}  # ballasted for fresh water


def voyage(hull: str, plan: Plan, **kwargs: object) -> Voyage:
    place = kwargs.pop("place", PLACE)
    return Voyage(read_hull(hull), plan, place, density=DENSITY.get(hull, 1025.0), **kwargs)  # type: ignore[arg-type]


def seen(trajectory: Trajectory, step: float = 0.5) -> tuple[Kinematics, Array]:
    """What was done each half second, and where: north, east, depth."""
    state = trajectory.at(np.arange(0.0, trajectory.duration, step))
    return state, np.stack([*state.north_east, state.depth], axis=1)


def off(route: Array, places: Array) -> Array:
    """Distance of each place from the nearest point of a route."""
    best = np.full(len(places), np.inf)
    for a, b in zip(route[:-1, :2], route[1:, :2], strict=True):
        way = b - a
        square = way @ way
        share = np.clip((places[:, :2] - a) @ way / square, 0, 1) if square > 0 else np.zeros(len(places))
        best = np.minimum(best, np.linalg.norm(places[:, :2] - a - share[:, None] * way, axis=1))
    return best


@pytest.mark.parametrize("hull", hulls())
@pytest.mark.parametrize("water", [Water(), Water(shear=((0.0, 0.08, 0.1),))], ids=["still", "current"])
def test_a_lawnmower_is_followed_by_every_hull(hull: str, water: Water) -> None:
    """On the lines within a metre and a half for hulls that hover, two lengths for one that steers by fins; at depth within 0.6 m."""
    plan = Plan((Lawnmower(legs=3, length=80.0, spacing=20.0, speed=SPEEDS[hull], depth=6.0),), ascend=True)
    sailed = voyage(hull, plan, place=replace(PLACE, water=water))
    state, places = seen(sailed.run())
    assert sailed.ended == sailing.FINISHED
    under_way = places[:, 2] > 5.0
    length = sailed.hull.length
    inner = under_way & (places[:, 0] > 5 * length) & (places[:, 0] < 80.0 - 5 * length)  # off the turns
    wide = 1.5 if sailed.pilot.hovers else 2 * length
    assert np.percentile(off(sailed.route, places[inner]), 95) < wide
    settled = under_way & (state.time > 120.0) & (state.time < state.time[under_way][-1] - 30.0)
    assert np.abs(places[settled, 2] - 6.0).max() < 0.6
    speed = np.linalg.norm(state.velocity_n[inner & settled], axis=1)
    assert np.median(speed) == pytest.approx(SPEEDS[hull], rel=0.05)  # over ground, current or not


def test_the_whole_route_is_run_in_its_order() -> None:
    plan = Plan((Polygon(sides=3, length=60.0, laps=2, speed=0.6, depth=4.5),))
    sailed = voyage("typhoon", plan)
    _, places = seen(sailed.run())
    corners = sailed.route[1:, :2]
    lap = places[: len(places) // 2, :2]
    first = [int(np.argmin(np.linalg.norm(lap - corner, axis=1))) for corner in corners[:2]]
    assert first == sorted(first)
    for corner in corners:
        assert np.linalg.norm(places[:, :2] - corner, axis=1).min() < 2.0


def test_surfacing_keeps_its_schedule() -> None:
    plan = Plan((Polygon(sides=3, length=190.0, speed=0.6, depth=4.5),), surfacing=Surfacing(every=150.0, stay=10.0))
    state, places = seen(voyage("typhoon", plan).run(), 0.1)
    up = places[:, 2] < 0.4
    starts = state.time[1:][up[1:] & ~up[:-1]]
    ends = state.time[1:][~up[1:] & up[:-1]]
    assert len(starts) >= 4
    dives = ends[ends < starts[-1]]
    assert np.all(starts - dives[: len(starts)] > 150.0 - 10.0)  # the way down from the surface counts as part of the dive
    assert np.all(starts - dives[: len(starts)] < 150.0 + 40.0)  # and the way up takes 4.5 m at 0.25 m/s
    stays = ends[1:] - starts[: len(ends) - 1]
    assert np.all((stays > 10.0) & (stays < 25.0))


def test_the_ground_is_followed() -> None:
    bed = plane(20.0, 0.05, 0.0, (-100.0, 400.0, -100.0, 100.0), 10.0)
    plan = Plan((Waypoints(through=((250.0, 0.0),), speed=1.5, altitude=8.0),))
    state, places = seen(voyage("remus-100", plan, chart=bed).run())
    altitude = 20.0 + 0.05 * places[:, 0] - places[:, 2]
    assert np.abs(altitude[state.time > 90.0] - 8.0).max() < 1.0  # the bed falls by 7.5 cm a second


def test_a_vehicle_that_hovers_stays_and_turns_on_the_spot() -> None:
    legs = (
        Hold(seconds=60.0, speed=0.3, depth=3.0), Rotate(seconds=90.0, angle=2 * np.pi, speed=0.3, depth=3.0),
        Hold(seconds=30.0, speed=0.3, depth=3.0),
    )  # fmt: skip
    place = replace(PLACE, water=Water(shear=((0.0, 0.1, 0.05),)))
    state, places = seen(voyage("rexrov", Plan(legs), place=place).run())
    assert np.linalg.norm(places[state.time > 30.0, :2], axis=1).max() < 0.5
    heading = np.unwrap(euler(state.rotation_nb)[2])
    assert heading[-1] - heading[0] == pytest.approx(2 * np.pi, abs=0.05)
    turning = (state.time > 75.0) & (state.time < 140.0)
    assert np.polyfit(state.time[turning], heading[turning], 1)[0] == pytest.approx(2 * np.pi / 90.0, rel=0.05)


def test_a_fixed_heading_is_held_along_the_way() -> None:
    plan = Plan((Waypoints(through=((30.0, 0.0), (0.0, 30.0)), heading=0.5, speed=0.4, depth=3.0),))
    state, places = seen(voyage("rexrov", plan).run())
    heading = np.unwrap(euler(state.rotation_nb)[2])
    assert np.abs(np.sin(heading[state.time > 20.0] - 0.5)).max() < 0.1
    assert np.cos(heading[-1] - 0.5) > 0.9
    assert off(voyage("rexrov", plan).route, places).max() < 1.0


@pytest.mark.parametrize(
    "leg",
    [Circle(radius=25.0, turns=1.5, speed=0.6, depth=5.0), Sine(length=120.0, amplitude=8.0, wavelength=60.0, speed=0.6, depth=5.0),
     Ell(length=50.0, width=25.0, speed=0.6, depth=5.0), Spiral(radius=15.0, turns=2.0, depth=12.0, end_depth=2.0, speed=0.6)],
    ids=lambda leg: leg.name,
)  # fmt: skip
def test_shapes_are_followed(leg: routes.Leg) -> None:
    sailed = voyage("rexrov", Plan((leg,)))
    state, places = seen(sailed.run())
    assert sailed.ended == sailing.FINISHED
    assert off(sailed.route, places).max() < 2.0  # at a corner that is not cut, half a lookahead
    if isinstance(leg, Spiral):  # up at the slope of the helix, once it is down
        late = state.time > 80.0
        assert np.polyfit(state.time[late], places[late, 2], 1)[0] == pytest.approx(-10.0 / (2 * 2 * np.pi * 15.0 / 0.6), rel=0.15)


def test_chords_lie_near_their_curve() -> None:
    circle = np.array(Circle(radius=25.0, turns=2.0, speed=1.0, depth=1.0).points((0.0, 0.0)))
    ends = np.vstack([[0.0, 0.0], circle])
    middles = 0.5 * (ends[1:] + ends[:-1])
    assert np.abs(np.hypot(middles[:, 0], middles[:, 1] - 25.0) - 25.0).max() <= routes.CHORD * 1.01
    assert circle[-1] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_bearings_turn_shapes_and_starboard_is_to_the_right() -> None:
    first, second = Lawnmower(legs=2, length=10.0, spacing=4.0, square=True, bearing=np.pi / 2, speed=1.0, depth=1.0).points((0.0, 0.0))[:2]
    assert first == pytest.approx((0.0, 10.0), abs=1e-12)  # along the bearing: east
    assert second == pytest.approx((-4.0, 10.0), abs=1e-12)  # to starboard of it: south
    corners = np.array(Polygon(sides=4, length=5.0, speed=1.0, depth=1.0).points((1.0, 1.0)))
    assert corners == pytest.approx(np.array([[6.0, 1.0], [6.0, 6.0], [1.0, 6.0], [1.0, 1.0]]))
    port = Circle(radius=-3.0, turns=0.25, speed=1.0, depth=1.0).points((0.0, 0.0))[-1]
    assert port == pytest.approx((3.0, -3.0))


def test_a_voyage_starts_where_the_plan_says_far_from_the_origin() -> None:
    place = Place(radians(-60.0), radians(179.99), surface_height=10.0)  # its start lies across the date line
    plan = Plan((Waypoints(through=((3100.0, 4000.0),), speed=1.5, depth=2.0),), start=(3000.0, 4000.0))
    trajectory = voyage("remus-100", plan, place=place, depth=1.0, heading=0.3, limit=5.0).run()
    state = trajectory.at(0.0)
    latitude, longitude = from_north_east(3000.0, 4000.0, place.latitude, place.longitude)
    before = trajectory.at(np.array([-0.9]))  # the motion begins a second before
    gone = np.array(north_east(*before.geodetic[:2], float(latitude), float(longitude))).ravel()
    assert np.abs(gone).max() < 0.05
    assert float(before.depth[0]) == pytest.approx(1.0, abs=0.05)
    assert float(euler(before.rotation_nb)[2][0]) == pytest.approx(0.3, abs=1e-3)
    assert state.geodetic[1][0] < 0.0


def test_the_pilot_sees_what_truth_says() -> None:
    """`look`, compiled, against the kinematics in NumPy, far from the origin of the tangent frame and with a tide."""
    place = replace(PLACE, water=Water(levels=(Level(1.5),)))
    plan = Plan((Waypoints(through=((8200.0, -9000.0),), speed=0.6, depth=5.0),), start=(8000.0, -9000.0))
    sailed = voyage("rexrov", plan, place=place, depth=2.0, limit=20.0)
    sailed.tick(151)
    nav = sailed.state[:14].copy()
    state = sailed.trajectory().at(nav[0])
    roll, pitch, heading = (float(a[0]) for a in euler(state.rotation_nb))
    assert nav[1:3] == pytest.approx([float(v[0]) for v in state.north_east], abs=2e-5)  # the series of the meridian is cut shorter here
    assert nav[3] == pytest.approx(float(state.depth[0]), abs=1e-8)
    assert nav[5:8] == pytest.approx([roll, pitch, (heading + np.pi) % (2 * np.pi) - np.pi], abs=1e-12)
    assert nav[8:11] == pytest.approx(state.velocity_n[0], abs=1e-12)
    assert nav[11:14] == pytest.approx(state.rate_eb_b[0], abs=1e-12)


def test_thrusters_give_what_is_asked() -> None:
    """Pseudo-inverse: forces along the axes of a hull come back, others stay zero among those axes."""
    for name in hulls():
        pilot = Pilot(read_hull(name))
        for axis in pilot.axes:
            found = pilot.columns @ pilot.shares[:, axis]
            assert found[list(pilot.axes)] == pytest.approx([float(axis == other) for other in pilot.axes], abs=1e-12)


def test_the_same_voyage_twice_is_the_same_to_the_bit_however_it_is_cut() -> None:
    plan = Plan((Lawnmower(legs=2, length=40.0, spacing=15.0, speed=1.5, depth=5.0),))
    place = replace(PLACE, water=Water(shear=((0.0, 0.1, 0.0),), waves=Waves(0.3, 5.0)))
    whole, pieces = voyage("remus-100", plan, place=place), voyage("remus-100", plan, place=place)
    whole.run()
    while pieces.tick(7):
        pass
    assert np.array_equal(np.concatenate(whole.knots)[: pieces.ticks], np.concatenate(pieces.knots)[: pieces.ticks])


REFUSED = {
    "too fast": ("remus-100", Waypoints(through=((50.0, 0.0),), speed=4.0, depth=3.0), r"asks for 4.0 m/s, and REMUS 100 makes 2\.\d+ m/s"),
    "cannot stay": ("remus-100", Hold(seconds=10.0, speed=1.0, depth=3.0), "'hold' asks REMUS 100 to stay in one place"),
    "too deep": (
        "typhoon",
        Waypoints(through=((50.0, 0.0),), speed=0.5, depth=25.0),
        "leads to 25 m at north 0 m, east 0 m, where the ground lies at 20.0 m",
    ),
    "off the chart": ("typhoon", Waypoints(through=((5000.0, 0.0),), speed=0.5, altitude=5.0), "the chart knows none"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_hull_cannot_do_is_refused_in_a_sentence(case: str) -> None:
    hull, leg, said = REFUSED[case]
    bed = plane(20.0, 0.0, 0.0, (-200.0, 200.0, -200.0, 200.0), 20.0)
    with pytest.raises(InputError, match=said) as error:
        voyage(hull, Plan((leg,)), chart=bed)
    assert "\n" not in str(error.value)


def test_a_vehicle_that_steers_by_fins_cannot_stop_for_satellites() -> None:
    plan = Plan((Waypoints(through=((50.0, 0.0),), speed=1.5, depth=3.0),), surfacing=Surfacing(60.0, 10.0, stop=True))
    with pytest.raises(InputError, match="must keep moving"):
        voyage("remus-100", plan)


def test_a_current_that_cannot_be_stemmed_ends_in_a_sentence() -> None:
    place = replace(PLACE, water=Water(shear=((0.0, -3.0, 0.0),)))
    with pytest.raises(InputError, match="has not got on for 300 s; a current that it can stem") as error:
        voyage("medusa", Plan((Waypoints(through=((100.0, 0.0),), speed=0.6, depth=3.0),)), place=place).run()
    assert "in leg 1" in str(error.value)
    assert "nan" not in str(error.value).lower()


def test_running_aground_ends_in_a_sentence() -> None:
    wall = Chart(-100.0, -100.0, 10.0, 10.0, np.where(np.arange(31)[:, None] > 14, 4.0, 20.0) * np.ones((31, 21)))  # 16 m up within 10 m
    plan = Plan((Waypoints(through=((100.0, 0.0),), speed=1.5, altitude=3.0),))
    with pytest.raises(InputError, match="ran aground; plan less depth or more altitude there"):
        voyage("remus-100", plan, chart=wall).run()


def test_a_depth_out_of_reach_ends_in_a_sentence() -> None:
    plan = Plan((Waypoints(through=((1000.0, 0.0),), speed=0.5, depth=12.0),))
    with pytest.raises(InputError, match="off its depth by more than 3 m for 300 s"):
        Voyage(read_hull("yellowfin"), plan, PLACE, density=1300.0).run()  # it floats with more than its thrusters push


@pytest.mark.parametrize(
    "leg",
    [Waypoints(through=((0.0, 0.0),), speed=0.5, depth=2.0), Circle(radius=1.0, turns=1e-9, speed=0.5, depth=2.0)],
    ids=["where it is", "hardly a turn"],
)
def test_a_route_of_one_point_ends(leg: routes.Leg) -> None:
    assert len(Plan((leg,)).route) >= 2  # the kernels look at the row before
    sailed = voyage("rexrov", Plan((leg,)))
    sailed.run()
    assert sailed.ended == sailing.FINISHED
    assert sailed.time < 60.0


def test_a_circle_is_no_point() -> None:
    with pytest.raises(InputError, match="radius of 0"):
        Circle(radius=0.0, speed=0.5, depth=2.0)


@pytest.mark.parametrize("hull", ["remus-100", "medusa", "rexrov", "typhoon"])
def test_a_long_way_up_is_no_failure(hull: str) -> None:
    """From 150 m: five to seventeen minutes of ascent, in which nothing moves on along the route."""
    ahead = Waypoints(through=((60.0, 0.0),), speed=SPEEDS[hull], depth=150.0)
    sailed = voyage(hull, Plan((ahead,), ascend=True), depth=150.0, speed=SPEEDS[hull])
    _, places = seen(sailed.run(), 5.0)
    assert sailed.ended == sailing.FINISHED
    assert places[-1, 2] < sailed.hull.height + 5.0 * 0.3  # up to five seconds before the end


def test_a_deep_dive_is_no_failure() -> None:
    sailed = voyage("typhoon", Plan((Waypoints(through=((500.0, 0.0), (0.0, 0.0)), speed=0.8, depth=100.0),)))
    _, places = seen(sailed.run(), 5.0)
    assert sailed.ended == sailing.FINISHED
    assert places[-1, 2] == pytest.approx(100.0, abs=1.0)


def test_a_stay_begins_at_its_depth() -> None:
    sailed = voyage("rexrov", Plan((Hold(seconds=20.0, speed=0.3, depth=20.0),)))
    state, places = seen(sailed.run(), 0.5)
    deep = np.abs(places[:, 2] - 20.0) < 0.6
    assert np.sum(deep) * 0.5 == pytest.approx(20.0, abs=4.0)
    assert state.time[-1] > 80.0  # and 20 m at a quarter of a metre a second before it


def test_the_last_point_is_reached_at_its_depth() -> None:
    sailed = voyage("typhoon", Plan((Waypoints(through=((10.0, 0.0),), speed=0.5, depth=12.0),)))
    _, places = seen(sailed.run(), 0.5)
    assert places[-1, 2] == pytest.approx(12.0, abs=0.8)
    assert np.linalg.norm(places[-1, :2] - [10.0, 0.0]) < 3.0


NOWHERE = {
    "no ground": (
        Waypoints(through=((50.0, 0.0),), speed=0.5, altitude=5.0),
        {},
        r"follows the ground \(altitude_m\), and the sea has none",
    ),
    "in the air": (Waypoints(through=((50.0, 0.0),), speed=0.5, depth=5.0), {"depth": -50.0}, "lies 50 m above the surface"),
    "for ever": (Waypoints(through=((9e6, 0.0),), speed=0.5, depth=5.0), {}, r"takes 5000 h; a shorter one, or duration_s"),
}


@pytest.mark.parametrize("case", NOWHERE)
def test_plans_that_make_no_sense_are_refused(case: str) -> None:
    leg, start, said = NOWHERE[case]
    with pytest.raises(InputError, match=said):
        voyage("rexrov", Plan((leg,)), **start)


def test_depths_are_not_negative() -> None:
    with pytest.raises(InputError, match="depth of -3"):
        Waypoints(through=((50.0, 0.0),), speed=0.5, depth=-3.0)


@pytest.mark.parametrize("hull", hulls())
def test_a_voyage_starts_at_time_zero_as_it_is_told(hull: str) -> None:
    """At 0 s it is at its start at its speed, its thrusters turning; before, it came straight; it does not fall back by much."""
    plan = Plan((Waypoints(through=((200.0, 0.0),), speed=SPEEDS[hull], depth=5.0),), start=(10.0, 0.0))
    trajectory = voyage(hull, plan, depth=5.0, speed=SPEEDS[hull], limit=20.0).run()
    state = trajectory.at(np.array([-0.5, 0.0]))
    assert np.stack(state.north_east, axis=1) == pytest.approx(
        np.array([[10.0 - 0.5 * SPEEDS[hull], 0.0], [10.0, 0.0]]), abs=1e-5
    )  # metres at depth are longer at the surface
    assert state.velocity_b == pytest.approx(np.tile([SPEEDS[hull], 0.0, 0.0], (2, 1)), abs=1e-6)
    speeds = trajectory.at(np.arange(0.0, 20.0, 0.5)).velocity_b[:, 0]
    assert speeds.min() > 0.8 * SPEEDS[hull]
