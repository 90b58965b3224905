"""The live scene's server: what browsers ask, what others on the machine may send."""

from __future__ import annotations

import asyncio
import gc
import http.client
import json
import re
import socket
import urllib.request
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress

import pytest
from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, WebSocketClosedError, websocket_connect

import rbd
from rbd.errors import PictureError
from rbd.visual import Scene
from rbd.visual.pages import server
from rbd.visual.pages.recorder import Recorder


@pytest.fixture(scope="module")
def scene(g1: rbd.Robot) -> Iterator[Scene]:
    """A live scene of a standing robot."""
    with Scene(g1) as scene:
        scene.show(g1.standing())
        assert scene.url
        yield scene


def port_of(scene: Scene) -> int:
    """The port it listens on."""
    return int(scene.url.rstrip("/").rsplit(":", 1)[1])


def answer(scene: Scene, request: str, *, body: bytes = b"") -> tuple[int, str]:
    """Status and text of the answer to bytes as they are; 0 if the connection was closed without one."""
    with socket.create_connection(("127.0.0.1", port_of(scene)), timeout=10) as connection:
        connection.sendall(request.replace("\n", "\r\n").encode("latin-1") + body)
        got = http.client.HTTPResponse(connection)
        try:
            got.begin()
        except (http.client.HTTPException, ConnectionError):
            return 0, ""
        return got.status, got.read().decode()


def upgrade(scene: Scene, after: str, **headers: str) -> int:
    """Status of the answer to a browser that wants what comes after so many messages; 101 is a socket.

    Headers replace or add to those of our own page; one that is empty is left out.
    """
    with socket.create_connection(("127.0.0.1", port_of(scene)), timeout=10) as connection:
        return upgraded(connection, f"127.0.0.1:{port_of(scene)}", after, **headers)


def upgraded(connection: socket.socket, address: str, after: str, **headers: str) -> int:
    """The same, by an open connection to a server at this address."""
    host = headers.get("Host", address)
    given = {"Host": host, "Upgrade": "websocket", "Connection": "Upgrade", "Origin": f"http://{host}"} | headers
    given = {name: value for name, value in given.items() if value}
    given |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13"}
    lines = "".join(f"{name}: {value}\n" for name, value in given.items())
    connection.sendall(f"GET /changes{after} HTTP/1.1\n{lines}\n".replace("\n", "\r\n").encode())
    return int(connection.recv(12).split()[1])


@asynccontextmanager
async def ours(port: int, *, after: int = 0) -> AsyncIterator[WebSocketClientConnection]:
    """A socket as our own page opens it, closed at the end without waiting for the server's answer."""
    address = f"ws://127.0.0.1:{port}/changes?after={after}"
    found = await websocket_connect(HTTPRequest(address, headers={"Origin": f"http://127.0.0.1:{port}"}))
    stream = found.protocol.stream
    try:
        yield found
    finally:
        found.close()
        stream.close()


@pytest.mark.parametrize(
    "after", ["9" * 5000, "9" * 16, "-1", "x", "1e3", "٣", "1_0", "%00", "+1", "nan", "0x1"], ids=lambda text: text[:8]
)
def test_what_is_no_count_is_a_bad_request(scene: Scene, after: str, caplog: pytest.LogCaptureFixture):
    """Refused as 400 before the connection becomes a socket, without a traceback; the server answers the next one."""
    assert upgrade(scene, "?after=" + urllib.request.quote(after, safe="%")) == 400
    assert not [record for record in caplog.records if record.exc_info]
    assert upgrade(scene, "?after=0") == 101


def test_counts_are_taken(scene: Scene):
    """None is zero; one of a page that knows more than there is gets nothing."""
    assert [upgrade(scene, after) for after in ("", "?after=0", "?after=000", "?after=999999999999999")] == [101] * 4


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "LOCALHOST"])
def test_a_page_connects_to_the_name_it_was_asked_under(scene: Scene, name: str):
    """A browser sends the page's name as the socket's origin: page, policy and socket must agree on it."""
    host = f"{name}:{port_of(scene)}"
    status, page = answer(scene, f"GET / HTTP/1.1\nHost: {host}\n\n")
    address = json.loads(re.search(r'stage\.connect\((".*?")\)', page)[1])
    assert status == 200 and address.startswith(f"ws://{host.lower()}/changes?after=")
    assert f"connect-src ws://{host.lower()}/changes" in page
    query = address.partition("/changes")[2]
    assert upgrade(scene, query, Origin=f"http://{host.lower()}", Host=host.lower()) == 101


