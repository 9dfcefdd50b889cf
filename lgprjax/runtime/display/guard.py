"""What stands before the page: every request is held against ``Access``, every answer gets its headers."""

import logging
from collections import Counter
from urllib.parse import parse_qs

from h11 import LocalProtocolError
from starlette.datastructures import MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect

from lgprjax.runtime.display.access import COOKIE, Access

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
    """An ASGI application that lets through to another one what may come in.

    Args:
        app: behind it.
        access: the rules.
        counts: of what was refused, by reason.
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
            # The last one: the server itself answered that the rest of the request is malformed.
            self._counts["connection gone"] += 1
        except Exception:
            _log.exception("the display failed at a request")
            raise

    def _answer(self, scope: Scope) -> Response | None:
        headers, server = scope["headers"], scope["server"]
        asks_http = scope["type"] == "http"
        looks = asks_http and scope["method"] in ("GET", "HEAD")
        if not self._access.host_is_ours(headers, server):
            return self._refuse("host", 421, "This page is not known by that name.")
        if not looks and not self._access.origin_is_ours(headers, server):
            return self._refuse("origin", 403, "Another page may not ask this one for anything.")
        if asks_http and not looks:
            return self._refuse("method", 405, "There is nothing here but to look at.", allow="GET, HEAD")
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
    # Not every browser counts a websocket of the same address as 'self'. The host was checked, thus safe to repeat.
    host = next((value.decode("latin-1") for key, value in scope["headers"] if key == b"host"), "")
    socket = f" ws://{host}" if host.replace(":", "").replace(".", "").replace("-", "").isalnum() else ""

    async def with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers[name] = value.replace("{socket}", socket)
        await send(message)

    return with_headers
