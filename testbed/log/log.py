"""Log writer: a run as an MCAP file."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from ..atomic_write import partial_path
from ..errors import LogError, TestbedError
from ..messages.publisher import Publisher, topics_of
from ..messages.scenery import Scenery
from ..recording.channels import CHANNELS, Channel
from .mcap_file import McapFile

PROGRAM: Final = "ttempc"  # writer of the log, in its header
RUN_METADATA: Final = "run"  # the name of the MCAP metadata record that describes the run
FORMAT_KEY: Final = "log_format"
FORMAT: Final = "1"  # incremented when an old reader would misread a new log

_FLUSH_PERIOD_S: Final = 5.0  # simulated time that a killed process can lose
_MEDIA_TYPES: Final = {
    ".toml": "application/toml",
    ".xml": "application/xml",
    ".npz": "application/zip",
}


def media_type(name: str) -> str:
    """Return the media type of an attachment from the suffix of its name."""
    return _MEDIA_TYPES.get(Path(name).suffix, "text/plain")


def refuse_existing_log(path: Path) -> None:
    """Refuse to write a log over an existing log or partial log.

    Raises:
        LogError: one of them exists.
    """
    for file in (path, partial_path(path)):
        if file.exists():
            raise LogError(f"{file}: exists already and is not written over")


class LogWriter(Publisher):
    """Writer of one log; a `testbed.recording.sink.Sink` and a context manager.

    The file is `<path>.part` until the `with` block ends. It is renamed to `path` after a regular
    end: no exception, or one of the testbed's own, such as a diverged plant. After any other
    exception, or if the log could not be written, the `.part` stays: it is readable up to its last
    flush. In this it differs from `atomic_write`, which removes the partial file.

    Raises:
        LogError: the log or its partial file exists already, or the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        *,
        metadata: Mapping[str, str],
        attachments: Mapping[str, str | bytes],
        scenery: Scenery | None = None,
        channels: Sequence[Channel] = CHANNELS,
    ) -> None:
        self.file = path
        self.metadata = dict(metadata)
        self.part = partial_path(path)
        refuse_existing_log(path)
        with self._writing():
            self._stream = open(self.part, "xb")  # noqa: SIM115 - closed by __exit__
            self._mcap = McapFile(self._stream, library=PROGRAM)
            self._mcap.add_metadata(RUN_METADATA, {**metadata, FORMAT_KEY: FORMAT})
            for name, content in attachments.items():
                data = content.encode() if isinstance(content, str) else content
                self._mcap.add_attachment(name, media_type(name), data)
            self._ids = {
                topic.name: self._mcap.add_topic(
                    topic.name, topic.schema_name, topic.schema, topic.metadata
                )
                for topic in topics_of(channels)
            }
        self._next_flush_s = _FLUSH_PERIOD_S
        super().__init__(scenery or Scenery(), channels)

    def __enter__(self) -> Self:
        with self._writing():
            self._stream.flush()  # metadata and attachments, before the run begins
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        by_design = isinstance(error, TestbedError) and not isinstance(error, LogError)
        if error is None or by_design:
            with self._writing():
                self._finish()
                self.part.rename(self.file)
        else:
            # The exception that ended the run is more useful than one of closing the file.
            with contextlib.suppress(OSError):
                self._finish()

    def _finish(self) -> None:
        """Write the index, flush to the disk and close the file."""
        try:
            self._publish()
            self._mcap.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
        finally:
            self._stream.close()

    def _send(self, topic: str, time_ns: int, data: bytes) -> None:
        self._mcap.add_message(self._ids[topic], time_ns, data)

    def _send_all(
        self, topic: str, times_ns: NDArray[np.int64], messages: NDArray[np.uint8]
    ) -> None:
        self._mcap.add_messages(self._ids[topic], times_ns, messages)

    def _collected(self, time_s: float) -> None:
        if time_s >= self._next_flush_s:
            self._next_flush_s = time_s + _FLUSH_PERIOD_S
            self._publish()
            with self._writing():
                self._mcap.flush()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Convert an `OSError` to a `LogError`."""
        try:
            yield
        except OSError as error:
            raise LogError(f"{self.part}: cannot be written: {error.strerror}") from error
