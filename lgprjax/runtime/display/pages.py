"""The page's files and its websocket: the state to every viewer ten times a second, the newest only."""

import asyncio
import json
import secrets
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from lgprjax.runtime.display.access import Access
from lgprjax.runtime.display.board import Board
from lgprjax.runtime.display.guard import Guard
from lgprjax.runtime.display.route_request import Refused, RequestGate
from lgprjax.runtime.records import Kind, Record, Source, pack
from lgprjax.runtime.ring import Ring

MOST_VIEWERS = 8
REFUSALS_BEFORE_CLOSED = 10
_PAGE = Path(__file__).parent / "page"
_FILES = {
    "/": ("index.html", "text/html"),
    "/style.css": ("style.css", "text/css"),
    "/display.js": ("display.js", "text/javascript"),
    "/plan.js": ("plan.js", "text/javascript"),
    "/field.js": ("field.js", "text/javascript"),
}


class Pages:
    """The application.

    Args:
        board: what is shown.
        requests: ring to the control process.
        access: who may come in.

    Attributes:
        app: to be served.
        counts: of what was refused, by reason.
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
        """Have the state sent to every viewer that is not still busy with an earlier one."""
        for due in self._due:
            due.set()

    async def _socket(self, websocket: WebSocket) -> None:
        await websocket.accept()
        if len(self._due) >= MOST_VIEWERS:
            self.counts["viewers"] += 1
            await websocket.close(1013, f"{MOST_VIEWERS} displays are open already")
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

    def _ask(self, name: str, mono_ns: int) -> str | None:
        obstacle = self._board.obstacle(name, mono_ns)
        if obstacle is None:
            payload = json.dumps({"select_route": name}).encode()
            if not self._requests.put(pack(Record(Kind.REQUEST, Source.DISPLAY, 0, mono_ns, payload))):
                obstacle = "the control process takes no requests"
        if obstacle is not None:
            self.counts["route"] += 1
        return obstacle


def _file(name: str, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    content = (_PAGE / name).read_bytes()

    async def answer(request: Request) -> Response:
        del request
        return Response(content, media_type=media_type)

    return answer
