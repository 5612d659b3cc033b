"""Simulate runs of a mission, solve each, and hold the errors against the sigmas that the filter states.

python examples/simulate.py MISSION [RUNS]
"""

from __future__ import annotations

import sys

import leadline
from leadline.missions.mission import read_mission
from leadline.missions.simulation import sailed


def main(file: str, runs: int = 2) -> None:
    """Print what was sailed, and for each run how wrong the navigation is and whether its error bars hold."""
    mission = read_mission(file)
    simulation = sailed(mission)  # the vehicle sails once: another run has other noise, not another truth
    recorder = simulation.recorder
    print(f"{mission.name}: {mission.hull.name}, {recorder.length:.0f} s, with {', '.join(recorder.instruments)}")
    for number in range(runs):
        log = simulation.log(number)
        unread = [name for name in log.tables if name not in mission.vehicle.sensors and name != "truth"]
        solution = leadline.solve(log.without(*unread), mission.vehicle, rate=1.0)
        found = leadline.assess(solution, log.truth)
        assert found.errors is not None
        horizontal = found.errors.statistics()["horizontal"]
        print(f"run {number}: {horizontal.rms:.2f} m rms, {horizontal.p95:.2f} m in 95 of 100; {found.verdict.sentence}")


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:3]))
