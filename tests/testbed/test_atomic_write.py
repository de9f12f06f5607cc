"""Atomic writes: a complete new file, or the old one, and nothing beside it."""

import pytest
from proving_ground.testbed.atomic_write import atomic_write


@pytest.fixture(params=[None, b"old"], ids=["new", "old"])
def file(request, tmp_path):
    file = tmp_path / "log.mcap"
    if request.param is not None:
        file.write_bytes(request.param)
    return file


def contents(folder):
    return {each: each.read_bytes() for each in folder.iterdir()}


def test_the_content_replaces_the_file_at_the_end_of_the_block(file):
    before = contents(file.parent)
    with atomic_write(file) as stream:
        stream.write(b"new")
        assert {path: data for path, data in contents(file.parent).items() if path == file} == (
            before
        )
    assert contents(file.parent) == {file: b"new"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OSError])
def test_an_exception_leaves_the_folder_as_it_was(error, file):
    before = contents(file.parent)

    def interrupted():
        with atomic_write(file) as stream:
            stream.write(b"ne")
            raise error

    with pytest.raises(error):
        interrupted()
    assert contents(file.parent) == before
