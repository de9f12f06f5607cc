"""Live view: a running simulation over Foxglove's WebSocket protocol."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import socket
import threading
import time
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from mcap.well_known import MessageEncoding, SchemaEncoding

from ..errors import LiveError, install_hint
from ..messages.encoding import Encoded, TimesNs
from ..messages.publisher import Publisher, topics_of
from ..messages.scenery import Scenery
from ..recording.channels import (
    CHANNELS,
    DRIVEN_TOPIC,
    DRIVEN_TRAILER_TOPIC,
    EVENT_TOPIC,
    REFERENCE_PATH_TOPIC,
    SCENE_TOPIC,
    Channel,
)

if TYPE_CHECKING:
    from foxglove.websocket import ChannelView, Client, ServerListener

HOST: Final = "127.0.0.1"  # of this machine only
DEFAULT_PORT: Final = 8765  # the default of Foxglove's own bridges
PROTOCOL: Final = "foxglove.sdk.v1"
"""WebSocket subprotocol, the only one: a viewer that speaks `foxglove.websocket.v1` is refused."""

# Rarely published: a viewer that joins later gets the latest message.
_RETAINED: Final = (
    SCENE_TOPIC,
    REFERENCE_PATH_TOPIC,
    DRIVEN_TOPIC,
    DRIVEN_TRAILER_TOPIC,
    EVENT_TOPIC,
)
_HEADER_BYTES: Final = 16_384  # of an upgrade request
_HEADER_S: Final = 5.0  # until it must be there
_BLOCK: Final = 65_536
_ORIGIN: Final = re.compile(rb"\r\norigin:[ \t]*([^\r\n]*)", re.IGNORECASE)
# Foxglove's site, its desktop program, and pages of this machine. Programs send no origin.
_ALLOWED: Final = re.compile(
    rb"https://([a-z0-9-]+\.)?foxglove\.dev|file://|"
    rb"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?",
    re.IGNORECASE,
)
_REFUSAL: Final = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class LiveView(Publisher):
    """Server of the messages of a run; a `sink.Sink` and a context manager.

    A message is sent when its simulated time has come: the view paces the run and does not change
    it in any other way. Messages that a viewer cannot receive in time are dropped for that viewer.

    Args:
        scenery: static data for viewers.
        name: of the run in viewers.
        port: to listen on; 0 for any free one.
        speed: simulated seconds in a second of the wall clock.
        channels: the flat channels to serve.

    Raises:
        LiveError: the extra `live` is not installed, the port is taken, or a value is out of range.
    """

    def __init__(
        self,
        scenery: Scenery,
        *,
        name: str = "ttempc",
        port: int = DEFAULT_PORT,
        speed: float = 1.0,
        channels: Sequence[Channel] = CHANNELS,
    ) -> None:
        if not (math.isfinite(speed) and speed > 0.0):
            raise LiveError(f"live view: got speed {speed:g}, must be above 0")
        if not 0 <= port < 2**16:
            raise LiveError(f"live view: got port {port}, must be from 0 to 65535")
        try:
            import foxglove
            from foxglove.websocket import Capability
        except ImportError:
            raise LiveError(f"live view: needs foxglove-sdk; {install_hint('live')}") from None
        listener = _listener(port)

        # A channel for each topic that is shown
        context = self._context = foxglove.Context()  # its channels close when it is deleted
        self._channels = {
            topic.name: foxglove.Channel(
                topic.name,
                message_encoding=MessageEncoding.Protobuf,
                schema=foxglove.Schema(
                    name=topic.schema_name, encoding=SchemaEncoding.Protobuf, data=topic.schema
                ),
                metadata=dict(topic.metadata),
                context=context,
            )
            for topic in topics_of(channels)
        }
        self._retained: dict[str, tuple[bytes, int]] = {}
        self._speed = speed
        self._due_ns = 0
        super().__init__(scenery, channels)

        # The server is behind a gate, on a port of its own
        try:
            self._server = foxglove.start_server(
                name=name,
                host=HOST,
                port=0,
                capabilities=[Capability.Time],
                server_listener=_welcome(self),
                context=context,
            )
        except (OSError, RuntimeError) as error:
            listener.close()
            raise LiveError(f"live view: port {port} cannot be opened: {error}") from error
        self._port: int = listener.getsockname()[1]
        self._gate = _OriginGate(listener, self._server.port)
        self._start_s = time.monotonic()

    @property
    def url(self) -> str:
        """Address of the server for viewers."""
        return f"ws://{HOST}:{self._port}"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._gate.close()
        self._server.stop()

    def _send(self, topic: str, times_ns: TimesNs, messages: Encoded) -> None:
        for time_ns, message in zip(times_ns.tolist(), messages, strict=True):
            data = message.tobytes()
            if time_ns > self._due_ns:
                self._wait(time_ns)
            if topic in _RETAINED:
                self._retained[topic] = (data, time_ns)
            self._channels[topic].log(data, log_time=time_ns)

    def _collected(self, time_s: float) -> None:
        self._publish(self._take())

    def _wait(self, time_ns: int) -> None:
        """Sleep until a simulated time has come on the wall clock."""
        due_s = self._start_s + 1e-9 * time_ns / self._speed
        time.sleep(max(0.0, due_s - time.monotonic()))
        self._due_ns = time_ns
        self._server.broadcast_time(time_ns)

    def repeat(self, topic: str, client: int | None) -> None:
        """Send one viewer the latest message of a rarely published topic."""
        if topic in self._retained:
            data, time_ns = self._retained[topic]
            self._channels[topic].log(data, log_time=time_ns, sink_id=client)


def _welcome(view: LiveView) -> ServerListener:
    """Return the listener that sends the retained messages to a viewer that joins."""
    from foxglove.websocket import ServerListener

    class Welcome(ServerListener):
        def on_subscribe(self, client: Client, channel: ChannelView) -> None:
            view.repeat(channel.topic, client.id)

    return Welcome()


def _listener(port: int) -> socket.socket:
    """Return a listening socket.

    Raises:
        LiveError: the port is in use.
    """
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise LiveError(
            f"live view: port {port} is not free ({error.strerror}), give another with --port"
        ) from None
    return listener


class _OriginGate:
    """Gate before a server: no page of a stranger's web site reads a run.

    A browser lets any page open a WebSocket to this machine, and names the page's site in the
    header `Origin` (RFC 6455, section 10.2); a server must check it. Foxglove's does not: it
    listens on a random port, and the gate passes on to it.
    """

    def __init__(self, listener: socket.socket, inner_port: int) -> None:
        self._listener = listener
        self._inner_port = inner_port
        self._runner = asyncio.Runner(loop_factory=asyncio.new_event_loop)
        self._loop = self._runner.get_loop()
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="origin gate", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close all connections."""
        with contextlib.suppress(RuntimeError):  # the loop may be closed already
            self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()

    def _run(self) -> None:
        with self._runner:  # cancels the connections at its end
            self._runner.run(self._main())

    async def _main(self) -> None:
        server = await asyncio.start_server(self._serve, sock=self._listener, limit=_HEADER_BYTES)
        await self._end.wait()
        server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # Errors: the client left, or sent no request. The end of the gate cancels what is open.
        with (
            contextlib.closing(writer),
            contextlib.suppress(OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError),
        ):
            header = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEADER_S)
            if not all(_ALLOWED.fullmatch(origin.strip()) for origin in _ORIGIN.findall(header)):
                writer.write(_REFUSAL)
                return
            behind, onward = await asyncio.open_connection(HOST, self._inner_port)
            with contextlib.closing(onward):
                onward.write(header)
                await asyncio.gather(_copy(reader, onward), _copy(behind, writer))


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass bytes on until one side leaves, which closes the other."""
    with contextlib.closing(writer), contextlib.suppress(OSError):
        while data := await reader.read(_BLOCK):
            writer.write(data)
            await writer.drain()
