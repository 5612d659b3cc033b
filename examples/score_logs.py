"""Solve several logs with one vehicle file and print their errors against truth as a table.

python examples/score_logs.py --vehicle examples/snapir.toml LOG [LOG ...]
"""

from __future__ import annotations

import argparse

import numpy as np

import leadline
from leadline.assess.errors import errors_of


def score(path: str, vehicle: leadline.Vehicle) -> list[float]:
    """Return distance, horizontal RMS, error at the end (m and % of distance), its sigma, velocity RMS (m/s), heading RMS (deg)."""
    log = leadline.read_log(path)
    solution = leadline.solve(log, vehicle)
    if log.truth is None:
        raise leadline.InputError(path, "has no truth", "give logs that have one")
    errors = errors_of(solution, log.truth)
    end = float(errors.horizontal[-1])
    velocity = np.sqrt(np.nanmean(np.sum(errors.error[:, 3:5] ** 2, axis=1)))
    heading = np.degrees(np.sqrt(np.nanmean(errors.error[:, 8] ** 2)))
    sigma = float(np.hypot(*solution.sigma[-1, :2]))
    rms = float(np.sqrt(np.mean(errors.horizontal**2)))
    return [errors.distance, rms, end, 100 * end / errors.distance, sigma, velocity, heading]


def main() -> None:
    """Print the table, with the median of each column."""
    parser = argparse.ArgumentParser(description="Errors of several logs against their truth.")
    parser.add_argument("--vehicle", required=True)
    parser.add_argument("logs", nargs="+")
    arguments = parser.parse_args()
    vehicle = leadline.read_vehicle(arguments.vehicle)
    rows = {leadline.read_log(path).name: score(path, vehicle) for path in arguments.logs}
    rows["median"] = np.median(list(rows.values()), axis=0).tolist()
    print("| log | distance m | RMS m | end m | end % | sigma at end m | velocity m/s | heading deg |\n|---|---|---|---|---|---|---|---|")
    for name, (distance, rms, end, percent, sigma, velocity, heading) in rows.items():
        print(f"| {name} | {distance:.0f} | {rms:.2f} | {end:.2f} | {percent:.2f} | {sigma:.2f} | {velocity:.4f} | {heading:.3f} |")


if __name__ == "__main__":
    main()
