"""An MJPEG camera on the loopback whose behaviour a test changes while it runs."""

from __future__ import annotations

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

import numpy as np

from tests.factories import STEP, encode


class MjpegServer:
    """Serves grey pictures that count up. Attributes may be changed at any time.

    gap_s: between pictures. stalled: sends nothing, keeps the connection. refuse: answers 503.
    after: ends each connection after so many pictures. lengths: whether parts say their length.
    damage: sends pictures that are none. account: user:password, encoded, or None.
    end: whether pictures have their end marker. digest: asks for a digest login. kind: the
        Content-Type, or None.
    """

    def __init__(self, port: int = 0) -> None:
        self.gap_s, self.stalled, self.refuse, self.lengths = 0.02, False, False, True
        self.after: int | None = None
        self.damage, self.end, self.digest = False, True, False
        self.account: str | None = None
        self.kind: str | None = "multipart/x-mixed-replace; boundary=--frame"
        self.sent = 0
        self.connections = 0
        self._open: set[Any] = set()
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                server.serve(self)

            def log_message(self, *parts: object) -> None:
                pass

        self._http = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._http.daemon_threads = True
        self.port = self._http.server_address[1]
        self.url = f"http://127.0.0.1:{self.port}/video"
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    def serve(self, request: Any) -> None:
        if request.path == "/moved":
            request.send_response(302)
            request.send_header("Location", "/video")
            request.end_headers()
            return
        if self.refuse:
            request.send_error(503)
            return
        if self.account is not None and request.headers["Authorization"] != self.account:
            request.send_error(401)
            return
        if self.digest and not (request.headers["Authorization"] or "").startswith("Digest "):
            request.send_response(401)
            ask = 'Digest realm="camera", qop="auth", nonce="1013271036", opaque="ca7c"'
            request.send_header("WWW-Authenticate", ask)
            request.send_header("Content-Length", "0")
            request.end_headers()
            return
        self.connections += 1
        self._open.add(request.connection)
        request.send_response(200)
        if self.kind is not None:
            request.send_header("Content-Type", self.kind)
        request.end_headers()
        count = 0
        try:
            while self.after is None or count < self.after:
                time.sleep(self.gap_s)
                if self.stalled:
                    continue
                picture = encode(np.full((48, 64, 3), self.sent % 60 * STEP, np.uint8))
                if self.damage:
                    picture = picture[:80] + bytes(80) + picture[160:]
                picture = picture if self.end else picture[:-2]
                head = f"--frame\r\nContent-Type: image/jpeg\r\n{self._length(picture)}\r\n"
                request.wfile.write(head.encode() + picture + b"\r\n")
                self.sent += 1
                count += 1
        except OSError:
            pass

    def _length(self, picture: bytes) -> str:
        return f"Content-Length: {len(picture)}\r\n" if self.lengths else ""

    def __enter__(self) -> MjpegServer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """As if the plug were pulled."""
        self._http.shutdown()
        self._http.server_close()
        for connection in self._open:
            try:
                connection.shutdown(2)
            except OSError:
                continue
        self._open.clear()
