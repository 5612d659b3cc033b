"""Hull files: what comes with Leadline is sound and says where it is from; what is wrong in one is refused in one line."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from leadline.data import hull as layout
from leadline.data.errors import InputError
from leadline.data.hull import FOLDER, Hull, hull_from_toml, hulls, read_hull

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("medusa", "remus-100", "rexrov", "typhoon", "yellowfin")
TEXT = (FOLDER / "remus-100.toml").read_text("utf-8")


def test_the_hulls_that_come_along() -> None:
    assert hulls() == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_hull_is_a_body_that_floats_upright_and_nearly_neutral(name: str) -> None:
    hull = read_hull(name)
    assert np.all(np.linalg.eigvalsh(hull.rigid_mass + hull.added_mass) > 0)
    metacentric = hull.gravity_centre_b - hull.buoyancy_centre_b
    assert np.all(metacentric[:2] == 0)
    assert metacentric[2] > 0, "what nothing drives must right itself"
    density = 1000.0 if name == "yellowfin" else 1025.0  # a pool, or the sea
    assert 0 < hull.volume * density / hull.mass - 1 < 0.02
    inertia = np.linalg.eigvalsh(hull.inertia_b)
    assert inertia[2] <= inertia[0] + inertia[1], "moments of inertia of a body fulfil the triangle inequality"
    for thruster in hull.thrusters:
        assert np.linalg.norm(thruster.direction_b) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_every_number_says_where_it_comes_from(name: str) -> None:
    origins = read_hull(name).origins
    entries = len(re.findall(r"^\[", (FOLDER / f"{name}.toml").read_text("utf-8"), re.MULTILINE))
    assert len(origins) == entries
    for place, origin in origins.items():
        published = re.search(r"\b(19|20)\d\d\b|Allotta et al\.|MSS toolbox", origin)
        assert origin.startswith("estimated: ") or published, f"{place}: {origin}"


@pytest.mark.parametrize("name", NAMES)
def test_lift_and_drag_take_energy_at_every_velocity(name: str) -> None:
    """nu . (damping + terms) <= 0: a body with thrusters at rest cannot be pushed by still water."""
    hull = read_hull(name)
    nu = np.random.default_rng(5).standard_normal((20000, 6)) * np.array([2, 1, 1, 1, 1, 1])
    power = -np.einsum("ni,ij,nj->n", nu, hull.linear_damping, nu) - np.abs(nu) ** 3 @ hull.quadratic_damping
    for term in hull.terms:
        first = np.abs(nu[:, term.first]) if term.bare else nu[:, term.first]
        power += nu[:, term.force] * term.coefficient * first * nu[:, term.second]
    assert power.max() < 0


def test_the_flat_array_holds_the_hull() -> None:
    hull = read_hull("remus-100")
    p = hull.parameters
    assert p[layout.MASS] == 30.48
    assert p[layout.GRAVITY_AT + 2] == 0.0196
    inverse = p[layout.INVERSE : layout.LINEAR].reshape(6, 6)
    np.testing.assert_allclose(inverse @ (hull.rigid_mass + hull.added_mass), np.eye(6), atol=1e-13)
    np.testing.assert_array_equal(p[layout.ADDED : layout.INVERSE].reshape(6, 6), hull.added_mass)
    rows = layout.THRUSTER_ROW * p[layout.THRUSTERS] + layout.FIN_ROW * p[layout.FINS] + layout.TERM_ROW * p[layout.TERMS]
    assert len(p) == layout.ROWS_AT + rows
    assert hull.actuators == ("propeller", "rudder", "stern planes")
    assert hull.fins[0].most == pytest.approx(np.pi / 9, rel=1e-15)


def test_yellowfin_has_four_thrusters_at_half_a_right_angle_and_three_vertical() -> None:
    directions = np.array([thruster.direction_b for thruster in read_hull("yellowfin").thrusters])
    np.testing.assert_allclose(np.abs(directions[:4]), np.tile([np.sqrt(0.5), np.sqrt(0.5), 0.0], (4, 1)), atol=1e-12)
    np.testing.assert_array_equal(directions[4:], np.tile([0.0, 0.0, 1.0], (3, 1)))
    places = np.array([thruster.position_b for thruster in read_hull("yellowfin").thrusters])
    assert np.sum(places[4:, 0] > 0) == 2


@pytest.mark.parametrize(
    ("name", "axes"), [("yellowfin", 6), ("rexrov", 6), ("medusa", 5), ("typhoon", 5)], ids=["yellowfin", "rexrov", "medusa", "typhoon"]
)
def test_thrusters_reach_the_axes_that_are_published(name: str, axes: int) -> None:
    """Six for YellowFin and RexROV; five for Typhoon, whose roll is passive; MEDUSA's two vertical ones roll it with the heave."""
    rows = [np.concatenate([t.direction_b, np.cross(t.position_b, t.direction_b)]) for t in read_hull(name).thrusters]
    assert np.linalg.matrix_rank(np.array(rows), tol=1e-6) == axes