def test_localhost_is_reached_as_a_browser_does(scene: Scene):
    """Name look-up and all."""
    with urllib.request.urlopen(f"http://localhost:{port_of(scene)}/", timeout=10) as found:
        assert b"ws://localhost:" in found.read()


def test_a_forwarded_port_is_kept(scene: Scene):
    """Through `ssh -L 9000:127.0.0.1:port` the browser knows another port."""
    assert "ws://localhost:9000/changes" in answer(scene, "GET / HTTP/1.1\nHost: localhost:9000\n\n")[1]


@pytest.mark.parametrize(
    "host", ["elsewhere.example", "127.0.0.1.example", "localhost:1'><script>", 'localhost:1"', "localhost:123456", ""]
)
def test_other_names_are_refused(scene: Scene, host: str):
    """A page elsewhere may point its own name at this machine; and nothing of the name can stand in the page."""
    status, text = answer(scene, f"GET / HTTP/1.1\nHost: {host}\n\n")
    assert status in (400, 404) and "stage" not in text and "<script>" not in text


@pytest.mark.parametrize(
    "origin",
    [
        *("http://elsewhere.example", "null", "http://127.0.0.1:1", "http://127.0.0.1", "file://", ""),
        *("https://127.0.0.1:{port}", "http://localhost:{port}", "http://127.0.0.1:{port}/", "http://127.0.0.1:{port}.example"),
        "http://127.0.0.1:{port}\nOrigin: http://elsewhere.example",
    ],
)
@pytest.mark.parametrize("fetch", [{}, {"Sec-Fetch-Site": "same-origin"}])
def test_pages_elsewhere_get_no_socket(scene: Scene, origin: str, fetch: dict[str, str]):
    """A browser tells whose page asks: exactly our own gets a socket; another port, name or scheme, null or none does not."""
    assert upgrade(scene, "?after=0", Origin=origin.format(port=port_of(scene)), **fetch) == 403
    assert upgrade(scene, "?after=0", **fetch) == 101


@pytest.mark.parametrize(
    "path",
    [
        *("/../../etc/passwd", "/..%2f..%2fetc%2fpasswd", "/%2e%2e/pyproject.toml", "//etc/passwd", "/etc/passwd", "/static/x"),
        *(
            "/web/stage.js",
            "/index.html",
            "/changes/..",
            "/changes/x",
            "/favicon.ico/../changes",
            "/\\..\\x",
            "/%00",
            "/?/../x",
        ),
        "http://elsewhere.example/",
    ],
)
def test_nothing_else_is_served(scene: Scene, path: str):
    """Three addresses and no files: every other path is unknown; a query changes nothing."""
    status, text = answer(scene, f"GET {path} HTTP/1.1\nHost: 127.0.0.1:{port_of(scene)}\n\n")
    if path.startswith("/?"):
        assert status == 200 and "stage" in text
    else:
        assert status in (400, 404) and "root:" not in text and "stage" not in text


def test_a_page_elsewhere_cannot_show_or_load_it(scene: Scene):
    """Headers that browsers obey."""
    with urllib.request.urlopen(scene.url, timeout=10) as found:
        assert found.headers["X-Frame-Options"] == "DENY" and found.headers["X-Content-Type-Options"] == "nosniff"
        assert found.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert "Access-Control-Allow-Origin" not in found.headers


