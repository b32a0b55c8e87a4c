"""What stands before uvicorn on every connection: deadlines for heads, JSON for bad ones."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import h11

from doorway3ds.web.base.errors import ApiError

_GOODBYE_S = 0.5


class Gates:
    """Makes a gate for each connection; `uvicorn.Config(http=...)` takes it as its protocol.

    head_s: a connection on which a request's head takes longer is closed. uvicorn bounds only
    how long one may lie idle after an answer. server: makes the protocol behind the gate.
    """

    def __init__(self, head_s: float, server: Callable[..., asyncio.Protocol]) -> None:
        self.head_s = head_s
        self.open: set[Gate] = set()
        self._server = server

    def __call__(self, **options: Any) -> Gate:
        return Gate(self, self._server(**options))

    def end(self) -> None:
        """Gives up connections that wait for a goodbye: under TLS it may never come."""
        for gate in self.open:
            gate.give_up_when_closed()


class Gate(asyncio.Protocol):
    """Passes bytes on to the server's protocol, request heads once they are whole and valid."""

    def __init__(self, gates: Gates, server: asyncio.Protocol) -> None:
        self._gates = gates
        self._server = server
        self._framing: h11.Connection | None = h11.Connection(h11.SERVER)
        self._held = b""  # of a head that is not whole yet
        self._first = True
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._gates.open.add(self)
        self._server.connection_made(transport)
        self._expect_head()

    def data_received(self, data: bytes) -> None:
        held = len(self._held)
        self._held += data
        try:
            held = self._waiting(data, held)
        except h11.RemoteProtocolError as error:
            if self._first:
                self._refuse(error)
                return
            # An answer may be on its way: what follows it is the server's to say.
            self._framing, held = None, 0
        cut = len(self._held) - held
        passed, self._held = self._held[:cut], self._held[cut:]
        if passed:
            self._drop_deadline()
            self._first = False
            self._server.data_received(passed)
        if held:
            self._expect_head()

    def eof_received(self) -> bool | None:
        return self._server.eof_received()

    def pause_writing(self) -> None:
        self._server.pause_writing()

    def resume_writing(self) -> None:
        self._server.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        self._drop_deadline()
        self._gates.open.discard(self)
        self._server.connection_lost(exc)

    def give_up_when_closed(self) -> None:
        """Aborts the connection soon after it was closed and all was sent."""
        if self not in self._gates.open:
            return
        if self._transport.is_closing() and not self._transport.get_write_buffer_size():
            self._transport.abort()
        loop = asyncio.get_running_loop()
        loop.call_later(_GOODBYE_S, self.give_up_when_closed)

    def _waiting(self, data: bytes, held: int) -> int:
        """How many bytes at the end, `held` ones and `data`, are of a head that is not whole."""
        while self._framing is not None:
            self._framing.receive_data(data)
            while (event := self._framing.next_event()) not in (h11.NEED_DATA, h11.PAUSED):
                pass
            if event is h11.NEED_DATA:
                return held + len(data) if self._framing.their_state is h11.IDLE else 0
            if self._framing.their_state is not h11.DONE:  # it asks for another protocol
                self._framing = None
                return 0
            data, held = self._framing.trailing_data[0], 0
            self._framing = h11.Connection(h11.SERVER)
            if not data:
                return 0
        return 0

    def _expect_head(self) -> None:
        if self._deadline is None:
            loop = asyncio.get_running_loop()
            self._deadline = loop.call_later(self._gates.head_s, self._transport.close)

    def _drop_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _refuse(self, error: h11.RemoteProtocolError) -> None:
        self._drop_deadline()
        status = error.error_status_hint
        body = ApiError(status, "bad_request", str(error)).body()
        head = (
            f"HTTP/1.1 {status} Bad Request\r\ncontent-type: application/json\r\n"
            f"content-length: {len(body)}\r\nconnection: close\r\n\r\n"
        )
        self._transport.write(head.encode() + body)
        self._transport.close()
