"""The display process: it reads the control process's state, serves the page and forwards requests."""

import asyncio
import contextlib
import signal
import socket
from collections.abc import Generator

import uvicorn

from lgprjax.errors import InputError
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.display.access import LARGEST_BYTES, Access
from lgprjax.runtime.display.board import Board
from lgprjax.runtime.display.pages import MOST_CONNECTIONS, HttpConnection, Pages, PageSocket
from lgprjax.runtime.process import ProcessStage, Started

ADDRESS_FILE = "display.url"
"""File in the folder of the rings with the address of the page, for a port chosen by the system."""
_LOOK_S = 0.05
_LOOKS_A_PUSH = 2
_SEND_BUFFER = 32 << 10


def run(started: Started) -> None:
    """Serve the page until SIGTERM.

    Args:
        started: rings ``state`` and ``requests`` are used, and ``display`` of the configuration.

    Raises:
        InputError: the address is reachable by others without a token, or cannot be bound.
    """
    started.beat(ProcessStage.STARTING)
    access = Access(started.config)
    with _listen(started.config) as listener:
        host, port = listener.getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        fresh = started.rings / f"{ADDRESS_FILE}.new"
        fresh.write_text(f"http://{shown}:{port}/", encoding="ascii")
        fresh.rename(started.rings / ADDRESS_FILE)
        asyncio.run(_serve(started, access, listener))


class _Server(uvicorn.Server):
    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None, None, None]:
        """The process's loop handles them."""
        yield


async def _serve(started: Started, access: Access, listener: socket.socket) -> None:
    state, worked, scans = (started.ring(name) for name in ("state", "worked", "page_scans"))
    board = Board()
    pages = Pages(board, started.ring("requests"), access)
    server = _Server(_settings(pages))
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, setattr, server, "should_exit", True)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    looks = 0
    while not serving.done():
        board.take(state.take())
        board.take_worked(worked.take())
        looks += 1
        if looks % _LOOKS_A_PUSH == 0:
            board.take_scans(scans.take())
            pages.push()
        started.beat(
            ProcessStage.ENDING
            if server.should_exit
            else ProcessStage.READY
            if server.started
            else ProcessStage.STARTING
        )
        await asyncio.sleep(_LOOK_S)
    await serving


def _settings(pages: Pages) -> uvicorn.Config:
    return uvicorn.Config(
        pages.app,
        loop="asyncio",
        http=HttpConnection,
        ws=PageSocket,
        ws_max_size=LARGEST_BYTES,
        ws_ping_interval=5.0,
        ws_ping_timeout=5.0,
        # A compressed message expands beyond its received size.
        ws_per_message_deflate=False,
        # Also the number of connections accepted at once before the limit applies.
        backlog=MOST_CONNECTIONS,
        h11_max_incomplete_event_size=8 << 10,
        lifespan="off",
        interface="asgi3",
        log_config=None,
        # Anybody can cause a logged bad request. The application logs its own failures.
        log_level="critical",
        access_log=False,
        proxy_headers=False,
        server_header=False,
        date_header=False,
        timeout_graceful_shutdown=1,
    )


def _listen(config: RuntimeConfig) -> socket.socket:
    host, port = config.display.host, config.display.port
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listener = socket.create_server((host, port), family=family)
    except OSError as error:
        found = f"{host}:{port}: {error.strerror or error}"
        raise InputError(config.file, "display", "an address to listen at", found) from None
    # Inherited by connections: data for a slow viewer must not wait until they are old.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
    return listener
