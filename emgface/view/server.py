"""HTTP and WebSocket server for one page on the loopback interface, below a secret path.

The WebSocket protocol is that of RFC 6455. A page of another origin, another host name, or without
the secret receives an error and no content.
"""

import base64
import hashlib
import hmac
import os
import secrets
import struct
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socket import socket
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from emgface.errors import DataError

LOOPBACK: Final = "127.0.0.1"
LOCAL_HOSTS: Final = frozenset({"127.0.0.1", "localhost", "[::1]"})
"""Host names of this computer; the port may differ from that of the server (``ssh -L``)."""
SECRET_BYTES: Final = 32
LARGEST_MESSAGE: Final = 1 << 20  #: largest message of a page [bytes]
LARGEST_BODY: Final = 1 << 20  #: largest body of a POST request [bytes]
HANDSHAKE: Final = 10.0  #: time in which a request must be complete [s]
GUID: Final = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  #: constant of RFC 6455, section 1.3
TEXT, BINARY, CLOSE_CODE, PING, PONG = 1, 2, 8, 9, 10  #: codes of frames, RFC 6455, section 5.2


@dataclass(frozen=True)
class Answer:
    """Content of a response, with its media type and further headers."""

    body: bytes
    media: str = "application/octet-stream"
    headers: Mapping[str, str] = field(default_factory=dict)
    status: int = 200


