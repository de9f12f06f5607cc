"""Page and figures of a run's folder."""

from dataclasses import replace

from ....testbed.foreign_files import read_member
from ...output import write_file
from ...run.run_folder import Finished
from ..figures import draw
from .run_report import render_run_report


def write_page(finished: Finished) -> Finished:
    """Write the figures and `report.html` of a run into its folder, and return it with them."""
    pictures = draw(finished.record)
    files = dict(finished.files)
    for figure, content in pictures.items():
        files[figure] = finished.folder / f"{figure}.png"
        write_file(files[figure], content)

    resolved = read_member(finished.folder, files["scenario"].name).decode()
    page = render_run_report(
        finished.summary, finished.record, resolved, pictures, description=finished.description
    )
    files["report"] = finished.folder / "report.html"
    write_file(files["report"], page)
    return replace(finished, files=files)
