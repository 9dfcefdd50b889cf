"""The page's files and its websocket: the state to every viewer ten times per second, the newest only."""

import asyncio
import json
import logging
import secrets
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, cast
from urllib.parse import parse_qs

from h11 import LocalProtocolError
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from lgprjax.run_records import Record, RecordKind, Source, pack
from lgprjax.runtime.display.access import COOKIE, Access, Refused, RequestGate, Wanted
from lgprjax.runtime.display.board import Board
from lgprjax.runtime.ring import Ring

# Guard of the page: every request is checked by ``Access``, every response gets its headers.

_log = logging.getLogger(__name__)

_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'{socket}; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "cache-control": "no-store",
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}


class Guard:
    """An ASGI application that passes permitted requests to another one.

    Args:
        app: application behind the guard.
        access: access rules.
        counts: number of refused requests, by reason.
    """

    def __init__(self, app: ASGIApp, access: Access, counts: Counter[str]) -> None:
        self._app = app
        self._access = access
        self._counts = counts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        answer = self._answer(scope)
        try:
            if answer is None:
                await self._app(scope, receive, _dressed(scope, send))
            elif scope["type"] == "http":
                await answer(scope, receive, _dressed(scope, send))
            else:
                await send({"type": "websocket.close", "code": 1008, "reason": ""})
        except (OSError, WebSocketDisconnect, LocalProtocolError):
            # The last one: the server itself answered that the request is malformed.
            self._counts["connection gone"] += 1
        except Exception:
            _log.exception("the display failed to answer a request")
            raise

    def _answer(self, scope: Scope) -> Response | None:
        headers, server = scope["headers"], scope["server"]
        asks_http = scope["type"] == "http"
        looks = asks_http and scope["method"] in ("GET", "HEAD")
        if not self._access.host_is_ours(headers, server):
            return self._refuse("host", 421, "Unknown host name.")
        if not looks and not self._access.origin_is_ours(headers, server):
            return self._refuse("origin", 403, "Requests from other web pages are not allowed.")
        if asks_http and not looks:
            return self._refuse("method", 405, "Only read requests are allowed.", allow="GET, HEAD")
        tokens = _query(scope["query_string"]).get("token", [])
        if asks_http and scope["path"] == "/" and len(tokens) == 1 and self._access.token_is_right(tokens[0]):
            # The token leaves the address bar, and with it the browser's history.
            redirect = RedirectResponse("/", 303)
            redirect.set_cookie(COOKIE, self._access.cookie(), httponly=True, samesite="strict")
            return redirect
        if not self._access.is_let_in(headers):
            return self._refuse("token", 401, "Open this page once as /?token=TOKEN, with the token of display.token.")
        return None

    def _refuse(self, reason: str, status: int, text: str, **headers: str) -> Response:
        self._counts[reason] += 1
        return PlainTextResponse(text + "\n", status, headers={"connection": "close", **headers})


def _query(query: bytes) -> dict[str, list[str]]:
    try:
        return parse_qs(query.decode("latin-1"), max_num_fields=4)
    except ValueError:
        return {}


def _dressed(scope: Scope, send: Send) -> Send:
    # Not every browser treats a websocket of the same address as 'self'. The host was checked, so that repeating it is
    # safe.
    host = next((value.decode("latin-1") for key, value in scope["headers"] if key == b"host"), "")
    socket = f" ws://{host}" if host.replace(":", "").replace(".", "").replace("-", "").isalnum() else ""

    async def with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers[name] = value.replace("{socket}", socket)
        await send(message)

    return with_headers


MOST_VIEWERS = 8
REFUSALS_BEFORE_CLOSED = 10
_PAGE = Path(__file__).parent / "page"
_FILES = {
    "/": ("index.html", "text/html"),
    "/style.css": ("style.css", "text/css"),
    "/display.js": ("display.js", "text/javascript"),
    "/plan.js": ("plan.js", "text/javascript"),
    "/field.js": ("field.js", "text/javascript"),
    "/record.js": ("record.js", "text/javascript"),
}