def edited(old: str, new: str) -> str:
    assert old in TEXT
    return TEXT.replace(old, new, 1)


SOURCE = '"Prestero, 2001 (weight 299 N); Hall and Anstee, 2011"'
WRONG = {
    "unknown key": (edited("value_kg = 30.48", "value_kgs = 30.48"), r"mass: unknown key 'value_kgs' \(30.48\); did you mean 'value_kg'\?"),
    "unknown table": (edited("[mass]", "[maas]"), r"unknown key 'maas' .*did you mean 'mass'\?"),
    "no source": (edited(f"source = {SOURCE}\n", ""), r"mass: does not say where its numbers come from; give source"),
    "two sources": (edited(f"source = {SOURCE}\n", f'source = {SOURCE}\nestimated = "so"\n'), "mass: has both 'source' and 'estimated'"),
    "empty source": (edited(SOURCE, '" "'), "mass.source: ' '; a text in quotes"),
    "no table": (edited("[quadratic_damping]", "[linear_damping]"), r"has no 'quadratic_damping'; add a table \[quadratic_damping\]"),
    "no value": (edited("value_kg = 30.48\n", ""), "mass: has no 'value_kg'"),
    "text": (edited("value_kg = 30.48", 'value_kg = "30"'), "mass.value_kg: '30'; a number"),
    "true": (edited("value_kg = 30.48", "value_kg = true"), "mass.value_kg: True; a number"),
    "zero": (edited("value_kg = 30.48", "value_kg = 0.0"), "mass.value_kg: 0.0; above 0"),
    "nan": (edited("value_kg = 30.48", "value_kg = nan"), "mass.value_kg: nan; a number"),
    "shape": (edited("[0.0, 0.0, 0.0196]", "[0.0, 0.0196]"), "gravity_centre.position_m: .*; 3 numbers"),
    "ragged": (edited("[0.0, 0.0, 0.0, 0.0704, 0.0, 0.0]", "[0.0]"), "added_mass.matrix: .*; 6 x 6 numbers"),
    "negative drag": (edited("[1.62,", "[-1.62,"), "quadratic_damping.diagonal: .*; 0 or more"),
    "asymmetric": (edited("35.5, 0.0, 0.0, 0.0, -1.93]", "35.5, 0.0, 0.0, 0.0, 1.93]"), "added_mass: is not symmetric"),
    "indefinite": (edited("[0.93, 0.0", "[-40.0, 0.0"), "added_mass: its matrix has the eigenvalue -40"),
    "no body": (edited("0.0, 0.0196]", "0.0, 0.9]"), "mass and inertia: its matrix has the eigenvalue .*; one that is positive definite"),
    "product": (edited('"|u|v"', '"uvw"'), r"terms\[0\].of: 'uvw' is no product of two velocities"),
    "force": (edited('force = "Y"', 'force = "T"'), r"terms\[0\].force: 'T' is not known"),
    "propeller": (edited('propeller = "main"', 'propeller = "mian"'), "'mian' is not known; did you mean 'main'"),
    "direction": (edited("direction = [1.0,", "direction = [2.0,"), "has the length 2; a direction of length 1"),
    "kind": (edited('kind = "rudder"', 'kind = "rudders"'), "'rudders' is not known; did you mean 'rudder'"),
    "toml": ("name = ", "is not TOML"),
}


@pytest.mark.parametrize(("text", "message"), list(WRONG.values()), ids=list(WRONG))
def test_what_is_wrong_is_said_in_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        hull_from_toml(text)
    assert "\n" not in str(caught.value)


def test_a_hull_can_be_read_from_a_path(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(TEXT.replace("max_deg = 20.0", "max_rad = 0.3"), "utf-8")
    assert read_hull(tmp_path / "mine.toml").fins[0].most == 0.3
    with pytest.raises(InputError, match="remus100: is no hull that can be read; did you mean 'remus-100'"):
        read_hull("remus100")


def test_a_hull_that_is_changed_is_checked_again() -> None:
    hull = read_hull("remus-100")
    assert isinstance(replace(hull, mass=40.0), Hull)
    with pytest.raises(InputError, match="linear_damping"):
        replace(hull, linear_damping=-np.eye(6))
