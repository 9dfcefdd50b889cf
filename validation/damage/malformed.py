"""Messages that no browser would send, as bytes on a line of their own, drawn from a seed."""

import base64
import json
import random
import struct

GOOD_ROUTE, BAD_ROUTE = "meadow", "quarry"

_LENGTHS = ["-1", "1e9", "99999999999999999999", "5\r\nContent-Length: 6", "0x10", "", "18446744073709551616"]
_LINES = [
    *(b"GET", b"GET /", b"GET / HTTP/9.9", b"GET  /  HTTP/1.1", b"\r\n\r\nGET"),
    *(b"GET / HTTP/1.1 x", b"PRI * HTTP/2.0"),
]
_CHUNKS = [
    *(b"zz\r\n", b"-5\r\nhello", b"ffffffffffffffff\r\nx", b"5\r\nhelloXX"),
    *(b"5;" + b"e" * 9_000, b"0\r\n\r\n"),
]
_PATHS = ["/../../etc/passwd", "/%2e%2e/%00", "/%ff%fe", "http://evil/", "*", "//", "/?" + "&a" * 900]
_NO_NAMES = [b"null", b"[]", b'{"engage":1}', b"true", b"NaN", b'""']


def request_head(host: str, *, line: str = "GET / HTTP/1.1", more: str = "") -> bytes:
    """A request without fault."""
    return f"{line}\r\nHost: {host}\r\n{more}\r\n".encode("latin-1")


def upgrade(host: str, draw: random.Random, *, version: str = "13", origin: str | None = None, more: str = "") -> bytes:
    """A websocket's request; without more words a good one."""
    key = base64.b64encode(draw.randbytes(16)).decode()
    asked = f"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
    asked += f"Sec-WebSocket-Version: {version}\r\nOrigin: {origin or f'http://{host}'}\r\n"
    return request_head(host, line="GET /socket HTTP/1.1", more=asked + more)


def malformed_http(host: str, draw: random.Random) -> bytes:
    """One malformed, foreign or unfinished HTTP message."""
    good = request_head(host)
    post = request_head(host, line="POST / HTTP/1.1", more=f"Origin: http://{host}\r\nTransfer-Encoding: chunked\r\n")
    length = draw.choice(_LENGTHS)
    flipped = bytearray(upgrade(host, draw) if draw.random() < 0.5 else good)
    # The Origin stays broken, so that no mutation makes a good websocket of it.
    flipped = bytearray(bytes(flipped).replace(b"Origin: http", b"Origin: hxxp"))
    for _ in range(draw.randint(1, 8)):
        flipped[draw.randrange(len(flipped))] = draw.randrange(256)
    kinds = [
        lambda: draw.randbytes(draw.randint(1, 400)),
        lambda: draw.randbytes(draw.randint(1, 40)) + b"\r\n\r\n",
        lambda: draw.choice(_LINES) + b"\r\n\r\n",
        lambda: b"GET /" + b"a" * draw.choice([300, 9_000, 70_000]) + b" HTTP/1.1\r\n\r\n",
        lambda: request_head(host, more="X: " + "y" * draw.choice([8_000, 20_000, 90_000]) + "\r\n"),
        lambda: request_head(host, more="".join(f"X{i}: y\r\n" for i in range(draw.choice([100, 900])))),
        lambda: request_head(host, more="Cookie: " + "lgprjax_display=;" * draw.randint(1, 300) + "\r\n"),
        lambda: post + draw.choice(_CHUNKS),
        lambda: request_head(host, line="POST /engage HTTP/1.1", more=f"Content-Length: {length}\r\n") + b"x" * 50,
        lambda: good[: draw.randrange(1, len(good))],
        lambda: bytes(flipped),
        lambda: good.replace(b"Host", draw.choice([b"Host ", b"H\x00st", b"\tHost", b"Ho\xffst"])),
        lambda: request_head(draw.choice(["evil.example", "[", f"{host}@evil", "\xff\xfe", host + "0", ""])),
        lambda: request_head(host, line=f"{draw.choice(['PUT', 'TRACE', 'CONNECT', 'DELETE', 'engage'])} / HTTP/1.1"),
        lambda: request_head(host, line=f"GET {draw.choice(_PATHS)} HTTP/1.1"),
        lambda: request_head(host, line="GET /?token=" + draw.choice(["%ff", "%", "\xe9", "a" * 4000]) + " HTTP/1.1"),
        lambda: upgrade(host, draw, version=draw.choice(["12", "0", "x", "99999999"])),
        lambda: upgrade(
            host, draw, origin=draw.choice(["null", "http://evil.example", "\xff", "http://" + host + ".evil"])
        ),
        lambda: upgrade(host, draw, more="Sec-WebSocket-Key: again\r\n"),
        lambda: upgrade(host, draw).replace(b"Key: ", b"Key: " + b"A" * draw.randint(1, 50)),
        lambda: upgrade(host, draw, more="".join(f"X{i}: y\r\n" for i in range(200))),
        lambda: upgrade(host, draw).replace(b"/socket", draw.choice([b"/engage", b"/socket/x", b"/"])),
        lambda: good + good + draw.randbytes(20),
    ]
    return draw.choice(kinds)()


