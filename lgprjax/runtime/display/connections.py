"""Connections that cannot hold on to the server: how many, how long, and how much each may make it keep."""

import asyncio
from typing import Any, cast

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

MOST_CONNECTIONS = 64
HTTP_LIFE_S = 5.0
MOST_WAITING = 16
_WRITE_HIGH, _WRITE_MOST = 16 << 10, 128 << 10


class HttpConnection(H11Protocol):
    """A connection that fetches the page's few files and then ends or becomes a websocket."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: one too many is closed at once, every other after ``HTTP_LIFE_S``, however slowly it speaks."""
        super().connection_made(cast(asyncio.Transport, transport))
        if len(self.connections) > MOST_CONNECTIONS:
            self.transport.abort()
            return
        self.transport.set_write_buffer_limits(high=_WRITE_HIGH)
        self.loop.call_later(HTTP_LIFE_S, self._end)

    def data_received(self, data: bytes) -> None:
        """asyncio: what the parser did not foresee ends this connection and nothing else."""
        try:
            super().data_received(data)
        except Exception:
            self.transport.abort()

    def _end(self) -> None:
        if self.transport.get_protocol() is self:
            self.transport.abort()


class PageSocket(WebSocketsSansIOProtocol):
    """A websocket of which only a few messages, fragments and unread answers wait."""

    def data_received(self, data: bytes) -> None:
        """asyncio: what the parser did not foresee ends this connection and nothing else."""
        try:
            super().data_received(data)
        except Exception:
            self.transport.abort()
        # Pings are answered outside the flow control: who does not read the answers is let go.
        if self.transport.get_write_buffer_size() > _WRITE_MOST:
            self.transport.abort()

    async def send(self, message: Any) -> None:
        """ASGI: what is sent after this line was ended for a fault finds nobody there."""
        await self.writable.wait()
        if self.close_sent or self.transport.is_closing():
            raise ClientDisconnected
        await super().send(message)

    def send_receive_event_to_app(self) -> None:
        """A whole message came; many may have come at once."""
        if self.queue.qsize() >= MOST_WAITING:
            self.transport.abort()
        if not self.transport.is_closing():
            super().send_receive_event_to_app()

    def handle_ping(self) -> None:
        """A ping came; many may have come at once, and the first answer may have found nobody there."""
        if not self.transport.is_closing():
            super().handle_ping()

    def handle_cont(self, event: Frame) -> None:
        """A fragment came; empty ones are not bounded by the size of a message."""
        if len(self.frames) >= MOST_WAITING:
            self.transport.abort()
        if not self.transport.is_closing():
            super().handle_cont(event)
