"""Where a server of a command listens, who may enter, and what it says when it answers."""

from __future__ import annotations

import os
import re
import secrets
import socket
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import typer

from doorway3ds.errors import CallError
from doorway3ds.options import Options, setting

if TYPE_CHECKING:
    from doorway3ds.web.base.shield import Shield
    from doorway3ds.web.base.tls import Certificate

TOKEN_VARIABLE = "DOORWAY3DS_TOKEN"
_TOKEN = re.compile(r"[A-Za-z0-9._~-]{8,256}")


@dataclass(frozen=True)
class ListenOptions(Options):
    """Where a server listens, who may enter, and by which certificate."""

    panel: ClassVar[str] = "Server"

    host: str = setting("127.0.0.1", "Address to listen on; 0.0.0.0 for other devices.")
    port: int = setting(8000, "Port to listen on; 0 takes a free one.", low=0, high=65535)
    token: str | None = setting(
        None,
        "Secret that clients send, or `new`; required if --host is not this machine.",
        envvar=TOKEN_VARIABLE,
    )
    tls: bool = setting(False, "Serve over HTTPS, which phones require to share their camera.")
    tls_cert: Path | None = setting(
        None, "Certificate (PEM); default: a self-signed one.", metavar="FILE"
    )
    tls_key: Path | None = setting(None, "Key of the certificate (PEM).", metavar="FILE")
    tls_name: list[str] | None = setting(
        None, "Further name of the self-signed certificate; repeatable.", metavar="NAME"
    )

    def open(self) -> Listening:
        """Checks them and takes the address.

        Raises CallError for options that do not go together, UserError if the address is
        taken.
        """
        from doorway3ds.web.base.access import is_loopback

        token = _token(self.token, self.host, is_loopback(self.host))

        from doorway3ds.web.base.links import link
        from doorway3ds.web.base.run import listen

        tls = self.tls or self.tls_cert is not None or self.tls_key is not None
        certificate = (
            _certificate(self.tls_cert, self.tls_key, tuple(self.tls_name or ())) if tls else None
        )
        bound = listen(self.host, self.port)
        port = bound.getsockname()[1]
        here = link("127.0.0.1" if self.host in ("0.0.0.0", "") else self.host, port, tls, token)
        shared = None if is_loopback(self.host) else link(self.host, port, tls, token)
        return Listening(bound, token, here, shared, certificate, self.tls_cert is None)


@dataclass(frozen=True)
class Listening:
    """An address taken. here: the page's link on this machine; shared: for others, or None."""

    bound: socket.socket
    token: str | None
    here: str
    shared: str | None
    certificate: Certificate | None
    own_certificate: bool

    def serve(self, app: Shield, doing: str) -> None:
        """Answers until Ctrl-C or SIGTERM; `doing` begins the line that says so."""
        from doorway3ds.web.base.links import qr_text
        from doorway3ds.web.base.run import make_server

        def ready() -> None:
            typer.echo(f"{doing} {self.shared or self.here}")
            if self.shared is not None:
                typer.echo(qr_text(self.shared), err=True)
            if self.certificate is not None and self.own_certificate:
                typer.echo(
                    "the certificate was made by this machine: browsers warn once; "
                    f"its SHA-256 fingerprint is\n{self.certificate.fingerprint}",
                    err=True,
                )
            sys.stdout.flush()

        make_server(app, self.certificate, ready).run(sockets=[self.bound])


def _token(token: str | None, host: str, is_loopback: bool) -> str | None:
    if token == "new":
        return secrets.token_urlsafe(24)
    if token is not None and not _TOKEN.fullmatch(token):
        raise CallError(
            "--token must be `new` or 8 to 256 letters, digits and . _ ~ - as in a link"
        )
    if token is None and not is_loopback:
        raise CallError(
            f"--host {host} lets other machines in; add --token new, or --token TEXT, or set "
            f"{TOKEN_VARIABLE}"
        )
    return token


def _certificate(chain: Path | None, key: Path | None, names: tuple[str, ...]) -> Certificate:
    from doorway3ds.web.base import tls

    if (chain is None) != (key is None):
        raise CallError("--tls-cert and --tls-key go together; pass both or neither")
    if chain is not None and key is not None:
        return tls.given(chain, key)
    base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return tls.self_signed(Path(base, "doorway3ds", "tls"), names)
