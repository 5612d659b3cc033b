"""The command line: arguments in, exit code out.  The one place that prints, and the one that catches.

Exit codes: 0 done; 1 our own fault (the traceback lies in a file that is named); 2 wrong input (one line says what); 130 interrupted.
With --json standard output holds JSON alone; progress and trouble go to standard error.
"""

from __future__ import annotations

import contextlib
import errno
import gc
import json
import os
import sys
import tempfile
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, help="Navigation for underwater vehicles.")
vehicle_app = typer.Typer(help="Make and check vehicle files.")
app.add_typer(vehicle_app, name="vehicle")
calibrate_app = typer.Typer(help="Calibrate instruments and vehicles from logs.")
app.add_typer(calibrate_app, name="calibrate")

LogPath = Annotated[Path, typer.Argument(metavar="LOG", help="Folder of a log (log.toml and one table per sensor).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]


class Stopped(Exception):
    """Work that was interrupted, and what became of it."""


def main() -> None:
    """Run the command line and leave with its exit code.

    What is imported stays, so the collector need not look at it again and again; and the process ends at once, as taking compiled code
    down piece by piece costs a quarter of a second.
    """
    gc.set_threshold(200_000, 50, 50)
    code = run(sys.argv[1:])
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def run(arguments: list[str]) -> int:
    """Run the command line with arguments; returns the exit code."""
    try:
        code = app(arguments or ["--help"], standalone_mode=False)
        sys.stdout.flush()
        if code == 130:  # what typer makes of Ctrl-C
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0
    except InputError as error:
        return _say(f"leadline: {error}", 2)
    except typer.TyperException as error:
        return _say(f"leadline: {error.format_message()}", 2)
    except Stopped as stopped:
        return _say(f"leadline: {stopped}", 130)
    except (KeyboardInterrupt, typer.Abort):
        return _say("leadline: interrupted; nothing was written", 130)
    except (BrokenPipeError, SystemExit):  # the reader of standard output has gone: rich and typer then leave by SystemExit
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the flush at the end has a reader
        return 0
    except OSError as error:
        if error.errno != errno.ENOSPC:
            return _fault(error)
        return _say(f"leadline: {error.filename or 'standard output'}: cannot be written: {error.strerror}; make room", 2)
    except Exception as error:
        return _fault(error)


def _fault(error: Exception) -> int:
    with tempfile.NamedTemporaryFile("w", prefix="leadline-", suffix=".log", delete=False) as file:
        traceback.print_exception(error, file=file)
    return _say(f"leadline: this is our fault, not yours: {type(error).__name__}: {error}; the traceback is in {file.name}", 1)


def _say(message: str, code: int) -> int:
    print(" ".join(message.split()), file=sys.stderr)
    return code


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """Navigation for underwater vehicles."""
    if version:
        from leadline import __version__

        print(__version__)
        raise typer.Exit


@app.command()
def solve(
    log: LogPath,
    vehicle: Annotated[Path, typer.Option("--vehicle", metavar="FILE", help="Vehicle file (TOML).")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the solution, made anew.")],
    calibration: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Fragment that comes before the vehicle file.")] = None,
    estimator: Annotated[str, typer.Option(metavar="NAME", help="ekf, kf, ukf, ckf, srukf, pf; settings as ukf:alpha=0.5.")] = "ekf",
    process: Annotated[str | None, typer.Option(metavar="NAME", help="Process model in place of the vehicle file's.")] = None,
    rate: Annotated[float, typer.Option(metavar="HZ", help="States per second in the solution; changes no estimate.")] = 10.0,
    times: Annotated[Path | None, typer.Option(metavar="FILE", help="States at the times of a CSV with a column time_s.")] = None,
    at: Annotated[str | None, typer.Option(metavar="NAME", help="States of a named point or sensor instead of the body origin.")] = None,
    smooth: Annotated[bool, typer.Option("--smooth", help="Each state by all data; rows are judged once more, by all others.")] = False,
    as_live: Annotated[bool, typer.Option("--as-live", help="Deliver rows as they arrived (received_s), with the window.")] = False,
    window: Annotated[float, typer.Option(metavar="S", help="With --as-live: how late a row may arrive.")] = 30.0,
    until: Annotated[float | None, typer.Option(metavar="S", help="Stop at this time of the log.")] = None,
    snapshot: Annotated[Path | None, typer.Option(metavar="FILE", help="With --as-live: write the navigator at the end.")] = None,
    resume: Annotated[Path | None, typer.Option(metavar="FILE", help="With --as-live: go on from a snapshot.")] = None,
    only: Annotated[str, typer.Option(metavar="A,B", help="Aid with these sensors alone.")] = "",
    without: Annotated[str, typer.Option(metavar="A,B", help="Leave these sensors out.")] = "",
    csv: Annotated[bool, typer.Option("--csv", help="States as CSV instead of Parquet.")] = False,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html.")] = True,
    as_json: AsJson = False,
) -> None:
    """Turn a recorded dive into a trajectory with error bars, and a report."""
    with _progress(_loading()) as tell:
        from leadline.missions.dive import Run, solve_dive

        names = (_names(only), _names(without), tuple(calibration or ()))
        run = Run(estimator, process, rate, times, at, smooth, as_live, window, until, snapshot, resume, *names)
        told = lambda line: print(f"leadline: {line}", file=sys.stderr)  # noqa: E731
        solution, assessment = solve_dive(log, vehicle, out, run, csv=csv, report=report, progress=tell, tell=told)
    if as_json:
        _print_json({**solution.summary, "assessment": assessment.to_dict()})
        return
    from leadline.report.text import assessment_text

    _print_rich(assessment_text(assessment))
    print(f"solution: {out}" + (f"   report: {out / 'report.html'}" if report else ""))


@app.command()
def simulate(
    mission: Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file (TOML).")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where to write the log.")],
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Which run of the mission: another has other noise.")] = 0,
    csv: Annotated[bool, typer.Option("--csv", help="Write tables as CSV instead of Parquet.")] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a dive: vehicle, sea, instruments and faults of a mission file become a log with truth."""
    with _progress("sailing", "sailing") as tell:
        from leadline.missions.simulation import simulate_folder

        found, log = simulate_folder(mission, out, seed, parquet=not csv, progress=tell)
    from leadline.report.simulation import summary, text

    if as_json:
        _print_json(summary(log, found.vehicle.name, found.hull.name, seed, found.not_simulated))
        return
    _print_rich(text(log, found.vehicle.name, found.hull.name, seed, found.not_simulated))
    print(f"log: {out}")


@app.command()
def inspect(log: LogPath, as_json: AsJson = False) -> None:
    """Look a log over: rates, gaps, duplicates, clock jumps, held values, ranges, suspicions of unit and axis."""
    from leadline.data.inspection import inspect as look
    from leadline.formats.folder import read_log

    found = look(read_log(log))
    if as_json:
        _print_json(found.to_dict())
        return
    from leadline.report.inspection import text

    _print_rich(text(found))


@app.command()
def assess(
    solution: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a solution.")],
    truth: Annotated[Path | None, typer.Option(metavar="LOG", help="Log whose truth table is the reference.")] = None,
    as_json: AsJson = False,
) -> None:
    """Score a solution: errors against truth, misclosure at fixes, consistency of its error bars, and the verdict."""
    from leadline.assess.assessment import assess as judge
    from leadline.formats.folder import read_log
    from leadline.formats.solution import read_solution

    reference = None
    if truth is not None:
        reference = read_log(truth).truth
        if reference is None:
            raise InputError(truth, "has no table of kind truth", "give a log that has one")
    found = read_solution(solution)
    if reference is not None and "at" in found.summary:
        raise InputError(
            solution, f"holds the states of '{found.summary['at']}'", "truth is of the body origin: solve without --at to compare"
        )
    assessment = judge(found, reference)
    if as_json:
        _print_json(assessment.to_dict())
        return
    from leadline.report.text import assessment_text

    _print_rich(assessment_text(assessment))


@app.command()
def export(
    solution: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a solution.")],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Where to write it.")],
    to: Annotated[str | None, typer.Option(metavar="FORMAT", help="geojson, kml, gpx, tum or sbet; else by the suffix of FILE.")] = None,
    every: Annotated[float | None, typer.Option(metavar="S", help="Time between states; 1 for maps, all for tum and sbet.")] = None,
    time: Annotated[str, typer.Option(metavar="SCALE", help="Seconds of the week in sbet: gps, or utc.")] = "gps",
) -> None:
    """Write a solution for other programs: GeoJSON, KML, GPX, TUM, SBET."""
    from leadline.formats.export import export as write
    from leadline.formats.export import format_of
    from leadline.formats.solution import read_solution

    name = format_of(out, to)
    if out.exists():
        raise InputError(out, "is there already", "name a new file")
    count = write(read_solution(solution), out, name, every=every, scale=time)
    print(f"{name}: {out}   states: {count}")


@app.command("report")
def report_log(
    log: LogPath,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Where to write the page (HTML), a new file.")],
    solution: Annotated[
        list[Path] | None, typer.Option(metavar="DIR", help="Solution to draw as well; may be given several times.")
    ] = None,
    chart: Annotated[Path | None, typer.Option(metavar="FILE", help="Chart of the ground; else chart.asc in the log.")] = None,
    positive: Annotated[str, typer.Option(metavar="down|up", help="Whether the chart holds depths or heights.")] = "down",
    vehicle: Annotated[Path | None, typer.Option(metavar="FILE", help="Vehicle file that says how instruments are mounted.")] = None,
) -> None:
    """Draw a log, real or simulated: the dive in three dimensions, and what the log holds over time."""
    with _progress("reading", "drawing") as tell:
        from leadline.missions.reporting import report_folder

        report_folder(log, out, solutions=solution or (), chart=chart, positive=positive, vehicle=vehicle, progress=tell)
    print(f"report: {out}")


@app.command()
def compare(
    log: LogPath,
    more: Annotated[list[str] | None, typer.Argument(metavar="[RUN]...", help="Further runs.", show_default=False)] = None,
    runs: Annotated[
        list[str] | None, typer.Option(metavar="RUN...", help="Run files (TOML), estimators, process models, or PROCESS+ESTIMATOR.")
    ] = None,
    vehicle: Annotated[Path | None, typer.Option(metavar="FILE", help="Vehicle file (TOML), for runs that name none.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where to write page, numbers and solutions; a new folder.")] = None,
    as_json: AsJson = False,
) -> None:
    """Solve one log in several ways, and say how far off each is, whether it says so, and what it costs."""
    with _progress(_loading()) as tell:
        from leadline.missions.compare import PAGE, compare_folder

        told = lambda line: print(f"leadline: {line}", file=sys.stderr)  # noqa: E731
        found = compare_folder(log, vehicle, [*(runs or ()), *(more or ())], out, progress=tell, tell=told)
    if as_json:
        _print_json(found.to_dict())
        return
    from leadline.report.compare import comparison_text

    _print_rich(comparison_text(found))
    if out is not None:
        print(f"comparison: {out}   page: {out / PAGE}")


@app.command()
def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY", help="Study file (TOML).")],
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of cells, numbers and page; one that was begun is gone on with.")
    ],
    processes: Annotated[int, typer.Option(metavar="N", min=0, help="How many runs at once; 0: one for each core.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Simulate missions many times, solve each run in several ways, and say with intervals which is better and which bars are held."""
    try:
        with _progress(_loading(), "studying") as tell:
            from leadline.missions.study_file import PAGE, study_folder

            wanted, found = study_folder(file, out, processes=processes or os.cpu_count() or 1, progress=tell)
    except KeyboardInterrupt:
        raise Stopped("interrupted; finished runs are kept, and the same command goes on") from None
    if as_json:
        _print_json({"study": wanted.name, **found.to_dict()})
        return
    from leadline.report.study import study_text

    _print_rich(study_text(wanted.name, found))
    print(f"study: {out}   page: {out / PAGE}")


@vehicle_app.command("new")
def vehicle_new(
    log: Annotated[Path | None, typer.Argument(metavar="[LOG]", help="Log whose tables become its sensors.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Where to write it; else it is printed.")] = None,
) -> None:
    """Write a commented vehicle file to start from."""
    from leadline.data.vehicle_template import template
    from leadline.formats.atomic import new_file
    from leadline.formats.folder import read_log

    text = template(read_log(log) if log is not None else None)
    if out is None:
        print(text, end="")
        return
    if out.exists():
        raise InputError(out, "is there already", "name a new file")
    with new_file(out) as part:
        part.write_text(text, encoding="utf-8")


@vehicle_app.command("check")
def vehicle_check(
    vehicle: Annotated[Path, typer.Argument(metavar="FILE", help="Vehicle file (TOML).")],
    log: Annotated[Path | None, typer.Option(metavar="LOG", help="Log to hold it against.")] = None,
) -> None:
    """Check a vehicle file, and show what Leadline understands of it."""
    from leadline.data.vehicle import read_vehicle
    from leadline.formats.folder import read_log
    from leadline.report.vehicle import text

    _print_rich(text(read_vehicle(vehicle), read_log(log) if log is not None else None))


@app.command()
def budget(
    log: LogPath,
    vehicle: Annotated[Path, typer.Option("--vehicle", metavar="FILE", help="Vehicle file (TOML).")],
    calibration: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Fragment that comes before the vehicle file.")] = None,
    until: Annotated[float | None, typer.Option(metavar="S", help="At this time of the log instead of its end.")] = None,
    as_json: AsJson = False,
) -> None:
    """Whose error is how much of the error at the end: start, instruments, what wanders, and what is taken for known."""
    with _progress(_loading()) as tell:
        from leadline.data.vehicle import read_vehicle
        from leadline.estimate.budget import budget as shares
        from leadline.formats.folder import read_log

        found = shares(read_log(log), read_vehicle(vehicle, *(calibration or ())), until=until, progress=tell)
    if as_json:
        _print_json({**vars(found), "shares": [vars(share) for share in found.shares]})
        return
    from leadline.report.budget import text

    _print_rich(text(found))


@calibrate_app.command("dvl")
def calibrate_dvl(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Folders of logs with a reference.")],
    vehicle: Annotated[Path, typer.Option("--vehicle", metavar="FILE", help="Vehicle file (TOML).")],
    sensor: Annotated[str, typer.Option(metavar="NAME", help="The Doppler log.")] = "dvl",
    reference: Annotated[
        str, typer.Option(metavar="WHAT", help="fixes, truth, ends (of truth), or a table's path inside a log.")
    ] = "fixes",
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Where to write the fragment; else it is printed.")] = None,
    as_json: AsJson = False,
) -> None:
    """Scale, mounting and lever arm of a Doppler log from logs with a reference, as a fragment of a vehicle file."""
    with _progress("calibrating") as tell:
        from leadline.missions.calibration import dvl_from_folders

        found, text = dvl_from_folders(logs, vehicle, sensor, reference, out, tell)
    if as_json:
        _print_json({"fragment": text, **vars(found)})
        return
    from leadline.report.calibration import dvl_text

    _print_rich(dvl_text(found))
    print(text.rstrip() if out is None else f"fragment: {out}")


@calibrate_app.command("vehicle")
def calibrate_vehicle(
    log: LogPath,
    hull: Annotated[str, typer.Option("--hull", metavar="NAME|FILE", help="Hull to start from: its mass and geometry are taken.")],
    vehicle: Annotated[Path | None, typer.Option(metavar="FILE", help="Vehicle file that says how instruments are mounted.")] = None,
    solution: Annotated[Path | None, typer.Option(metavar="DIR", help="Solution of the log: its velocity and attitude are taken.")] = None,
    density: Annotated[float, typer.Option(metavar="KGPM3", help="Of the water.")] = 1025.0,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Where to write the hull file; else it is printed.")] = None,
    as_json: AsJson = False,
) -> None:
    """Drag, speed per rps, thrust of each thruster and buoyancy of a hull from a log of it, as a hull file."""
    with _progress("calibrating", "calibrating") as tell:
        from leadline.missions.vehicle_calibration import vehicle_from_folders

        found, text = vehicle_from_folders(log, hull, vehicle, solution, out, tell, density=density)
    if as_json:
        _print_json({"hull_file": text, **found.to_dict()})
        return
    from leadline.report.vehicle_calibration import vehicle_text

    _print_rich(vehicle_text(found))
    print(text.rstrip() if out is None else f"hull file: {out}")


@app.command()
def tune(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Folders of logs.")],
    vehicle: Annotated[Path, typer.Option("--vehicle", metavar="FILE", help="Vehicle file (TOML).")],
    sensors: Annotated[str, typer.Option(metavar="A,B", help="Tune these alone; an inertial unit: its noise.")] = "",
    process: Annotated[bool, typer.Option("--process", help="Tune the process noise as well.")] = False,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Where to write the fragment; else it is printed.")] = None,
    as_json: AsJson = False,
) -> None:
    """Estimate the sigmas of sensors and of the process noise from innovations, as a fragment of a vehicle file."""
    with _progress("tuning") as tell:
        from leadline.missions.tuning import tune_from_folders

        found, text = tune_from_folders(logs, vehicle, _names(sensors), out, tell, process=process)
    if as_json:
        _print_json({"fragment": text, **vars(found), "sigmas": [vars(sigma) for sigma in found.sigmas]})
        return
    from leadline.report.tuning import tuning_text

    _print_rich(tuning_text(found))
    print(text.rstrip() if out is None else f"fragment: {out}")


@app.command()
def warmup() -> None:
    """Compile what can be compiled, once, so that the first run starts at full speed."""
    with _progress("compiling"):
        from leadline.core.compiled import cache_root
        from leadline.missions.warmup import warm_up

        warm_up()
    print(f"compiled kernels: {cache_root()}")


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _print_json(value: Any) -> None:
    from leadline.formats.solution import plain

    print(json.dumps(plain(value), indent=2, allow_nan=False))


def _print_rich(renderable: Any) -> None:
    from rich.console import Console

    console = Console() if sys.stdout.isatty() else Console(width=int(os.environ.get("COLUMNS", "120")))
    console.print(renderable)


def _loading() -> str:
    """What to say while modules load: the first time they are compiled."""
    cache = Path(os.environ.get("LEADLINE_CACHE", Path.home() / ".cache" / "leadline"))
    return "loading" if any(cache.glob("leadline.estimate.loop-*")) else "compiling, this once (half a minute)"


@contextlib.contextmanager
def _progress(message: str, doing: str = "solving") -> Iterator[Callable[[float], None]]:
    """Show on standard error, where a person sits there, that work goes on; yields what to call with the fraction done."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(message, total=None)
        yield lambda fraction: bar.update(task, description=doing, total=1.0, completed=fraction)


if __name__ == "__main__":
    main()
