"""The script of `ttempc completion` completes in a real shell what the command line takes."""

import shutil
import subprocess

import pytest
from proving_ground.experiments.commands.cli import main


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    from contextlib import redirect_stdout

    file = tmp_path_factory.mktemp("shell") / "ttempc.bash"
    with open(file, "w") as stream, redirect_stdout(stream):
        assert main(["completion", "bash"]) == 0
    return file


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("ttempc swe", {"sweep"}),
        ("ttempc run wet", {"wet-grass", "wet-slope"}),
        ("ttempc sweep terr", {"terrain-slip"}),
        ("ttempc run grass --controller nmpc-r", {"nmpc-rti"}),
        ("ttempc log calib", {"calibrate"}),
        ("ttempc run --rec", {"--record-rate"}),
    ],
)
def test_words_are_completed(words, completed, script, tmp_path):
    line = words.split()
    shell = (
        f"source {script}; COMP_WORDS=({words}); COMP_CWORD={len(line) - 1}; "
        f'_shtab_ttempc ttempc {line[-1]} {line[-2]}; printf "%s\\n" "${{COMPREPLY[@]}}"'
    )
    done = subprocess.run(
        ["bash", "-c", shell], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60
    )
    assert set(done.stdout.split()) == completed
