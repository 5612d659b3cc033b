"""What a Doppler log makes of single beams that are weak, of numbers of beams that do not agree, and of a bias that no row could see."""

import numpy as np
import pytest

from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.records import Dvl
from leadline.data.vehicle import vehicle_from_toml
from leadline.models.sensor import Context
from leadline.models.sensors import compose

FOUR = "beam_azimuth_deg = [45.0, 135.0, 225.0, 315.0]\nbeam_tilt_deg = 30.0\n"
FIVE = "beam_azimuth_deg = [45.0, 135.0, 225.0, 315.0, 0.0]\nbeam_tilt_deg = 30.0\n"
BEAMS = 'use = "beams"\n' + FOUR
BIAS = "nuisance.beam_bias = { sigma_mps = 0.01 }\n"


def sensor(more):
    text = 'name = "v"\n[process]\nmodel = "cruise"\n[sensors.dvl]\nsigma_mps = 0.01\n' + more
    return compose(vehicle_from_toml(text)["dvl"], Context())


def test_a_vector_needs_three_sound_beams():
    """With no correlation known a beam is taken as sound; with a limit and two beams below it the vector cannot be what it says."""
    correlation = [[90.0, 90.0, 90.0, 90.0], [90.0, 90.0, 90.0, 10.0], [90.0, 90.0, 10.0, 10.0], [np.nan, np.nan, np.nan, 10.0]]
    table = Dvl(time=np.arange(4.0), velocity=np.zeros((4, 3)), beam_correlation=correlation)
    used, invalid = Outcome.USED, Outcome.INVALID
    assert sensor("correlation_min = 50.0\n").read(table).outcome.tolist() == [used, used, invalid, used]
    assert sensor("").read(table).outcome.tolist() == [used] * 4


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"beam_correlation": np.ones((2, 3))}, "has 4 beams; its columns of validity or correlation are of 3"),
        ({"beam_valid": np.ones((2, 3))}, "has 4 beams; its columns of validity or correlation are of 3"),
        ({"beam_valid": np.ones((2, 4)), "beam_correlation": np.ones((2, 3))}, "validity and correlation of 4 and 3 beams"),
    ],
)
def test_columns_of_another_number_of_beams_are_refused_in_a_line(columns, words):
    table = Dvl(time=[0.0, 1.0], beam=np.zeros((2, 4)), **columns)
    with pytest.raises(InputError, match=words) as caught:
        sensor(BEAMS + "correlation_min = 0.5\n").read(table)
    assert str(caught.value).startswith("sensors.dvl")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (BIAS, "use is 'velocity'; set use = \"beams\""),
        (FOUR + BIAS, "use is 'velocity'; set use = \"beams\""),
        ('use = "beams"\n' + FIVE + BIAS, "is of 5 beams; at most 4"),
    ],
)
def test_a_bias_that_no_row_could_see_is_refused_in_a_line(more, words):
    with pytest.raises(InputError, match=words) as caught:
        sensor(more)
    assert str(caught.value).startswith("sensors.dvl.nuisance.beam_bias")


def test_the_bias_of_a_beam_belongs_to_its_own_channel_alone():
    channels = sensor(BEAMS + "nuisance.beam_bias = { sigma_mps = [0.01, 0.02, 0.03, 0.04] }\n").channels
    states = [[(n.name, n.sigma) for n in channel.nuisances if n.sigma > 0.0] for channel in channels]
    assert states == [[]] * 4 + [[(f"dvl.beam_bias{i}", pytest.approx(0.01 * i))] for i in (1, 2, 3, 4)]


@pytest.mark.parametrize("keys", ["declination_deg = 3.0", 'declination = "wmm"', 'reference = "true"\ndeclination_deg = -3.0'])
def test_a_declination_of_true_headings_is_refused(keys):
    text = f'name = "v"\n[process]\nmodel = "cruise"\n[sensors.heading]\nsigma_deg = 1.0\n{keys}\n'
    with pytest.raises(InputError, match="has a declination, and its reference is 'true'"):
        vehicle_from_toml(text)
