"""Two starts that no Gaussian describes: a beacon's ranges from nearby, and a heading of which little is known.

    python studies/hard_starts.py [--runs 50] [--first 0] [--processes 2] [--json]

Per estimator: errors once the way has told (the second minute), NEES of position, times inside 3 sigma, and the verdict of all runs.
"""

from __future__ import annotations

import argparse
import json
from math import radians, sqrt

import numpy as np

from leadline.assess.intervals import interval_of_mean
from leadline.data.log import Beacon
from leadline.data.vehicle import vehicle_from_toml
from leadline.formats.solution import plain
from leadline.missions.cell_maker import Case
from leadline.missions.study import study
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.instruments import AcousticRange, Depth, Dvl, Heading, PositionFix, YawRate
from leadline.simulate.plans import Place, Weave, circle, driven
from leadline.simulate.profiles import Ramp, Steps

PLACE = Place(radians(45.0), radians(10.0), depth=10.0)
SWAYING = Weave((0.03, 6.1), (0.015, 7.3), (0.02, 23.0))
GYRO = 0.3  # degrees per root of an hour
VEHICLE = """
name = "{name}"
[process]
model = "cruise"
[process.cruise]
surge_noise_mps_per_rts = 0.3
pitch_noise_degps_per_rts = 0.22
turn_noise_degps_per_rts = 0.5
sigma_roll_deg = 1.0
sigma_rate_degps = 1.3
[sensors]
dvl = {{ sigma_mps = 0.02 }}
depth = {{ sigma_m = 0.05 }}
yaw_rate = {{ noise_deg_per_rth = {gyro}, rate_hz = 10.0 }}
{own}
"""
RANGES = 'heading = { sigma_deg = 0.5 }\nranges = { kind = "acoustic_range", sigma_m = 0.5 }'
FIXES = 'fix = { kind = "position_fix", sigma_m = 1.0, vertical = false }'
ESTIMATORS = ("ekf", "ukf", "ckf", "srukf", "pf")


def cases() -> dict[str, Case]:
    """Return the two: where the position is known to 20 m, 30 m from a beacon, and where the heading is known to 60 degrees."""
    common = {
        "dvl": Dvl(rate=2.0, sigma=0.02),
        "depth": Depth(rate=2.0, sigma=0.05),
        "yaw_rate": YawRate(rate=10.0, sigma=radians(GYRO) / 60.0 * sqrt(10.0)),
    }
    beacons = {"beacon": Beacon(north=25.0, east=15.0, depth=10.0)}
    ranging = {
        "heading": Heading(rate=2.0, sigma=radians(0.5)),
        "ranges": AcousticRange(rate=0.2, beacons=beacons, sigma=0.5 / 1500.0, path="one_way"),
    }
    round_about = circle(PLACE, 120.0, speed=1.0, radius=40.0, weave=SWAYING)
    from_rest = driven(
        PLACE, 120.0, forward=Steps((2.0,), (5.0,), (0.0, 1.0)), heading=Ramp(0.3, 0.02), pitch=Ramp(), weave=SWAYING
    )  # a vehicle under way would tell its heading by its velocity
    return {
        "ranges": Case(
            Recorder(round_about, {**common, **ranging}, truth_rate=0.2, start=StartSigmas(position=20.0), name="hard-ranges"),
            vehicle_from_toml(VEHICLE.format(name="ranges", gyro=GYRO, own=RANGES)),
        ),
        "heading": Case(
            Recorder(
                from_rest, {**common, "fix": PositionFix(rate=0.2, sigma=1.0)}, truth_rate=0.2,
                start=StartSigmas(position=1.0, heading=radians(60.0)), name="hard-heading",
            ),
            vehicle_from_toml(VEHICLE.format(name="heading", gyro=GYRO, own=FIXES)),
        ),
    }  # fmt: skip


def main() -> None:
    """Run both and print what became of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--estimators", nargs="*", default=ESTIMATORS)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    runs = range(given.first, given.first + given.runs)
    found = study(cases(), given.estimators, runs, every=5.0, bound=False, processes=given.processes)
    told = []
    for mission, name in found.summaries:
        one = found.study(mission, name)
        late, position = one.error[:, 12:], one.whitened["position"]
        nees = interval_of_mean(np.mean(np.sum(position**2, axis=2), axis=1) / position.shape[2])
        sigma = np.abs(one.whitened["all"])
        told.append({
            "case": mission, "estimator": name, "runs": len(one.seeds),
            "horizontal_m": float(np.sqrt(np.mean(np.sum(late[:, :, :2] ** 2, axis=2)))),
            "heading_rad": float(np.sqrt(np.mean(late[:, :, 8] ** 2))),
            "position_nees_per_dof": [nees.estimate, nees.low, nees.high],
            "whitened_below_3": float(np.mean(sigma < 3.0)),
            "consistent": found.summaries[mission, name].statistics["consistent"].estimate,
            "verdicts_against": [v.sentence for v in one.verdicts() if v.answer.value == "not consistent"],
        })  # fmt: skip
    if given.json:
        print(json.dumps(plain(told), indent=2))
        return
    for row in told:
        low, high = row["position_nees_per_dof"][1:]
        against = row["verdicts_against"]
        print(f"{row['case']:8} {row['estimator']:6} horizontal {row['horizontal_m']:8.3f} m  heading {row['heading_rad']:.4f} rad  "
              f"NEES {low:.2f} to {high:.2f}  consistent by itself {row['consistent']:.2f}  "
              f"{'not consistent: ' + '; '.join(against) if against else 'nothing against it'}")  # fmt: skip


if __name__ == "__main__":
    main()
