"""Log writer: a run as an MCAP file, encoded, packed and written by a thread."""

import contextlib
import mimetypes
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO, Final, Self

from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from ..atomic_write import partial_path
from ..errors import LogError, TestbedError
from ..messages.encoding import Encoded, TimesNs
from ..messages.publisher import Batch, Publisher, Topic, topics_of
from ..messages.scenery import Scenery
from ..recording import channels as flat
from .mcap_file import McapFile

PROGRAM: Final = "ttempc"  # writer of the log, in its header
RUN_METADATA: Final = "run"  # the name of the MCAP metadata record that describes the run
FORMAT_KEY: Final = "log_format"
FORMAT: Final = "1"  # incremented when an old reader would misread a new log

# Simulated time that is collected for a chunk, and after which it must be in the file. A killed
# process loses no more than their sum.
_PERIOD_S: Final = 4.0
_LATE_S: Final = 1.0


def begin_log(
    stream: BinaryIO,
    metadata: Mapping[str, str],
    attachments: Mapping[str, str | bytes],
    topics: Iterable[Topic],
) -> tuple[McapFile, dict[str, int]]:
    """Write the start of a log; return its file and the number of each topic's MCAP channel."""
    file = McapFile(stream, PROGRAM)
    file.put(Metadata(RUN_METADATA, {**metadata, FORMAT_KEY: FORMAT}))
    for name, content in attachments.items():
        data = content.encode() if isinstance(content, str) else content
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        file.put(Attachment(0, 0, name, kind, data))
    schemas: dict[str, int] = {}
    numbers: dict[str, int] = {}
    for number, topic in enumerate(topics, start=1):
        name = topic.schema_name
        if name not in schemas:
            schemas[name] = 1 + len(schemas)
            file.put(Schema(schemas[name], topic.schema, SchemaEncoding.Protobuf, name))
        about = dict(topic.metadata)
        encoding = MessageEncoding.Protobuf
        file.put(Channel(number, topic.name, encoding, about, schemas[name]))
        numbers[topic.name] = number
    return file, numbers


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
        self.part = partial_path(path)
        refuse_existing_log(path)
        with self._writing():
            self._stream = open(self.part, "xb")  # noqa: SIM115 - closed by __exit__
            self._mcap, self._numbers = begin_log(
                self._stream, metadata, attachments, topics_of(channels)
            )
        self._thread = ThreadPoolExecutor(1, "log")  # starts with the first batch
        self._written: Future[None] | None = None  # the batch that a thread writes
        self._next_s = _PERIOD_S
        super().__init__(scenery or Scenery(), channels)

    def __enter__(self) -> Self:
        with self._writing():
            self._mcap.flush()  # metadata and attachments, before the run begins
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        by_design = isinstance(error, TestbedError) and not isinstance(error, LogError)
        if error is None or by_design:
            with self._writing():
                self._finish()
                self.part.rename(self.file)
        else:
            # The exception that ended the run is more useful than one of closing the file.
            with contextlib.suppress(OSError):
                self._finish()
            error.add_note(f"the log up to then is {self.part}")

    def _finish(self) -> None:
        """Write the rest and the index, flush to the disk and close the file."""
        try:
            self._hand_over()
            self._wait()
            self._mcap.finish()
            os.fsync(self._stream.fileno())
        finally:
            self._thread.shutdown()
            self._stream.close()

    def _send(self, topic: str, times_ns: TimesNs, messages: Encoded) -> None:
        self._mcap.add(self._numbers[topic], times_ns, messages)

    def _collected(self, time_s: float) -> None:
        if self._written and time_s >= self._next_s - _PERIOD_S + _LATE_S:
            self._wait()
        if time_s >= self._next_s:
            self._next_s = time_s + _PERIOD_S
            self._hand_over()

    def _hand_over(self) -> None:
        """Let the thread encode and write what was collected."""
        self._written = self._thread.submit(self._publish, self._take())

    def _publish(self, batch: Batch) -> None:
        super()._publish(batch)
        self._mcap.flush()

    def _wait(self) -> None:
        """Wait until the latest batch is in the file; raise what its thread raised."""
        written, self._written = self._written, None
        with self._writing():
            if written:
                written.result()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Convert an `OSError` to a `LogError`."""
        try:
            yield
        except OSError as error:
            raise LogError(f"{self.part}: cannot be written: {error.strerror}") from error
