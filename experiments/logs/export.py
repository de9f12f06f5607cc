"""Export of a log: tables as CSV or Parquet."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pandas

from ...testbed.atomic_write import partial_path
from ...testbed.errors import LogError, install_hint
from ...testbed.log.reader import Content, record_of
from ...testbed.log.scene import motion_of
from ...testbed.recording import channels as ch
from ..errors import MissingExtra, OutputExists
from ..output import refuse_existing

Format = Literal["csv", "parquet"]

_POSE: Final = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")


def export_log(content: Content, place: Path, form: Format) -> list[Path]:
    """Write a log in another format, whole or not at all, and return the files.

    Args:
        content: of the log.
        place: folder to create.
        form: of the files.

    Raises:
        OutputExists: the place exists already or cannot be written; nothing is left behind.
        MissingExtra: a package is not installed; the message names its extra.
        LogError: the log is of another version, or holds no rows.
    """
    refuse_existing(place, partial_path(place))
    if form == "parquet" and importlib.util.find_spec("pyarrow") is None:
        raise MissingExtra(f"--format parquet: needs pyarrow; {install_hint('export')}")
    frames = frames_of(content)
    if not any(map(len, frames.values())):
        raise LogError(f"{content.path}: holds no rows")
    partial = partial_path(place)
    try:
        partial.mkdir(parents=True)
        for topic, frame in frames.items():
            file = partial / f"{topic.strip('/').replace('/', '_')}.{form}"
            if form == "parquet":
                frame.reset_index().to_parquet(file, index=False)
            else:
                frame.to_csv(file, na_rep="nan")  # floats as their repr, hence exact
        partial.rename(place)
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise OutputExists(f"output folder {place}: cannot be written: {error.strerror}") from None
    return sorted(place.iterdir())


def frames_of(content: Content) -> dict[str, pandas.DataFrame]:
    """Return a data frame for each topic, with `time_s` as its index and units in the names."""
    record = record_of(content, (*ch.CHANNELS, ch.ERROR))
    frames = {topic: table.to_pandas() for topic, table in record.tables.items()}
    rows = [(event.time_s, event.level, event.text) for event in record.events]
    names = ["time_s", "level", "text"]
    frames[ch.EVENT_TOPIC] = pandas.DataFrame(rows, columns=names).set_index("time_s")
    if content.messages.get(ch.TRANSFORMS_TOPIC):
        motion = motion_of(content)
        poses = np.concatenate([motion.xyz, motion.quat], axis=2)  # (n, bodies, 7)
        names = [f"{body}_{name}" for body in motion.body_names for name in _POSE]
        index = pandas.Index(motion.time_s, name="time_s")
        values = poses.reshape(len(poses), -1)
        frames[ch.TRANSFORMS_TOPIC] = pandas.DataFrame(values, index, names)
    return frames