def test_what_is_too_long_is_not_kept(scene: Scene):
    """Long headers, addresses and bodies are refused as they are announced; other methods do nothing."""
    host = f"Host: 127.0.0.1:{port_of(scene)}\n"
    assert answer(scene, f"GET /?{'x' * 20_000} HTTP/1.1\n{host}\n")[0] in (0, 400, 431)
    assert answer(scene, f"POST / HTTP/1.1\n{host}Content-Length: 100000000\n\n")[0] in (0, 400, 405, 413)
    assert answer(scene, f"POST / HTTP/1.1\n{host}Content-Length: 2\n\n", body=b"{}")[0] == 405
    assert answer(scene, f"GET /changes HTTP/1.1\n{host}\n")[0] == 403
    assert answer(scene, "nonsense\n\n")[0] in (0, 400)
    assert answer(scene, f"GET / HTTP/1.1\n{host}\n")[0] == 200


@pytest.mark.parametrize(("size", "count"), [(100_000, 1), (2, 21)], ids=["long", "many"])
def test_a_browser_that_sends_much_is_sent_away(scene: Scene, size: int, count: int, monkeypatch: pytest.MonkeyPatch):
    """A long message, or one more in a second than there may be."""
    monkeypatch.setattr(server, "MOST_A_SECOND", 20)

    async def send() -> object:
        async with ours(port_of(scene), after=999999) as found:
            with suppress(WebSocketClosedError):
                for _ in range(count):
                    await found.write_message("x" * size)
            return await asyncio.wait_for(found.read_message(), 10)

    assert asyncio.run(send()) is None  # closed


def test_a_browser_that_does_not_read_is_sent_away(scene: Scene, g1: rbd.Robot, monkeypatch: pytest.MonkeyPatch):
    """What waits for it does not grow for ever."""
    monkeypatch.setattr(server, "MOST_UNREAD", 1000)

    async def watch() -> list[object]:
        async with ours(port_of(scene)) as found:
            told = [await asyncio.wait_for(found.read_message(), 10)]
            while told[-1] is not None:
                told.append(await asyncio.wait_for(found.read_message(), 10))
            return told

    assert sum(len(m) for m in asyncio.run(watch()) if m is not None) <= 1000
    assert not scene._server._sockets
    monkeypatch.undo()
    scene.show(g1.standing())
    assert upgrade(scene, "?after=0") == 101


def test_closing_disconnects_a_browser_that_does_not_answer(g1: rbd.Robot):
    """Its connection ends with the server, and no open socket is left to the garbage collector."""
    with Scene(g1) as scene:
        connection = socket.create_connection(("127.0.0.1", port_of(scene)), timeout=10)
        assert upgraded(connection, f"127.0.0.1:{port_of(scene)}", "?after=0") == 101
    with connection, suppress(ConnectionError):
        while connection.recv(1 << 16):
            pass
    gc.collect()


def test_a_port_that_is_refused_is_told_to_the_caller(g1: rbd.Robot, monkeypatch: pytest.MonkeyPatch):
    """The reason of the system, in the error of whoever asked for the address."""

    def refused(port: int, host: str) -> None:
        raise OSError(98, "Address already in use")

    monkeypatch.setattr(server, "bind_sockets", refused)
    with Scene(g1) as scene, pytest.raises(PictureError, match="could not listen on 127.0.0.1: .*Address already in use"):
        scene.url  # noqa: B018


def test_a_server_closes_once_and_takes_its_browsers_along(g1: rbd.Robot):
    """A browser that watches is told the end; what is closed twice, or told more, stays closed."""
    live = server.LiveServer(recorder := Recorder(), "closing")

    async def watch() -> object:
        async with ours(live.port) as found:
            await asyncio.get_running_loop().run_in_executor(None, lambda: (live.wait_for_viewer(10.0), live.close()))
            return await asyncio.wait_for(found.read_message(), 10)

    assert asyncio.run(watch()) is None
    live.close()
    live._pass_on("more")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", live.port), timeout=10)
    assert recorder.messages()[1] == 0


def test_a_child_lets_go_of_its_parents_port():
    """What a forked child does first: the socket is closed there, and the next request of that copy finds nobody."""
    live = server.LiveServer(Recorder(), "forked")
    live.close()  # as in a child, no thread of it runs here any more
    kept = socket.create_server(("127.0.0.1", 0))
    port = kept.getsockname()[1]
    live._listening = [kept]
    live.renew_after_fork()
    assert kept.fileno() == -1 and live._listening == [] and not live.wait_for_viewer(0.0)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=10)
    live.close()