class Pages:
    """The application.

    Args:
        board: state to show.
        requests: ring to the control process.
        access: access rules.

        Attributes:
        app: application to serve.
        counts: number of refused requests, by reason.
    """

    def __init__(self, board: Board, requests: Ring, access: Access) -> None:
        self.counts: Counter[str] = Counter()
        self._board = board
        self._requests = requests
        self._due: set[asyncio.Event] = set()
        routes = [Route(path, _file(*file)) for path, file in _FILES.items()]
        starlette = Starlette(routes=[*routes, WebSocketRoute("/socket", self._socket)])
        self.app = Guard(starlette, access, self.counts)

    def push(self) -> None:
        """Send the state to every viewer that is not still busy with an earlier one."""
        for due in self._due:
            due.set()

    async def _socket(self, websocket: WebSocket) -> None:
        await websocket.accept()
        if len(self._due) >= MOST_VIEWERS:
            self.counts["viewers"] += 1
            await websocket.close(1013, f"{MOST_VIEWERS} displays are already open")
            return
        due = asyncio.Event()
        self._due.add(due)
        session = secrets.token_hex(16)
        sender = asyncio.create_task(self._send(websocket, session, due))
        try:
            abusive = await self._receive(websocket, RequestGate(session))
        finally:
            self._due.discard(due)
            sender.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect):
                await sender
        if abusive:
            self.counts["closed"] += 1
            await websocket.close(1008, "too many refused messages")

    async def _send(self, websocket: WebSocket, session: str, due: asyncio.Event) -> None:
        await websocket.send_text(json.dumps({"kind": "hello", "session": session}))
        path, worked = -1, -1
        while True:
            new_path, new_worked = self._board.path_version, self._board.worked_version
            text = self._board.text(
                time.monotonic_ns(),
                self.counts.total(),
                with_path=new_path != path,
                with_worked=new_worked != worked,
            )
            await websocket.send_text(text)
            path, worked = new_path, new_worked
            due.clear()
            await due.wait()

    async def _receive(self, websocket: WebSocket, gate: RequestGate) -> bool:
        refusals = 0
        while refusals < REFUSALS_BEFORE_CLOSED:
            message = await websocket.receive()
            if message["type"] == "websocket.disconnect":
                return False
            mono_ns = time.monotonic_ns()
            wanted = gate.judge(message.get("text"), mono_ns)
            if isinstance(wanted, Refused):
                refusals += 1
                self.counts[wanted.name.lower()] += 1
                obstacle: str | None = wanted.value
            else:
                obstacle = self._ask(wanted, mono_ns)
            try:
                await websocket.send_text(json.dumps({"kind": "answer", "refused": obstacle}))
            except WebSocketDisconnect:
                return False
        return True

    def _ask(self, wanted: Wanted, mono_ns: int) -> str | None:
        obstacle = self._board.obstacle(wanted, mono_ns)
        if obstacle is None:
            payload = json.dumps(wanted).encode()
            if not self._requests.put(pack(Record(RecordKind.REQUEST, Source.DISPLAY, 0, mono_ns, payload))):
                obstacle = "the control process accepts no requests"
        if obstacle is not None:
            self.counts["route"] += 1
        return obstacle


def _file(name: str, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    content = (_PAGE / name).read_bytes()

    async def answer(request: Request) -> Response:
        del request
        return Response(content, media_type=media_type)

    return answer


# Limits of connections: number, duration, and memory of each.

MOST_CONNECTIONS = 64
HTTP_LIFE_S = 5.0
MOST_WAITING = 16
_WRITE_HIGH, _WRITE_MOST = 16 << 10, 128 << 10


class HttpConnection(H11Protocol):
    """A connection that fetches the page's few files and then ends or becomes a websocket."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: excess connections are closed at once, every other after ``HTTP_LIFE_S``, however slow."""
        super().connection_made(cast(asyncio.Transport, transport))
        if len(self.connections) > MOST_CONNECTIONS:
            self.transport.abort()
            return
        self.transport.set_write_buffer_limits(high=_WRITE_HIGH)
        self.loop.call_later(HTTP_LIFE_S, self._end)

    def data_received(self, data: bytes) -> None:
        """asyncio: an unexpected parser error ends this connection only."""
        try:
            super().data_received(data)
        except Exception:
            self.transport.abort()

    def _end(self) -> None:
        if self.transport.get_protocol() is self:
            self.transport.abort()


class PageSocket(WebSocketsSansIOProtocol):
    """A websocket with bounded queues of messages, fragments and unread answers."""

    def data_received(self, data: bytes) -> None:
        """asyncio: an unexpected parser error ends this connection only."""
        try:
            super().data_received(data)
        except Exception:
            self.transport.abort()
        # Pings are answered outside the flow control: clients that do not read the answers are dropped.
        if self.transport.get_write_buffer_size() > _WRITE_MOST:
            self.transport.abort()

    async def send(self, message: Any) -> None:
        """ASGI: data sent after the connection was ended for a fault are dropped."""
        await self.writable.wait()
        if self.close_sent or self.transport.is_closing():
            raise ClientDisconnected
        await super().send(message)

    def send_receive_event_to_app(self) -> None:
        """A complete message arrived; many may have arrived at once."""
        if self.queue.qsize() >= MOST_WAITING:
            self.transport.abort()
        if not self.transport.is_closing():
            super().send_receive_event_to_app()

    def handle_ping(self) -> None:
        """A ping arrived; many may have arrived at once, and the connection may be closed after the first answer."""
        if not self.transport.is_closing():
            super().handle_ping()

    def handle_cont(self, event: Frame) -> None:
        """A fragment arrived; empty ones are not bounded by the size of a message."""
        if len(self.frames) >= MOST_WAITING:
            self.transport.abort()
        if not self.transport.is_closing():
            super().handle_cont(event)
