"""The server of one page, for browsers of this machine: it shows a render that goes on, and may stop it.

Whoever is to see the page needs its address, which holds a token of 192 random bits.  Pages of others in the same browser, which
can send requests to any port, neither know that nor are they answered: their requests name another host or another origin.
"""

import hmac
import json
import secrets
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, unquote, urlsplit

HOST = "127.0.0.1"
_NAMES = (HOST, "localhost")  # of the Host header: another one means that a name of somebody else's leads here
_WAIT = 1.0  # s that a question for news waits for some
_PACE = 0.2  # s between two answers to a page, at least
_SILENT = 5.0  # s without a question after which a page counts as closed
_LINGER = 30.0  # s that open pages have to fetch the last picture
_IDLE = 60.0  # s after which a connection without a request is closed
_PAGES = 64  # that are remembered at once


class Server:
    """Serves a page and what its script asks for, in threads of its own.

    Attributes
    ----------
    address : of the page
    """

    def __init__(self, page: str, source, port: int = 0):
        """
        Parameters
        ----------
        page : HTML
        source : what it shows, `renderers.pictures.live.Watch`
        port : 0: a free one

        Raises
        ------
        OSError : the port cannot be had
        """
        self._token = secrets.token_urlsafe(24)
        self._http = _Threads((HOST, port), _Handler)
        self._http.served, self._http.token = _Served(page.encode(), source), self._token
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.1,), daemon=True)
        self._thread.start()
        self.address = f"http://{HOST}:{self._http.server_address[1]}/{self._token}/"

    def close(self, linger: float = _LINGER) -> None:
        """Ends the server once every open page has what it needs to go on without, or after so many seconds."""
        last = time.monotonic() + linger
        try:
            while time.monotonic() < last and self._http.served.open_pages():
                time.sleep(0.05)
        except KeyboardInterrupt:
            pass  # of somebody who does not want to wait; the picture is there
        self._http.shutdown()
        self._http.server_close()


class _Served:
    """The page, what it shows, and which browsers show it."""

    def __init__(self, page, source):
        self.page, self.source = page, source
        self._pages: dict[str, float] = {}  # by the number that a page has given itself: when it asked last
        self._lock = threading.Lock()

    def seen(self, name: str) -> None:
        with self._lock:
            self._pages.pop(name, None)
            self._pages[name] = time.monotonic()
            for oldest in list(self._pages)[:-_PAGES]:
                del self._pages[oldest]

    def kept(self, name: str) -> None:
        with self._lock:
            self._pages.pop(name, None)

    def open_pages(self) -> bool:
        """Whether a page is open that has not said that it has all."""
        with self._lock:
            return any(time.monotonic() - asked < _SILENT for asked in self._pages.values())


class _Threads(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = False  # a port that is taken is taken
    served: _Served
    token: str

    def handle_error(self, request, client_address):
        """A browser that goes away in the middle of an answer is nothing to speak of; anything else is a bug."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"  # connections that stay
    server_version, sys_version = "bake", ""
    timeout = _IDLE

    def do_GET(self):
        asked = self._asked()
        if asked is None:
            return
        path, query = asked
        served = self.server.served
        if path == "":
            self._answer(200, served.page, "text/html; charset=utf-8")
        elif path == "state":
            if name := query.get("page"):
                served.seen(name[:64])
            begin = time.monotonic()
            state = served.source.state(_integer(query.get("seen")), _WAIT)
            time.sleep(max(0.0, begin + _PACE - time.monotonic()))
            self._answer(200, json.dumps(state, allow_nan=False).encode(), "application/json")
        elif path.startswith("layer/"):
            self._layer(unquote(path.removeprefix("layer/")), _integer(query.get("have")))
        else:
            self._refuse(404)

    def do_POST(self):
        asked = self._asked()
        if asked is None:
            return
        path, query = asked
        self.close_connection = True  # whatever else was sent is not read
        if path == "stop":
            self.server.served.source.stop()
        elif path == "kept":
            self.server.served.kept(query.get("page", "")[:64])
        else:
            return self._refuse(404)
        self._answer(204, b"", "text/plain")

    def _layer(self, name, have):
        """`NAME.png`, or `NAME.values` with the numbers behind it; nothing where the page has it."""
        name, _, kind = name.rpartition(".")
        frame = self.server.served.source.frame(name) if kind in ("png", "values") else None
        if frame is None:
            return self._refuse(404)
        headers = {"X-Frame": str(frame.number), "X-Passes": str(frame.passes), "X-White": f"{frame.white:g}"}
        if frame.number == have:
            return self._answer(204, b"", "text/plain", headers)
        if kind == "png":
            return self._answer(200, frame.png, "image/png", headers)
        self._answer(200, frame.values, "application/octet-stream", headers)

    def _asked(self):
        """Path behind the token, and the query; None where the request is none of the page's, and was refused."""
        if not _of_the_page(self.headers):
            return self._refuse(403)
        try:
            address = urlsplit(self.path)
            query = parse_qs(address.query, max_num_fields=8)
        except ValueError:
            return self._refuse(404)
        token, slash, path = address.path.removeprefix("/").partition("/")
        if not slash or not hmac.compare_digest(token.encode(), self.server.token.encode()):
            return self._refuse(404)
        return path, {key: values[0] for key, values in query.items()}

    def _refuse(self, status):
        self.close_connection = True
        self._answer(status, b"", "text/plain")

    def _answer(self, status, content, kind, headers=()):
        self.send_response(status)
        for name, value in {
                "Content-Type": kind, "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff",
                "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin", "X-Frame-Options": "DENY",
                **dict(headers)}.items():
            self.send_header(name, value)
        if status != 204:
            self.send_header("Content-Length", str(len(content)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_):
        """The terminal is the render's."""


def _of_the_page(headers) -> bool:
    """Whether a request names this machine and comes from the page itself, or from somebody who follows a link to it."""
    host = headers.get("Host", "")
    if host.rpartition(":")[0] not in _NAMES and host not in _NAMES:
        return False
    if headers.get("Origin", f"http://{host}") != f"http://{host}":
        return False
    return headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin") or headers.get("Sec-Fetch-Mode") == "navigate"


def _integer(text) -> int:
    """-1 where it is none."""
    return int(text) if text and text.isascii() and text.isdigit() and len(text) < 16 else -1
