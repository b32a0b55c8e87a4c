"""What every server is told when it starts."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, field

LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True)
class Limits:
    """What one server accepts at most; beyond it answers with an error, never with a queue.

    max_bytes: of a request's body. max_pixels: of a picture, by its header, before decoding.
    in_flight: decisions that run or wait to run. uploads: requests whose body is being read.
    streams: clients of /v1/stream. connections: open sockets.
    head_s, body_s, decision_s, send_s: seconds for a request's head to arrive, for its body, for
        a decision with its wait, and for a client to take what it is sent.
    """

    max_bytes: int = 32 * 1024 * 1024
    max_pixels: int = 50_000_000
    in_flight: int = 16
    uploads: int = 32
    streams: int = 32
    connections: int = 512
    head_s: float = 10.0
    body_s: float = 30.0
    decision_s: float = 15.0
    send_s: float = 20.0


@dataclass(frozen=True, kw_only=True)
class ServerSettings:
    """Who may ask a server, and how much.

    token: what every request but /healthz must carry, or None on a loopback address.
    workers: jobs that run at once. link: where others reach the page, with the token, or None.
    """

    token: str | None = None
    workers: int = 2
    link: str | None = None
    limits: Limits = field(default_factory=Limits)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches `host`."""
    if host in LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
