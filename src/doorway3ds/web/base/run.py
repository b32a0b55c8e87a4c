"""A server that listens, answers and ends cleanly."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn

from doorway3ds.errors import UserError
from doorway3ds.web.base.protocol import Protocol
from doorway3ds.web.base.shield import Shield
from doorway3ds.web.base.tls import Certificate

_GRACE_S = 20  # for requests at hand once the server is told to end


def listen(host: str, port: int) -> socket.socket:
    """A bound socket; UserError where the address is taken or not this machine's."""
    try:
        found = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        family, kind, protocol, _, address = found[0]
        bound = socket.socket(family, kind, protocol)
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
        except OSError:
            bound.close()
            raise
    except (OSError, OverflowError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(
            f"cannot listen on {host} port {port}: {reason}; choose another with --host or --port"
        ) from error
    return bound


class Server(uvicorn.Server):
    """uvicorn's server, which tells open streams to end when it is to end."""

    def __init__(self, config: Any, closing: Callable[[], None], ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._closing = closing
        self._ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._ready()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self._closing()
        super().handle_exit(sig, frame)


def make_server(
    app: Shield,
    certificate: Certificate | None = None,
    ready: Callable[[], None] = lambda: None,
) -> Server:
    """A server whose `run(sockets=[...])` answers until SIGINT or SIGTERM, then finishes what it
    is at.

    ready: called once it answers.
    """
    limits = app.hall.settings.limits
    logging.getLogger("uvicorn.error").addFilter(_quiet)
    logging.getLogger("python_multipart").setLevel(logging.ERROR)
    protocol = type("Protocol", (Protocol,), {"head_s": limits.head_s})
    chain, key = (certificate.chain, certificate.key) if certificate else (None, None)
    config = uvicorn.Config(
        app,
        http=protocol,
        ws="none",
        loop="asyncio",
        lifespan="on",
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        backlog=128,
        limit_concurrency=limits.connections,
        timeout_keep_alive=15,
        timeout_graceful_shutdown=_GRACE_S,
        ssl_certfile=_text(chain),
        ssl_keyfile=_text(key),
    )
    return Server(config, app.hall.end, ready)


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)


def _quiet(record: logging.LogRecord) -> bool:
    """What clients do wrong is counted, not logged."""
    return not str(record.msg).startswith(("Invalid HTTP request", "Unsupported upgrade"))
