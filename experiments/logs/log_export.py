"""Export of a log to CSV or Parquet tables, one file per topic."""

from __future__ import annotations

import csv
import importlib.util
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...testbed.atomic_write import partial_path
from ...testbed.errors import LogError
from ...testbed.log.reader import Content, record_of
from ...testbed.log.scene import Motion, motion_of
from ...testbed.recording.channels import CHANNELS, ERROR, EVENT_TOPIC, TRANSFORMS_TOPIC
from ..errors import MissingExtra, OutputExists
from ..output import refuse_existing

Columns = Mapping[str, Any]  # name: sequence of values
_POSE: Final = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")


def export_log(content: Content, folder: Path, form: str) -> list[Path]:
    """Write the rows, events and transforms of a log to a new folder and return the files.

    Args:
        content: of the log.
        folder: to create.
        form: "csv", or "parquet", which needs the extra `export`.

    Raises:
        OutputExists: the folder exists already or cannot be written; nothing is left behind.
        MissingExtra: pyarrow is not installed.
        LogError: the log is of another version or holds no rows.
    """
    refuse_existing(folder)
    if form == "parquet" and importlib.util.find_spec("pyarrow") is None:
        raise MissingExtra(
            "--format parquet: needs pyarrow, pip install 'ttempc-proving-ground[export]'"
        )
    tables = columns_of(content)
    if not any(len(next(iter(columns.values()))) for columns in tables.values()):
        raise LogError(f"{content.path}: holds no rows")
    write: Callable[[Columns, Path], None] = _parquet if form == "parquet" else _csv
    partial = partial_path(folder)
    try:
        partial.mkdir(parents=True)
        for topic, columns in tables.items():
            write(columns, partial / f"{topic.strip('/').replace('/', '_')}.{form}")
        partial.rename(folder)
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise OutputExists(f"output folder {folder}: cannot be written: {error.strerror}") from None
    return sorted(folder.iterdir())


def columns_of(content: Content) -> dict[str, Columns]:
    """Return the columns of each topic: `time_s` first, units in the names."""
    record = record_of(content, (*CHANNELS, ERROR))
    tables: dict[str, Columns] = {
        topic: {
            "time_s": table.time_s,
            **dict(zip(table.channel.fields, table.values.T, strict=True)),
        }
        for topic, table in record.tables.items()
    }
    tables[EVENT_TOPIC] = {
        "time_s": [event.time_s for event in record.events],
        "level": [event.level for event in record.events],
        "text": [event.text for event in record.events],
    }
    if content.messages.get(TRANSFORMS_TOPIC):
        tables[TRANSFORMS_TOPIC] = _poses(motion_of(content))
    return tables


def _poses(motion: Motion) -> Columns:
    poses = np.concatenate([motion.xyz, motion.quat], axis=2)  # (n, bodies, 7)
    return {
        "time_s": motion.time_s,
        **{
            f"{body}_{name}": poses[:, i, j]
            for i, body in enumerate(motion.body_names)
            for j, name in enumerate(_POSE)
        },
    }


def _csv(columns: Columns, file: Path) -> None:
    cells = [np.asarray(column).tolist() for column in columns.values()]
    with file.open("x", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*cells, strict=True))  # floats as their repr, hence exact


def _parquet(columns: Columns, file: Path) -> None:
    # Imported here because it is installed only with the extra `export`.
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), file)
