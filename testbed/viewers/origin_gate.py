"""Gate before the server of a live view: no page of a stranger's web site reads a run.

A browser lets any page open a WebSocket to this machine, and names the page's site in the header
`Origin` (RFC 6455, section 10.2); a server must check it. Foxglove's server does not. It listens on
an address of this machine that a page cannot guess, and the gate alone connects to it.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import threading
from typing import Final

_HEADER_BYTES: Final = 16_384  # of an upgrade request
_HEADER_S: Final = 5.0  # until it must be there
_CLIENTS: Final = 64  # at a time
_BLOCK: Final = 65_536
_ORIGIN: Final = re.compile(rb"\r\norigin:[ \t]*([^\r\n]*)", re.IGNORECASE)
# Foxglove's site, its desktop program, and pages of this machine. Programs send no origin.
_ALLOWED: Final = re.compile(
    rb"https://([a-z0-9-]+\.)?foxglove\.dev|file://|"
    rb"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?",
    re.IGNORECASE,
)
_REFUSAL: Final = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


def is_allowed(header: bytes) -> bool:
    """Whether the request of a client comes from a program, or a page that may read the run."""
    return all(_ALLOWED.fullmatch(origin.strip()) for origin in _ORIGIN.findall(header))


class OriginGate:
    """Server that passes the connections of allowed origins on to another one.

    Args:
        listener: bound socket of the clients; the gate closes it.
        inner: address and port of the server behind.
    """

    def __init__(self, listener: socket.socket, inner: tuple[str, int]) -> None:
        self._listener, self._inner = listener, inner
        self._clients = 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="origin gate", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close all connections."""
        with contextlib.suppress(RuntimeError):  # closed already
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        server = self._loop.run_until_complete(
            asyncio.start_server(self._serve, sock=self._listener, limit=_HEADER_BYTES)
        )
        self._loop.run_forever()
        server.close()
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self._loop.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients += 1
        try:
            await self._pass_on(reader, writer)
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # the client left, or sent no request
        finally:
            self._clients -= 1
            writer.close()

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        header = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEADER_S)
        if self._clients > _CLIENTS or not is_allowed(header):
            writer.write(_REFUSAL)
            await writer.drain()
            return
        behind, onward = await asyncio.open_connection(*self._inner)
        onward.write(header)
        try:
            ways = (_copy(reader, onward), _copy(behind, writer))
            tasks = [asyncio.ensure_future(way) for way in ways]
            _, open_tasks = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in open_tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        finally:
            onward.close()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(_BLOCK):
        writer.write(data)
        await writer.drain()
