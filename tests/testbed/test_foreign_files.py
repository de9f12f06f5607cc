"""Files of strangers: bounded in size and kind, links in their folders not followed."""

import os
from pathlib import Path

import pytest
from proving_ground.testbed.atomic_write import atomic_write, partial_path
from proving_ground.testbed.foreign_files import (
    MOST_LINE_BYTES,
    bounded_lines,
    json_table,
    open_member,
    read_bounded,
    read_member,
)


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/null", "/proc/self"])
def test_devices_and_folders_are_not_read(name):
    with pytest.raises(OSError, match=r"not a regular file|[Dd]irectory"):
        read_bounded(Path(name))


def test_a_pipe_is_refused_at_once(tmp_path):
    """Opening it would wait for a writer for ever."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="not a regular file"):
        read_bounded(tmp_path / "pipe")
    with pytest.raises(OSError, match="not a regular file"):
        read_member(tmp_path, "pipe")


def test_a_file_has_at_most_the_size_that_is_allowed(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"12345")
    assert read_bounded(file, 5) == read_member(tmp_path, "file", 5) == b"12345"
    for read in (lambda: read_bounded(file, 4), lambda: read_member(tmp_path, "file", 4)):
        with pytest.raises(OSError, match="has 5 bytes, at most 4 are read"):
            read()


def test_a_link_is_followed_where_the_user_names_it_and_not_in_a_folder(tmp_path):
    (tmp_path / "file").write_bytes(b"mine")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    assert read_bounded(tmp_path / "link") == b"mine"
    with pytest.raises(OSError, match="is a link"):
        read_member(tmp_path, "link")
    with pytest.raises(OSError, match="is a link"):
        open_member(tmp_path, "link", os.O_RDWR | os.O_CREAT)
    assert (tmp_path / "file").read_bytes() == b"mine"


def test_a_dangling_link_makes_no_file(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="is a link"):
        open_member(tmp_path, "link", os.O_RDWR | os.O_CREAT)
    assert not (tmp_path / "elsewhere").exists()


def test_an_atomic_write_does_not_follow_its_partial_file(tmp_path):
    victim = tmp_path / "victim"
    victim.write_bytes(b"mine")
    partial_path(tmp_path / "out").symlink_to(victim)
    with atomic_write(tmp_path / "out") as stream:
        stream.write(b"new")
    assert victim.read_bytes() == b"mine"
    assert (tmp_path / "out").read_bytes() == b"new"


def test_lines_are_bounded(tmp_path):
    (tmp_path / "file").write_bytes(b"a\n" + b"b" * MOST_LINE_BYTES + b"\nlast")
    with open_member(tmp_path, "file") as stream:
        lines = bounded_lines(stream)
        assert next(lines) == b"a\n"
        with pytest.raises(ValueError, match="has more than"):
            next(lines)


@pytest.mark.parametrize(
    "text", [b"", b"[1]", b"null", b"{", b"[" * 10**5, b"\xff", b'{"a": \x00}']
)
def test_what_is_no_object_is_refused(text):
    with pytest.raises(ValueError, match=r"is no JSON|must be an object"):
        json_table(text)
