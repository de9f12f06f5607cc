"""Writes a run as an MCAP log that is whole where it exists, and readable where it is torn."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError, TestbedError
from ..messages.publisher import Publisher, topics_of
from ..messages.scenery import Scenery
from ..recording.channels import CHANNELS, Channel
from .mcap_file import McapFile

PROGRAM: Final = "ttempc"  # what wrote the log, in its header
RUN_METADATA: Final = "run"  # the name of the MCAP metadata record that describes the run
FORMAT_KEY: Final = "log_format"
FORMAT: Final = "1"  # raised whenever a reader of the old logs would misread the new ones

_FLUSH_PERIOD_S: Final = 5.0  # what a killed process can lose, in simulated time
MEDIA_TYPES: Final = {
    ".toml": "application/toml",
    ".xml": "application/xml",
    ".npz": "application/zip",
}


class LogWriter(Publisher):
    """A log being written; a `testbed.recording.sink.Sink` and a context manager.

    The file is `<path>.part` until the `with` block is left. It gets its name where the run ended
    by design: without an exception, or with one of the testbed's own, as when the plant
    diverges. It stays a `.part`, readable up to its last flush, where anything else ended the run
    or the log itself could not be written.

    Raises:
        LogError: the log or its part exists already, or the file cannot be written.
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
        self.part = path.with_name(path.name + ".part")
        for file in (self.file, self.part):
            if file.exists():
                raise LogError(f"{file}: exists already and is not written over")
        with self._writing():
            self._stream = open(self.part, "xb")  # noqa: SIM115 - closed by __exit__
        self._mcap = McapFile(self._stream, library=PROGRAM)
        self._mcap.add_metadata(RUN_METADATA, {**metadata, FORMAT_KEY: FORMAT})
        for name, content in attachments.items():
            media_type = MEDIA_TYPES.get(Path(name).suffix, "text/plain")
            data = content.encode() if isinstance(content, str) else content
            self._mcap.add_attachment(name, media_type, data)
        self._ids = {
            topic.name: self._mcap.add_topic(topic.name, topic.schema_name, topic.schema)
            for topic in topics_of(channels)
        }
        self._next_flush_s = _FLUSH_PERIOD_S
        super().__init__(scenery or Scenery(), channels)

    def __enter__(self) -> Self:
        with self._writing():
            self._stream.flush()  # what describes the run is safe before the run begins
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
            # The error on its way out says more than one of the closing could.
            with contextlib.suppress(OSError):
                self._finish()

    def _finish(self) -> None:
        """Write the index, and hand everything to the disk."""
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

    def _gathered(self, time_s: float) -> None:
        if time_s >= self._next_flush_s:
            self._next_flush_s = time_s + _FLUSH_PERIOD_S
            self._publish()
            with self._writing():
                self._mcap.flush()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn what the file system says into a `LogError`."""
        try:
            yield
        except OSError as error:
            raise LogError(f"{self.part}: cannot be written: {error.strerror}") from error
