"""A certificate that a server makes for itself, so that phones may lend it their camera."""

from __future__ import annotations

import contextlib
import datetime
import ipaddress
import os
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from doorway3ds.errors import UserError
from doorway3ds.files import whole
from doorway3ds.web.base.links import local_addresses

_VALID = datetime.timedelta(days=180)
_RENEW = datetime.timedelta(days=7)


@dataclass(frozen=True)
class Certificate:
    """Files of a certificate and its key; `fingerprint` is SHA-256 as browsers show it."""

    chain: Path
    key: Path
    fingerprint: str


def given(chain: Path, key: Path) -> Certificate:
    """The user's own certificate. Raises UserError if the two do not load together."""
    for path in (chain, key):
        if not path.is_file():
            raise UserError(f"no file {path}; expected a certificate or key in PEM format")
    return _checked(chain, key)


def self_signed(folder: Path, names: tuple[str, ...] = ()) -> Certificate:
    """A certificate for this machine's names and addresses, made in `folder` unless a usable one
    lies there: a browser that was told to trust it need not be told again.

    names: further names that browsers will use. Raises UserError if it cannot be written.
    """
    chain, key = folder / "certificate.pem", folder / "key.pem"
    wanted = _names(names)
    if not _usable(chain, key, wanted):
        _make(chain, key, wanted)
    return _checked(chain, key)


def _checked(chain: Path, key: Path) -> Certificate:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes

    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(chain, key, password=lambda: "")
        first = x509.load_pem_x509_certificate(chain.read_bytes())
    except (OSError, ValueError) as error:
        raise UserError(
            f"certificate {chain} and key {key} cannot be used together: "
            f"{getattr(error, 'reason', None) or error}; expected PEM, the key not encrypted"
        ) from error
    digest = first.fingerprint(hashes.SHA256())
    return Certificate(chain, key, ":".join(f"{byte:02X}" for byte in digest))


def _names(names: tuple[str, ...]) -> list[str]:
    host = socket.gethostname()
    own = ["localhost", host, *([f"{host}.local"] if "." not in host else [])]
    found = [*own, *names, "127.0.0.1", "::1", *local_addresses()]
    return list(dict.fromkeys(name for name in found if name.isascii() and name))


def _usable(chain: Path, key: Path, wanted: list[str]) -> bool:
    from cryptography import x509

    try:
        found = x509.load_pem_x509_certificate(chain.read_bytes())
        _checked(chain, key)
    except (OSError, ValueError, UserError):
        return False
    left = found.not_valid_after_utc - datetime.datetime.now(datetime.timezone.utc)
    try:
        alternatives = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return False
    have = {str(value.value) for value in alternatives}
    return left > _RENEW and have.issuperset(wanted)


def _make(chain: Path, key: Path, names: list[str]) -> None:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    private = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "doorway3ds")])
    alternatives: list[x509.GeneralName] = []
    for name in names:
        try:
            alternatives.append(x509.IPAddress(ipaddress.ip_address(name)))
        except ValueError:
            alternatives.append(x509.DNSName(name))
    now = datetime.datetime.now(datetime.timezone.utc)
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(private.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # a robot's clock may be behind
        .not_valid_after(now + _VALID)
        .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(private, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    _write_private(
        key,
        private.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
    )
    _write_private(chain, made.public_bytes(pem))
    with contextlib.suppress(OSError):
        chain.parent.chmod(0o700)


def _write_private(path: Path, data: bytes) -> None:
    """Writes a file that only its owner may read, whole or not at all."""
    with whole(path) as temporary:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
