"""Log writer: a run as an MCAP file, one chunk per flush, with all indexes and checksums."""

import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Self

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer

from ..atomic_write import partial_path
from ..errors import LogError, TestbedError
from ..messages.publisher import Publisher, Topic, topics_of
from ..messages.scenery import Scenery
from ..recording import channels as flat

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


def begin_log(
    stream: BinaryIO,
    metadata: Mapping[str, str],
    attachments: Mapping[str, str | bytes],
    topics: Iterable[Topic],
) -> tuple[Writer, dict[str, int]]:
    """Write the start of a log; return the writer and the number of each topic's MCAP channel."""
    mcap = Writer(stream, enable_data_crcs=True)
    mcap.start(library=PROGRAM)
    mcap.add_metadata(RUN_METADATA, {**metadata, FORMAT_KEY: FORMAT})
    for name, content in attachments.items():
        data = content.encode() if isinstance(content, str) else content
        mcap.add_attachment(0, 0, name, _MEDIA_TYPES.get(Path(name).suffix, "text/plain"), data)
    schemas: dict[str, int] = {}
    numbers = {}
    for topic in topics:
        name = topic.schema_name
        if name not in schemas:
            schemas[name] = mcap.register_schema(name, SchemaEncoding.Protobuf, topic.schema)
        numbers[topic.name] = mcap.register_channel(
            topic.name, MessageEncoding.Protobuf, schemas[name], dict(topic.metadata)
        )
    return mcap, numbers


def refuse_existing_log(path: Path) -> None:
    """Refuse to write a log over an existing log or partial log.

    Raises:
        LogError: one of them exists.
    """
    for file in (path, partial_path(path)):
        if file.exists():
            raise LogError(f"{file}: exists already and is not written over")


class LogWriter(Publisher):
    """Writer of one log; a sink and a context manager.

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
        channels: Sequence[flat.Channel] = flat.CHANNELS,
    ) -> None:
        self.file = path
        self.metadata = dict(metadata)
        self.part = partial_path(path)
        refuse_existing_log(path)
        with self._writing():
            self._stream = open(self.part, "xb")  # noqa: SIM115 - closed by __exit__
            self._mcap, self._numbers = begin_log(
                self._stream, metadata, attachments, topics_of(channels)
            )
        self._next_flush_s = _FLUSH_PERIOD_S
        super().__init__(scenery or Scenery(), channels)

    def __enter__(self) -> Self:
        with self._writing():
            self._mcap.flush()  # metadata and attachments, before the run begins
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
        self._mcap.add_message(self._numbers[topic], time_ns, data, time_ns)

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
