"""`ttempc render`, `ttempc report` and `ttempc compare`: what a run or a sweep looks like."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ...testbed.log import log_path
from ..errors import BadOptions
from ..output import make_folder, progress, refuse_existing, write_file
from . import options
from .options import command, option, out, refuse_given

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@command(
    options.LOG,
    out("FILE", "name.mp4, .webp, .png or .jpg; default: an .mp4, with --at a .png, by the log"),
    option("--at", type=options.number, dest="at_s", metavar="S", help="time of one picture [s]"),
    *options.PICTURE,
)
def render(arguments: argparse.Namespace) -> int:
    """Film a run from its log alone, or take one picture; nothing is simulated again.

    On the ground: reference path (white), driven paths of tractor (blue) and trailer
    (orange), predicted paths (yellow). Slipping wheels are amber, then red. MP4 needs the
    extra `film`.

      ttempc render RUN --camera split --from 20 --to 60 --speed 4 -o curve.webp
      ttempc render RUN --at 42.5 --camera hitch --size 1920x1080 -o hitch.png
      ttempc render RUN --ghost reference --ghost other/log.mcap
    """
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..pictures.film.render import STILL_SUFFIXES, Film
    from ..pictures.film.settings import FRAME_RATE, FilmSettings

    at_s = arguments.at_s
    log = arguments.log
    ending = f"{arguments.camera}.mp4" if at_s is None else f"{arguments.camera}-{at_s:g}.png"
    file = arguments.out or log.with_name(f"{log.name.removesuffix('.mcap')}-{ending}")
    still = file.suffix.lower() in STILL_SUFFIXES
    if still != (at_s is not None):
        need = "a picture needs --at" if still else f"--at: makes {' or '.join(STILL_SUFFIXES)}"
        raise BadOptions(f"-o {file}: {need}")
    settings = FilmSettings(
        camera=arguments.camera,
        at_s=at_s,
        begin_s=arguments.begin_s,
        end_s=arguments.end_s,
        speed=arguments.speed,
        size=arguments.size,
        display=not arguments.no_display,
    )
    film = Film.of(log, settings, arguments.ghost)
    with progress(film.frames, file.name, "frame", shown=film.frames > 1) as count:
        film.write(file, count)
    if still:
        print(f"picture   {file}")
    else:
        print(f"film      {file} ({film.frames} frames, {film.frames / FRAME_RATE:.1f} s)")
    return 0


@command(
    option(
        "source", type=log_path, metavar="DIR|LOG", help="folder of a sweep or a run, or its log"
    ),
    out("FILE|DIR", "page of a log, or folder of figures; default: beside the log or in DIR"),
    *options.FIGURES,
    options.LATEX,
    options.LIMIT,
    option(
        "--iso12188",
        action="store_true",
        help="print cross-track errors of a log's straight passes as ISO 12188-2 has them",
    ),
)
def report(arguments: argparse.Namespace) -> int:
    """Write the page of a run or of a sweep; for a paper its figures or tables instead.

    The page of a sweep, which may still be running, is DIR/report/report.html.

      ttempc report runs/sweep-terrain-slip --limit 0.6
      ttempc report runs/grass-ttempc-1 --format pdf,svg --width single --only error path
      ttempc report runs/sweep-terrain-slip --latex
    """
    source: Path = arguments.source
    if arguments.iso12188:
        return _iso12188(arguments)
    if arguments.latex:
        return _latex_of(arguments)
    if arguments.format is None:
        given = ("width", "only")
        refuse_given(arguments, given, "goes with --format, which makes figures")
    else:
        refuse_given(arguments, ("limit",), "goes with the page, not with --format")
    if source.is_file():
        refuse_given(arguments, ("limit",), "goes with a sweep, not a log")
    if arguments.format is not None:
        beside = source.with_name(f"{source.stem}-figures")
        folder = arguments.out or (source / "figures" if source.is_dir() else beside)
        refuse_existing(folder)
        _write_figures(arguments, _figures_of(source), folder)
        return 0
    return _page_of_log(arguments) if source.is_file() else _page_of_sweep(arguments)


def _iso12188(arguments: argparse.Namespace) -> int:
    """Print the report of ISO 12188-2; with -o FILE its numbers as JSON, too."""
    from ...testbed.log.reader import read_log
    from ..results.iso12188 import format_report, report, to_json

    refuse_given(arguments, ("format", "width", "only", "limit"), "not with --iso12188")
    if arguments.out is not None:
        refuse_existing(arguments.out)
    content = report(read_log(arguments.source))
    print("\n".join(format_report(content)))
    if arguments.out is not None:
        write_file(arguments.out, to_json(content))
        print(f"\nJSON      {arguments.out}")
    return 0


def _latex_of(arguments: argparse.Namespace) -> int:
    """Write the tables of a sweep into a new folder, that of a log into a new file."""
    refuse_given(arguments, ("format", "width", "only"), "not with --latex")
    source: Path = arguments.source
    if source.is_dir():
        folder = arguments.out or source / "tables"
        refuse_existing(folder)
        tables = _tables_of_sweep(source, arguments.limit)
        make_folder(folder)
        files = {folder / f"{name}.tex": table for name, table in tables.items()}
    else:
        refuse_given(arguments, ("limit",), "goes with a sweep, not a log")
        file = arguments.out or source.with_name(f"{source.name.removesuffix('.mcap')}.tex")
        refuse_existing(file)
        files = {file: _table_of_log(source)}
    for file, table in files.items():
        write_file(file, table)
        print(file)
    return 0


def _tables_of_sweep(folder: Path, limit_m: float | None) -> dict[str, str]:
    """Return the tables of a sweep's page in LaTeX, by name."""
    from ..pictures.sweep_report.report import make_report, plain_cells
    from ..pictures.sweep_report.runs import read_sweep
    from ..results.latex import latex_table

    tables = make_report(read_sweep(folder, limit_m)).tables
    return {
        name: latex_table(table.heads, plain_cells(table), table.title)
        for name, table in tables.items()
    }


