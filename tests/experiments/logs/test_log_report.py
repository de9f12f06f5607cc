"""The page of a log is that of its run; a torn log has a page of what is left."""

import re

import pytest
from proving_ground.experiments.commands.cli import main


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    assert main(["run", "pavement", "--set", "path.laps=1", "--seed", "2", "-o", str(folder)]) == 0
    return folder


def page_of(log, file):
    assert main(["report", str(log), "-o", str(file)]) == 0
    return file.read_text()


def without_what_a_log_lacks(page):
    """Leave out how fast the run was, and the files beside it."""
    rows = ("real-time factor", "files")
    pattern = "|".join(rf'\s*<tr><th scope="row">{row}</th>.*?</tr>' for row in rows)
    return re.sub(pattern, "", page, flags=re.DOTALL)


def test_the_page_of_a_whole_log_is_that_of_the_run(run, tmp_path):
    page = page_of(run / "log.mcap", tmp_path / "page.html")
    own = (run / "report.html").read_text()
    assert without_what_a_log_lacks(page) == without_what_a_log_lacks(own)


def test_a_torn_and_a_recovered_log_have_a_page_that_says_so(run, tmp_path):
    torn, whole = tmp_path / "torn.mcap.part", tmp_path / "recovered.mcap"
    data = (run / "log.mcap").read_bytes()
    torn.write_bytes(data[: len(data) // 2])
    assert main(["log", "check", str(torn), "-o", str(whole)]) == 1
    for log in (torn, whole):
        page = page_of(log, tmp_path / f"{log.name}.html")
        assert ">torn</span>" in page
        assert "the log is not whole" in page
        assert page.count("<img") >= 5
