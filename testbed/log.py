"""Writes a run as an MCAP log that is whole where it exists, and readable where it is torn."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from testbed.channels import CHANNELS, Channel
from testbed.errors import LogError, TestbedError
from testbed.record import Event
from testbed.schemas import RowEncoder, descriptor_set, message_name
from testbed.truth import Truth
from testbed.viewer_messages import PathEncoder, PoseEncoder, TransformsEncoder, encode_event
from ttempc.types import FloatArray

TRANSFORMS_TOPIC: Final = "/tf"
TRACTOR_TOPIC: Final = "/tractor/pose"
TRAILER_TOPIC: Final = "/trailer/pose"
EVENT_TOPIC: Final = "/log"
REFERENCE_PATH_TOPIC: Final = "/reference/path"  # once, at the start of the run
PREDICTED_PATH_TOPIC: Final = "/mpc/predicted_path"  # of the tractor point, every control tick
PREDICTED_TRAILER_PATH_TOPIC: Final = "/mpc/predicted_path_trailer"

PROGRAM: Final = "ttempc"  # what wrote the log, in its header
RUN_METADATA: Final = "run"  # the name of the MCAP metadata record that describes the run
FORMAT_KEY: Final = "log_format"
FORMAT: Final = "1"  # raised whenever a reader of the old logs would misread the new ones

_FLUSH_PERIOD_S: Final = 5.0  # what a killed process can lose, in simulated time
_CHUNK_BYTES: Final = 4 * 2**20  # far above what a flush period holds: a chunk is a flush
_MEDIA_TYPES: Final = {
    ".toml": "application/toml",
    ".xml": "application/xml",
    ".npz": "application/zip",
}


class LogWriter:
    """A log being written; a `testbed.sink.Sink` and a context manager.

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
        body_names: Sequence[str] = (),
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
        self._writer = Writer(
            self._stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD
        )
        self._writer.start(library=PROGRAM)
        self._writer.add_metadata(RUN_METADATA, {**metadata, FORMAT_KEY: FORMAT})
        for name, content in attachments.items():
            media_type = _MEDIA_TYPES.get(Path(name).suffix, "text/plain")
            data = content.encode() if isinstance(content, str) else content
            self._writer.add_attachment(0, 0, name, media_type, data)
        self._schemas: dict[str, int] = {}
        self._rows = {
            channel.topic: (self._flat_topic(channel), RowEncoder(channel)) for channel in channels
        }
        self._transforms = (
            self._topic(TRANSFORMS_TOPIC, FrameTransforms),
            TransformsEncoder(body_names),
        )
        self._tractor = self._topic(TRACTOR_TOPIC, PoseInFrame)
        self._trailer = self._topic(TRAILER_TOPIC, PoseInFrame)
        self._pose_encoder = PoseEncoder()
        self._events = self._topic(EVENT_TOPIC, Log)
        self._paths: dict[str, tuple[int, PathEncoder]] = {}
        self._next_flush_s = _FLUSH_PERIOD_S

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Write one row, one number per field of the channel.

        Raises:
            ValueError: the number of values is not the channel's.
        """
        topic, encoder = self._rows[channel.topic]
        self._message(topic, time_s, encoder.encode(time_s, values))

    def event(self, event: Event) -> None:
        """Write one event as a log line; its time is kept to the nanosecond."""
        self._message(self._events, event.time_s, encode_event(_ns(event.time_s), event))

    def scene(self, truth: Truth) -> None:
        """Write the transform of every body and the poses of both axle points."""
        time_s, time_ns = truth.time_s, _ns(truth.time_s)
        topic, encoder = self._transforms
        self._message(topic, time_s, encoder.encode(time_ns, truth.body_xyz, truth.body_quat))
        pose = self._pose_encoder
        self._message(self._tractor, time_s, pose.encode(time_ns, truth.tractor))
        self._message(self._trailer, time_s, pose.encode(time_ns, truth.trailer))

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Write a line of points (n, 2) [m], map frame."""
        if topic not in self._paths:
            self._paths[topic] = (self._topic(topic, PosesInFrame), PathEncoder())
        channel, encoder = self._paths[topic]
        self._message(channel, time_s, encoder.encode(_ns(time_s), points))

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
            self._writer.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
        finally:
            self._stream.close()

    def _message(self, topic: int, time_s: float, data: bytes) -> None:
        time_ns = _ns(time_s)
        if time_s >= self._next_flush_s:
            self._next_flush_s = time_s + _FLUSH_PERIOD_S
            with self._writing():
                self._writer.flush()
        self._writer.add_message(topic, time_ns, data, time_ns)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn what the file system says into a `LogError`."""
        try:
            yield
        except OSError as error:
            raise LogError(f"{self.part}: cannot be written: {error.strerror}") from error

    def _flat_topic(self, channel: Channel) -> int:
        schema = self._writer.register_schema(
            message_name(channel), SchemaEncoding.Protobuf, descriptor_set(channel)
        )
        return self._writer.register_channel(channel.topic, MessageEncoding.Protobuf, schema)

    def _topic(self, topic: str, message: Any) -> int:  # noqa: ANN401 - protobuf has no types
        name = message.DESCRIPTOR.full_name
        if name not in self._schemas:
            data = build_file_descriptor_set(message).SerializeToString()
            self._schemas[name] = self._writer.register_schema(name, SchemaEncoding.Protobuf, data)
        return self._writer.register_channel(topic, MessageEncoding.Protobuf, self._schemas[name])


def _ns(time_s: float) -> int:
    return round(time_s * 1e9)