def _table_of_log(log: Path) -> str:
    """Return the cross-track errors of a log in LaTeX."""
    from ...testbed.log.reader import read_log
    from ..results.latex import latex_table
    from ..results.summary import tracking_statistics
    from ..results.table import COLUMNS, COUNTED, tracking_rows
    from ..results.tracking_errors import tracking_errors

    rows = tracking_rows(tracking_statistics(tracking_errors(read_log(log))))
    heads = ("path", "point", *(f"{head} [cm]" for head in COLUMNS))
    return latex_table(heads, rows, f"cross-track errors; p95: of the absolute error. {COUNTED}")


def _page_of_sweep(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load matplotlib.
    from ..pictures.sweep_report.report import make_report, write_report
    from ..pictures.sweep_report.runs import read_sweep

    refuse_given(arguments, ("out",), "the report of a sweep lies in its folder")
    runs = read_sweep(arguments.source, arguments.limit)
    file = write_report(make_report(runs), arguments.source)
    if runs.missing:
        print(f"in progress: {runs.missing} of {runs.planned} runs are missing")
    print(f"open {file}")
    return 0


def _page_of_log(arguments: argparse.Namespace) -> int:
    from ..logs.log_report import report_of_log

    log = arguments.source
    file = arguments.out or log.with_name(f"{log.name.removesuffix('.mcap')}-report.html")
    refuse_existing(file)
    write_file(file, report_of_log(log))
    print(f"open {file}")
    return 0


def _figures_of(source: Path) -> Mapping[str, Callable[[], Figure]]:
    """Return the functions that draw the figures of a log or of a sweep."""
    if not source.is_dir():
        from ...testbed.log.reader import read_log
        from ..pictures.figures.export import run_figures

        return run_figures(read_log(source))
    from ..pictures.sweep_report.report import make_report, panel_figures
    from ..pictures.sweep_report.runs import read_sweep

    return panel_figures(make_report(read_sweep(source)))


def _write_figures(
    arguments: argparse.Namespace, figures: Mapping[str, Callable[[], Figure]], folder: Path
) -> None:
    """Write figures into a new folder, as the options ask, and print the paths.

    Raises:
        BadOptions: an option has no such value; nothing is written.
    """
    from ..pictures.figures.export import FORMATS, WIDTHS_CM, export_figures

    formats = tuple((arguments.format or "png").split(","))
    if unknown := [name for name in formats if name not in FORMATS]:
        raise BadOptions(f"--format: got {unknown[0]!r}, must be of {', '.join(FORMATS)}")
    if unknown := [name for name in arguments.only or () if name not in figures]:
        raise BadOptions(f"--only: got {unknown[0]!r}, must be of {', '.join(figures)}")
    width = None
    if text := arguments.width:
        number = float(text) if text.replace(".", "", 1).isdecimal() else 0.0
        width = WIDTHS_CM.get(text, number)
        if not 4.0 <= width <= 100.0:
            raise BadOptions(f"--width: got {text}, must be single, double, or from 4 to 100 cm")
    chosen = {name: figures[name] for name in arguments.only or figures}
    make_folder(folder)
    for name, content in export_figures(chosen, formats, width):
        write_file(folder / name, content)
        print(folder / name)


@command(
    option("logs", type=log_path, nargs="+", metavar="LOG", help="log or folder of a run"),
    out("DIR", "default: a new one in runs/"),
    option("--label", action="append", metavar="NAME", help="name of a run, once for each"),
    *options.FIGURES,
    options.LATEX,
)
def compare(arguments: argparse.Namespace) -> int:
    """Compare runs on one reference, aligned by its time; print a table and write into DIR:

    path, cross-track, signals   figures
    comparison.csv               the statistics, SI units
    comparison.tex               with --latex: the printed errors

    ttempc compare runs/grass-pid-1 runs/grass-ttempc-1
    """
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..pictures.figures.comparison_figures import comparison_figures
    from ..results.latex import latex_table
    from ..results.run_comparison import (
        COMPARED,
        STATISTICS_FILE,
        comparison_csv,
        comparison_rows,
        format_comparison,
        read_compared,
    )

    folder = arguments.out or options.unused_path(Path("runs"), "comparison")
    refuse_existing(folder)
    runs = read_compared(arguments.logs, arguments.label or ())
    print(format_comparison(runs) + "\n")
    _write_figures(arguments, comparison_figures(runs), folder)
    write_file(folder / STATISTICS_FILE, comparison_csv(runs))
    print(folder / STATISTICS_FILE)
    if arguments.latex:
        heads = ("run", "point", *(f"{name} [cm]" for name in COMPARED))
        table = latex_table(heads, comparison_rows(runs), format_comparison(runs).splitlines()[0])
        write_file(folder / "comparison.tex", table)
        print(folder / "comparison.tex")
    return 0
