"""The server of a page: who is answered, what it gives, when it ends."""

import http.client
import json
import socket
import threading
import time
from types import SimpleNamespace

import pytest

from bakery.report import live, served


class Source:
    """A render that somebody looks at."""

    ended = False

    def __init__(self):
        self.stopped, self.news = 0, threading.Event()

    def state(self, seen, seconds):
        if seen == 7:
            self.news.wait(seconds)
        return {"version": 7, "phase": "passes", "layers": []}

    def frame(self, name):
        frame = SimpleNamespace(number=3, passes=12, png=b"\x89PNG", values=b"\0" * 24, white=0.5)
        return frame if name == "light.the sun" else None

    def stop(self):
        self.stopped += 1


@pytest.fixture
def source():
    return Source()


@pytest.fixture
def server(source):
    server = served.Server(live.page("a <scene>", "a & b.yaml"), source)
    yield server
    server.close(linger=0.0)


def asked(server, path, method="GET", **headers):
    """Status, headers and content; `path` behind the token, or from the root if it begins with a slash."""
    _, _, host, token, _ = server.address.split("/")
    connection = http.client.HTTPConnection(host, timeout=10)
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path if path.startswith("/") else f"/{token}/{path}", headers=headers)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, answer.headers, content


def test_the_page(server):
    status, headers, content = asked(server, "")
    text = content.decode()
    assert status == 200 and headers["Content-Type"] == "text/html; charset=utf-8" and headers["X-Frame-Options"] == "DENY"
    assert "<h1>a &lt;scene&gt;</h1>" in text and "a &amp; b.yaml" in text
    assert "connect-src 'self'" in text and "http://" not in text.replace("http://www.w3.org/2000/svg", "")  # no outside resource
    assert server.address.startswith("http://127.0.0.1:")


def test_layers_and_news(server):
    status, headers, content = asked(server, "layer/light.the%20sun.png")
    assert (status, content, headers["Content-Type"]) == (200, b"\x89PNG", "image/png")
    assert (headers["X-Frame"], headers["X-Passes"], headers["X-White"]) == ("3", "12", "0.5")
    assert asked(server, "layer/light.the%20sun.values")[2] == b"\0" * 24
    assert asked(server, "layer/light.the%20sun.png?have=3")[0] == 204
    assert asked(server, "layer/light.the%20sun.png?have=2")[0] == 200
    assert json.loads(asked(server, "state?seen=2")[2])["version"] == 7


def test_only_who_knows_the_token(server, source):
    token = server.address.split("/")[3]
    for path in ("/", "/state", f"/{token}", f"/{token[:-1]}/state", f"/{token}x/stop", "/favicon.ico", f"/../{token}/", "//[/"):
        for method in ("GET", "POST"):
            assert asked(server, path, method)[0] == 404
    assert source.stopped == 0 and len(token) == 32


def test_no_other_page(server, source):
    """A name that somebody made to lead here, another origin, a request that another site's page sent."""
    port = server.address.split("/")[2].partition(":")[2]
    for headers in ({"Host": f"evil.example:{port}"}, {"Host": f"127.0.0.1.evil.example:{port}"}, {"Host": ""},
                    {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "http://127.0.0.1:1"},
                    {"Sec_Fetch_Site": "cross-site"}, {"Sec_Fetch_Site": "same-site"}):
        for method, path in (("GET", "state"), ("GET", "layer/light.the%20sun.png"), ("POST", "stop")):
            assert asked(server, path, method, **headers)[0] == 403
    assert source.stopped == 0
    assert asked(server, "", Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate")[0] == 200  # who follows a link
    local = f"localhost:{port}"
    assert asked(server, "state", Host=local, Origin=f"http://{local}", Sec_Fetch_Site="same-origin")[0] == 200


def test_unknown_paths_and_methods(server, source):
    for path in ("layer/none.png", "layer/light.the%20sun.txt", "layer/", "page", "state/", "layer/..%2f..%2fetc%2fpasswd.png"):
        assert asked(server, path)[0] == 404
    for path in ("state", "", "layer/light.the%20sun.png"):
        assert asked(server, path, "POST")[0] == 404
    assert asked(server, "stop")[0] == 404 and source.stopped == 0  # asking is no order
    assert asked(server, "stop", "PUT")[0] == 501
    assert asked(server, "state?" + "&".join(f"a{i}=1" for i in range(100)))[0] == 404
    assert asked(server, "state?seen=nonsense&page=" + "x" * 2000)[0] == 200


def test_stop(server, source):
    port = server.address.split("/")[2].partition(":")[2]
    assert asked(server, "stop", "POST", Origin=f"http://127.0.0.1:{port}", Sec_Fetch_Site="same-origin")[0] == 204
    assert asked(server, "stop", "POST")[0] == 204 and source.stopped == 2


def test_the_end_waits_for_open_pages(source, monkeypatch):
    """Until each has said that it has all, or is silent; a page that was never there keeps nobody."""
    monkeypatch.setattr(served, "_WAIT", 0.0)
    server = served.Server("page", source)
    asked(server, "state?page=1")
    asked(server, "state?page=2")
    asked(server, "kept?page=1", "POST")
    assert server._http.served.open_pages()
    asked(server, "kept?page=2", "POST")
    assert not server._http.served.open_pages()
    asked(server, "state?page=3")
    monkeypatch.setattr(served, "_SILENT", 0.0)
    assert not server._http.served.open_pages()
    server.close(linger=1e6)
    with pytest.raises(OSError):
        asked(server, "")


def test_the_end_waits_so_long_at_most(source):
    server = served.Server("page", source)
    asked(server, "state?page=1")
    server.close(linger=0.0)
    with pytest.raises(OSError):
        asked(server, "")


def test_who_goes_away_or_says_nothing_holds_nobody(server, source, capsys):
    """A connection that is closed before its answer, and one that never asks: others are answered."""
    host, port = server.address.split("/")[2].split(":")
    silent = socket.create_connection((host, int(port)))
    gone = socket.create_connection((host, int(port)))
    gone.sendall(f"GET /{server.address.split('/')[3]}/state?seen=7 HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
    gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # reset
    gone.close()
    assert asked(server, "state")[0] == 200
    source.news.set()
    time.sleep(0.1)
    silent.close()
    assert asked(server, "state")[0] == 200 and "Traceback" not in capsys.readouterr().err


def test_a_port_that_is_taken(server, source):
    port = int(server.address.split("/")[2].partition(":")[2])
    with pytest.raises(OSError):
        served.Server("page", source, port)