class Connection:
    """WebSocket of one page. Sending is possible from several threads."""

    def __init__(self, raw: socket) -> None:
        self._raw, self._lock, self.open = raw, threading.Lock(), True

    def send(self, message: str | bytes) -> None:
        """Send a text or bytes; a connection that is closed by the page becomes not `open`."""
        text = isinstance(message, str)
        self._send(TEXT if text else BINARY, message.encode() if text else message)

    def _send(self, code: int, body: bytes) -> None:
        head = struct.pack("!B", 0x80 | code)
        if len(body) < 126:
            head += struct.pack("!B", len(body))
        elif len(body) < 1 << 16:
            head += struct.pack("!BH", 126, len(body))
        else:
            head += struct.pack("!BQ", 127, len(body))
        try:
            with self._lock:
                self._raw.sendall(head + body)
        except OSError:
            self.open = False

    def receive(self) -> str | bytes | None:
        """Wait for the next message of the page; None if the connection has ended.

        A message that violates the protocol or is larger than `LARGEST_MESSAGE` ends it.
        """
        whole, kind = b"", 0
        while self.open:
            try:
                code, last, body = self._frame()
            except (OSError, ConnectionError, ValueError):
                break
            if code == PING:
                self._send(PONG, body)
            elif code == CLOSE_CODE:
                self._send(CLOSE_CODE, body[:2])
                break
            elif code in (0, TEXT, BINARY):
                kind = code or kind
                whole += body
                if len(whole) > LARGEST_MESSAGE or not kind:
                    break
                if last:
                    try:
                        return whole.decode() if kind == TEXT else whole
                    except UnicodeDecodeError:
                        break
            elif code != PONG:
                break
        self.close()
        return None

    def _frame(self) -> tuple[int, bool, bytes]:
        """Code, whether it is the last of its message, and content of the next frame."""
        first, second = self._read(2)
        size = second & 0x7F
        if size == 126:
            (size,) = struct.unpack("!H", self._read(2))
        elif size == 127:
            (size,) = struct.unpack("!Q", self._read(8))
        if not second & 0x80 or first & 0x70 or size > LARGEST_MESSAGE:
            raise ValueError("a frame of a page is masked, without extensions and of limited size")
        mask = self._read(4)
        body = self._read(size)
        repeated = (mask * (size // 4 + 1))[:size]
        plain = int.from_bytes(body, "big") ^ int.from_bytes(repeated, "big")
        return first & 0x0F, bool(first & 0x80), plain.to_bytes(size, "big")

    def _read(self, size: int) -> bytes:
        parts = b""
        while len(parts) < size:
            more = self._raw.recv(size - len(parts))
            if not more:
                raise ConnectionError("the page has closed the connection")
            parts += more
        return parts

    def close(self) -> None:
        """End the connection."""
        self.open = False
        try:
            self._raw.close()
        except OSError:
            pass


Get = Callable[[Mapping[str, str]], Answer]
Post = Callable[[bytes], Answer]


class LocalServer:
    """Server of one page and its data.

    Parameters
    ----------
    page : str
        Content of the page, which includes its own content security policy.
    get, post : mapping
        Functions of the query and of the body, by the name of the path below the secret.
    talk : callable, optional
        Called with each `Connection` in a thread of its own; the connection ends with it.
    port : int
        Port of the loopback interface; 0 chooses a free one.

    Raises
    ------
    DataError
        The port is in use.
    """

    def __init__(
        self,
        page: str,
        *,
        get: Mapping[str, Get] | None = None,
        post: Mapping[str, Post] | None = None,
        talk: Callable[[Connection], None] | None = None,
        port: int = 0,
    ) -> None:
        self.secret = secrets.token_urlsafe(SECRET_BYTES)
        self._get: dict[str, Get] = {"": lambda query: _page(page), **(get or {})}
        self._post, self._talk = dict(post or {}), talk
        handler = type("Handler", (_Handler,), {"owner": self})
        try:
            self._server = ThreadingHTTPServer((LOOPBACK, port), handler)
        except (OSError, OverflowError) as error:
            raise DataError(
                f"port {port} of this computer cannot be used ({error}), expected a free one: choose "
                "another --port, or 0"
            ) from error
        self._server.daemon_threads = True
        self._connections: set[Connection] = set()
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    @property
    def url(self) -> str:
        """Address of the page, which contains the secret."""
        return f"http://{LOOPBACK}:{self._server.server_port}/{self.secret}/"

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def stop(self) -> None:
        """End all connections and release the port."""
        for connection in list(self._connections):
            connection.close()
        self._server.shutdown()
        self._server.server_close()

    def redirect(self) -> Path:
        """Write a file that only this user can read and that leads a browser to the page.

        The command line of a browser is visible to other users of the computer; the secret is
        therefore not a part of it.
        """
        folder = Path(tempfile.mkdtemp(prefix="emgface-"))
        path = folder / "open.html"
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f'<!DOCTYPE html><meta http-equiv="refresh" content="0;url={self.url}">\n')
        return path

    def conversation(self, raw: socket) -> None:
        """Hold one WebSocket until it ends."""
        connection = Connection(raw)
        self._connections.add(connection)
        try:
            if self._talk:
                self._talk(connection)
        finally:
            self._connections.discard(connection)
            connection.close()

    def answer(self, name: str, query: Mapping[str, str]) -> Answer | None:
        """Response to a GET request, None if there is nothing of this name."""
        return self._get[name](query) if name in self._get else None

    def take(self, name: str, body: bytes) -> Answer | None:
        """Response to a POST request, None if there is nothing of this name."""
        return self._post[name](body) if name in self._post else None


def _page(text: str) -> Answer:
    return Answer(text.encode(), "text/html; charset=utf-8")


class _Handler(BaseHTTPRequestHandler):
    """Request of a page: checks host, origin and secret before anything is answered."""

    owner: LocalServer
    protocol_version = "HTTP/1.1"
    server_version = "emgface"
    sys_version = ""
    timeout = HANDSHAKE

    def log_message(self, format: str, *args: Any) -> None:
        """Write nothing: a log would contain the secret."""

    def do_GET(self) -> None:
        """Answer with the page, data of it, or a WebSocket."""
        name = self._name(same_origin="upgrade" in self.headers.get("Connection", "").lower())
        if name is None:
            return
        if name == "socket":
            self._upgrade()
            return
        query = {k: v[-1] for k, v in parse_qs(urlsplit(self.path).query).items()}
        self._send(self.owner.answer(name, query))

    def do_POST(self) -> None:
        """Pass the body to the function of this name."""
        name = self._name(same_origin=True)
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > LARGEST_BODY:
            self._refuse(413)
            return
        self._send(self.owner.take(name, self.rfile.read(int(length))))

    def _name(self, *, same_origin: bool) -> str | None:
        """Name below the secret, or None after a refusal."""
        host = self.headers.get("Host", "")
        origin = self.headers.get("Origin")
        plain, _, port = host.rpartition(":") if not host.endswith("]") else (host, "", "")
        if (plain if port.isdecimal() else host) not in LOCAL_HOSTS:
            return self._refuse(403)
        if origin != f"http://{host}" if same_origin or origin is not None else False:
            return self._refuse(403)
        secret, _, name = urlsplit(self.path).path.lstrip("/").partition("/")
        own = self.owner.secret.encode()
        if not hmac.compare_digest(secret.encode("utf-8", "replace"), own):
            return self._refuse(404)
        return name

    def _refuse(self, status: int) -> None:
        self.close_connection = True
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.send_header("Connection", "close")
        self.end_headers()

    def _send(self, answer: Answer | None) -> None:
        if answer is None:
            self._refuse(404)
            return
        self.send_response(answer.status)
        self.send_header("Content-Type", answer.media)
        self.send_header("Content-Length", str(len(answer.body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("X-Frame-Options", "SAMEORIGIN")
        for name, value in answer.headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer.body)

    def _upgrade(self) -> None:
        """Begin a WebSocket, RFC 6455, section 4.2.2."""
        key = self.headers.get("Sec-WebSocket-Key", "")
        asked = self.headers.get("Upgrade", "").lower()
        if asked != "websocket" or self.headers.get("Sec-WebSocket-Version") != "13" or not key:
            self._refuse(400)
            return
        digest = hashlib.sha1((key + GUID).encode()).digest()
        self.send_response(101)
        self.send_header("Upgrade", "websocket")
        self.send_header("Connection", "Upgrade")
        self.send_header("Sec-WebSocket-Accept", base64.b64encode(digest).decode())
        self.end_headers()
        self.wfile.flush()
        self.connection.settimeout(None)
        self.close_connection = True
        self.owner.conversation(self.connection)
