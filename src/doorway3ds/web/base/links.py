"""Where a server is reached, as links and as a QR code."""

from __future__ import annotations

import contextlib
import io
import socket

from doorway3ds.web.base.access import is_loopback

_ANY = ("0.0.0.0", "::", "")


def local_addresses() -> list[str]:
    """This machine's addresses that others may reach, the one on the way out first."""
    found: list[str] = []
    for family, target in ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1")):
        try:
            # A datagram socket that is connected sends nothing; it only picks its own address.
            with socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect((target, 9))
                found.append(probe.getsockname()[0])
        except OSError:
            continue
    with contextlib.suppress(OSError):
        found += [str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None)]
    usable = (a for a in found if not is_loopback(a) and "%" not in a and a not in _ANY)
    return list(dict.fromkeys(usable))


def link(host: str, port: int, tls: bool, token: str | None) -> str:
    """The address of the page as people open it on this machine, or on others where they can."""
    if host in _ANY:
        host = next(iter(local_addresses()), "localhost")
    name = f"[{host}]" if ":" in host else host
    query = "" if token is None else f"?token={token}"
    return f"{'https' if tls else 'http'}://{name}:{port}/{query}"


def qr_text(url: str) -> str:
    """A QR code in block letters, for a terminal."""
    import segno

    out = io.StringIO()
    segno.make(url, micro=False, error="l").terminal(out, border=2, compact=True)
    return out.getvalue()


def qr_svg(url: str) -> bytes:
    """A QR code as an SVG file."""
    import segno

    out = io.BytesIO()
    segno.make(url, micro=False).save(
        out, kind="svg", border=3, light="#ffffff", dark="#1b2029", xmldecl=False, omitsize=True
    )
    return out.getvalue()
