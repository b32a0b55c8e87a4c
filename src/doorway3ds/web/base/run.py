"""A server that listens, answers and ends cleanly."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from doorway3ds.errors import UserError
from doorway3ds.web.base.gate import Gates
from doorway3ds.web.base.shield import Shield
from doorway3ds.web.base.tls import Certificate

_GRACE_S = 20  # for requests at hand once the server is told to end


def listen(host: str, port: int) -> socket.socket:
    """A bound socket; UserError if the address is taken or not this machine's."""
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
    """uvicorn's server, which says when it answers and tells open streams to end when it is to."""

    def __init__(self, config: Any, ready: Callable[[], None], ending: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready
        self._ending = ending

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._ending()
        await super().shutdown(sockets)


def make_server(
    app: Shield,
    certificate: Certificate | None = None,
    ready: Callable[[], None] = lambda: None,
) -> Server:
    """A server whose `run(sockets=[...])` answers until SIGINT or SIGTERM, then finishes what it
    is at.

    ready: called once it answers.
    """
    limits = app.state.access.limits
    logging.getLogger("uvicorn.error").addFilter(_quiet)
    logging.getLogger("python_multipart").setLevel(logging.ERROR)
    gates = Gates(limits.head_s, H11Protocol)
    chain, key = (certificate.chain, certificate.key) if certificate else (None, None)
    config = uvicorn.Config(
        app,
        http=cast(type[asyncio.Protocol], gates),
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

    def end() -> None:
        app.state.end()
        gates.end()

    return Server(config, ready, end)


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)


def _quiet(record: logging.LogRecord) -> bool:
    """What clients do wrong is counted, not logged."""
    return not str(record.msg).startswith(("Invalid HTTP request", "Unsupported upgrade"))