def frame(payload: bytes, draw: random.Random, *, opcode: int = 1, last: bool = True, reserved: int = 0) -> bytes:
    """A websocket frame of a client."""
    length = len(payload)
    head = bytes([(0x80 if last else 0) | reserved << 4 | opcode])
    if length < 126:
        head += bytes([0x80 | length])
    elif length < 1 << 16:
        head += b"\xfe" + struct.pack(">H", length)
    else:
        head += b"\xff" + struct.pack(">Q", length)
    mask = draw.randbytes(4)
    return head + mask + bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))


def wish(session: str, number: int, route: str) -> bytes:
    """A good request's text."""
    return json.dumps({"session": session, "number": number, "select_route": route}).encode()


def malformed_frame(session: str, last_number: int, draw: random.Random) -> bytes:
    """One malformed websocket message, or one that asks for ``BAD_ROUTE`` in a way that must not work.

    Args:
        session: of the connection.
        last_number: the last one that was taken from it; 0 for none.
        draw: seeded.
    """
    text = wish(session, last_number + 1, BAD_ROUTE)
    kinds = [
        lambda: frame(wish(draw.randbytes(16).hex(), 7, BAD_ROUTE), draw),
        lambda: frame(wish(session, draw.choice([-1, 0, 2**53, 10**300]), BAD_ROUTE), draw),
        lambda: frame(text.replace(b"{", b'{"engage":true,', 1), draw),
        lambda: frame(text.replace(b"}", b',"select_route":"quarry"}'), draw),
        lambda: frame(text.replace(b'"quarry"', draw.choice(_NO_NAMES)), draw),
        lambda: frame(text[: draw.randrange(len(text) - 1)], draw),
        lambda: frame(text, draw, opcode=2),
        lambda: frame(text + b" " * 1024, draw),
        lambda: frame(b"[" * draw.choice([10, 500, 1024]), draw),
        lambda: frame(b'{"a":' * 200, draw),
        lambda: frame(b"9" * 1024, draw),
        lambda: frame(b'"' + b"\\u0000" * 150 + b'"', draw),
        lambda: frame(draw.choice([b"\xff\xfe", b"\xc3(", b"\xed\xa0\x80", text + b"\xff"]), draw),
        lambda: frame(text, draw, reserved=draw.randint(1, 7)),
        lambda: frame(text, draw, opcode=draw.choice([3, 4, 7, 11, 15])),
        lambda: frame(text[1:], draw, opcode=0),
        lambda: frame(b"x" * 126, draw, opcode=draw.choice([8, 9, 10])),
        lambda: frame(b"", draw, opcode=9, last=False),
        lambda: frame(struct.pack(">H", draw.randrange(65536)) + draw.randbytes(3), draw, opcode=8),
        lambda: frame(b"x", draw, opcode=8),
        lambda: b"\x81" + bytes([len(text)]) + text,
        lambda: b"\x81\xff" + struct.pack(">Q", draw.choice([2**63, 2**63 - 1, 2**32, 10**9])) + b"maskx",
        lambda: b"\x81\xfe" + struct.pack(">H", 65535) + b"mask" + draw.randbytes(200),
        lambda: frame(b"", draw, last=False) + frame(b"", draw, opcode=0, last=False) * draw.choice([3, 900]),
        lambda: frame(text[:9], draw, last=False) + frame(text[9:], draw),
        lambda: frame(b"ping", draw, opcode=9) * draw.choice([1, 50]),
        lambda: frame(b"{}", draw) * draw.choice([2, 200]),
    ]
    return draw.choice(kinds)()
