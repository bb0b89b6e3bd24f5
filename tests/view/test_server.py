"""Local server: secret, host and origin; the WebSocket protocol; damaged messages."""

import http.client
import json
import os
import socket
import stat
import struct
from urllib.parse import urlsplit

import pytest

from emgface.errors import DataError
from emgface.view.server import LARGEST_BODY, LARGEST_MESSAGE, Answer, LocalServer


@pytest.fixture
def server():
    def talk(connection):
        while (message := connection.receive()) is not None:
            connection.send(message)

    made = LocalServer(
        "<p>page</p>",
        get={"data": lambda query: Answer(json.dumps(query).encode(), "application/json")},
        post={"echo": lambda body: Answer(body)},
        talk=talk,
    )
    made.start()
    yield made
    made.stop()


def asked(server, path, method="GET", body=None, **headers):
    """Status, headers and content of a response."""
    parts = urlsplit(server.url)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=10)
    connection.request(method, path, body, {"Host": parts.netloc, **headers})
    response = connection.getresponse()
    content = response.read()
    connection.close()
    return response.status, response.headers, content


def test_the_page_is_below_the_secret_only(server):
    secret = urlsplit(server.url).path
    status, headers, content = asked(server, secret)
    assert status == 200 and content == b"<p>page</p>"
    assert headers["Cache-Control"] == "no-store" and headers["Referrer-Policy"] == "no-referrer"
    for path in ("/", "/favicon.ico", secret[:-3], secret.upper(), f"{secret}../", f"{secret}etc/passwd",
                 "//", f"/%2e%2e{secret}", f"{secret}%2e%2e/data"):  # fmt: skip
        assert asked(server, path)[0] == 404 and not asked(server, path)[2], path
    assert len(server.secret) >= 43  # 32 random bytes
    assert json.loads(asked(server, f"{secret}data?from=1&to=2")[2]) == {"from": "1", "to": "2"}


@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ({"Host": "evil.example"}, 403),
        ({"Host": "evil.example:80"}, 403),
        ({"Host": "127.0.0.1.evil.example"}, 403),
        ({"Host": ""}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Host": "localhost:9999"}, 200),  # a forwarded port
    ],
)
def test_requests_of_other_pages_are_refused(server, headers, expected):
    assert asked(server, urlsplit(server.url).path, **headers)[0] == expected


def test_a_post_requires_the_own_origin_and_a_limited_body(server):
    parts = urlsplit(server.url)
    path, own = f"{parts.path}echo", f"http://{parts.netloc}"
    assert asked(server, path, "POST", b"a,b")[0] == 403
    assert asked(server, path, "POST", b"a,b", Origin="http://evil.example")[0] == 403
    assert asked(server, path, "POST", b"a,b", Origin=own)[2] == b"a,b"
    assert asked(server, f"{parts.path}none", "POST", b"", Origin=own)[0] == 404
    length = {"Origin": own, "Content-Length": str(LARGEST_BODY + 1)}
    assert asked(server, path, "POST", None, **length)[0] == 413


def test_only_this_user_can_read_the_redirect(server):
    path = server.redirect()
    assert server.url in path.read_text()
    if os.name == "posix":
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_port_in_use_is_a_sentence(server):
    port = urlsplit(server.url).port
    with pytest.raises(DataError, match=f"port {port} of this computer cannot be used"):
        LocalServer("", port=port)


class Client:
    """A WebSocket by hand."""

    def __init__(self, server, origin=None, path="socket"):
        parts = urlsplit(server.url)
        self.raw = socket.create_connection((parts.hostname, parts.port), timeout=10)
        origin = f"http://{parts.netloc}" if origin is None else origin
        lines = [f"GET {parts.path}{path} HTTP/1.1", f"Host: {parts.netloc}", "Upgrade: websocket",
                 "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
                 "Sec-WebSocket-Version: 13", *([f"Origin: {origin}"] if origin else [])]  # fmt: skip
        self.raw.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        self.answer = b""
        while b"\r\n\r\n" not in self.answer and (more := self.raw.recv(1)):
            self.answer += more

    def send(self, body, code=1, last=True, masked=True, length=None):
        size = len(body) if length is None else length
        head = bytes([(0x80 if last else 0) | code])
        flag = 0x80 if masked else 0
        if size < 126:
            head += bytes([flag | size])
        elif size < 1 << 16:
            head += bytes([flag | 126]) + struct.pack("!H", size)
        else:
            head += bytes([flag | 127]) + struct.pack("!Q", size)
        mask = b"\x11\x22\x33\x44"
        hidden = bytes(b ^ mask[k % 4] for k, b in enumerate(body)) if masked else body
        self.raw.sendall(head + (mask if masked else b"") + hidden)

    def receive(self):
        """Code and content of a frame, None if the server has closed."""
        try:
            head = self.raw.recv(2, socket.MSG_WAITALL)
        except ConnectionError:
            return None
        if len(head) < 2:
            return None
        size = head[1]
        if size == 126:
            (size,) = struct.unpack("!H", self.raw.recv(2, socket.MSG_WAITALL))
        elif size == 127:
            (size,) = struct.unpack("!Q", self.raw.recv(8, socket.MSG_WAITALL))
        return head[0] & 15, self.raw.recv(size, socket.MSG_WAITALL) if size else b""


def test_messages_return_whole(server):
    client = Client(server)
    # The key and its answer are the example of RFC 6455, section 1.3.
    assert b"101" in client.answer and b"s3pPLMBiTxaQ9kYGzzhZRbK+xOo=" in client.answer
    for text in ("", "short", "ä" * 100, "x" * 200, "y" * 70000):
        client.send(text.encode())
        assert client.receive() == (1, text.encode())
    client.send(b"one ", last=False)
    client.send(b"ping", code=9)
    client.send(b"two", code=0)
    assert client.receive() == (10, b"ping")
    assert client.receive() == (1, b"one two")
    client.send(b"\x00\xff", code=2)
    assert client.receive() == (2, b"\x00\xff")
    client.send(struct.pack("!H", 1000), code=8)
    assert client.receive() == (8, struct.pack("!H", 1000))
    assert client.receive() is None


@pytest.mark.parametrize(
    "damage",
    [
        {"body": b"plain", "masked": False},
        {"body": b"", "length": LARGEST_MESSAGE + 1},
        {"body": b"\xff\xfe"},  # not UTF-8
        {"body": b"x", "code": 3},
        {"body": b"x", "code": 0},  # continues nothing
        {"body": b"x", "code": 0x40 | 1},  # an extension
    ],
)
def test_a_message_against_the_protocol_ends_the_connection_alone(server, damage):
    client = Client(server)
    client.send(**damage)
    assert client.receive() is None
    again = Client(server)
    again.send(b"still here")
    assert again.receive() == (1, b"still here")


def test_parts_of_a_message_are_limited_together(server):
    client = Client(server)
    part = b"x" * (LARGEST_MESSAGE // 2 + 1)
    client.send(part, last=False)
    client.send(part, code=0)
    assert client.receive() is None


@pytest.mark.parametrize("origin", ["http://evil.example", "null", ""])
def test_a_socket_requires_the_own_origin(server, origin):
    assert b"403" in Client(server, origin).answer
