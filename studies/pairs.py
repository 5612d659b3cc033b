"""Every process model with every estimator on one log: errors, consistency, cost, and what is refused, as a table in Markdown.

python studies/pairs.py                                    the survey mission, simulated
python studies/pairs.py --log LOG --vehicle FILE           a recorded dive, for what its vehicle file has inputs for
python studies/pairs.py --write docs/estimators.md         both put the table between the marks of a page: <!-- pairs NAME -->
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from leadline import read_log, read_vehicle
from leadline.formats.atomic import new_file
from leadline.missions.compare import compare
from leadline.missions.configuration import Configuration
from leadline.missions.mission import read_mission
from leadline.missions.simulation import sailed

if TYPE_CHECKING:
    from leadline.missions.compare import Compared

PROCESSES = ("inertial", "body-velocity", "cruise", "cruise with a hull", "planar", "dynamics")
ESTIMATORS = ("ekf", "kf", "ukf", "ckf", "srukf", "ekf-ukf", "ekf:adaptive=r", "pf:particles=1000")
HEAD = "| process | estimator | horizontal m | depth m | heading mrad | position NEES | inside 3 sigma | us per s | verdict, or why not |"
OWN = Path(__file__).parent.parent
THRUSTERS = {"sensors": {"thrusters": {"kind": "thruster", "rate_hz": 1.0}}}


def configuration(process: str, estimator: str, hull: str | None) -> Configuration:
    """Return one pair; the two that thrusters drive are told of the hull and its thrusters."""
    over, model = {}, process.partition(" ")[0]
    if hull is not None and process in ("dynamics", "cruise with a hull"):
        over = {**THRUSTERS, "process": {model: {"hull": hull}}, "water": {"current": {"sigma_mps": 0.1, "tau_s": 3600.0}}}
    return Configuration(name=f"{process}+{estimator}", estimator=estimator, process=model, over=over)


def cells(run: Compared, process: str, estimator: str) -> list[str]:
    """Return the cells of a row."""
    if run.assessment is None:
        return [f"`{process}`" if " " not in process else process, f"`{estimator}`", *[""] * 6, "refused: " + run.refusal]
    errors, score = run.score.errors, run.score

    def rms(name: str, factor: float = 1.0) -> str:
        return f"{factor * errors[name].rms:.3g}" if name in errors else ""

    inside = [score.inside[name] for name in ("horizontal", "depth", "velocity", "heading") if name in score.inside]
    return [
        f"`{process}`" if " " not in process else process, f"`{estimator}`", rms("horizontal"), rms("depth"), rms("heading", 1e3),
        f"{score.nees['position']:.2f}" if "position" in score.nees else "", f"{min(inside):.3f}" if inside else "", f"{run.cost:.0f}",
        run.assessment.verdict.answer.value,
    ]  # fmt: skip


def main() -> None:
    """Solve all pairs and print their table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--vehicle", type=Path)
    parser.add_argument("--without", default="")
    parser.add_argument("--write", type=Path)
    given = parser.parse_args()
    if given.log is None:
        mission = read_mission(OWN / "missions/survey.toml")
        log, vehicle, hull, name = sailed(mission).log(2), mission.path.parent / "vehicles/survey-auv.toml", "remus-100", "survey"
    else:
        log, vehicle, hull, name = read_log(given.log), given.vehicle, None, "recorded"
        read_vehicle(vehicle)
    pairs = [
        (process, estimator) for process in PROCESSES for estimator in ESTIMATORS if hull is not None or process != "cruise with a hull"
    ]
    lines = [HEAD, "| " + " | ".join(["---"] * 9) + " |"]
    for process, estimator in pairs:
        run = compare(log, vehicle, [configuration(process, estimator, hull)]).runs[0]
        lines.append("| " + " | ".join(cells(run, process, estimator)) + " |")
        print(lines[-1], file=sys.stderr)
    table = "\n".join(lines)
    print(table)
    if given.write is not None:
        page = given.write.read_text("utf-8")
        marks = rf"(<!-- pairs {name} -->\n).*?(<!-- end -->)"
        with new_file(given.write) as part:
            part.write_text(re.sub(marks, lambda found: f"{found[1]}\n{table}\n\n{found[2]}", page, flags=re.DOTALL), "utf-8")


if __name__ == "__main__":
    main()
