"""Certificates, links, and the command around the server."""

from __future__ import annotations

import re
import signal
import ssl
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from doorway3ds.errors import UserError
from doorway3ds.web.base import tls
from doorway3ds.web.base.access import is_loopback
from doorway3ds.web.base.links import link, qr_svg, qr_text
from tests.conftest import Cli
from tests.web.conftest import Serve


def test_a_certificate_made_here_serves_its_names(serve: Serve, tmp_path: Path) -> None:
    made = tls.self_signed(tmp_path / "tls", ("doorbot.test",))
    assert made.key.stat().st_mode & 0o077 == 0
    served = serve(certificate=made, token="correct-horse")
    trusting = ssl.create_default_context(cafile=str(made.chain))
    for name in ("localhost", "127.0.0.1", "doorbot.test"):
        with httpx.Client(verify=trusting) as client:
            answer = client.get(
                f"https://127.0.0.1:{served.port}/healthz",
                headers={"Host": name},
                extensions={"sni_hostname": name},
            )
            assert answer.status_code == 200
    cookie = served.client.get("/", params={"token": "correct-horse"}).headers["set-cookie"]
    assert "secure" in cookie.lower()


def test_a_certificate_is_kept_until_its_names_change(tmp_path: Path) -> None:
    first = tls.self_signed(tmp_path)
    assert tls.self_signed(tmp_path).fingerprint == first.fingerprint
    assert tls.self_signed(tmp_path, ("other.test",)).fingerprint != first.fingerprint
    first.chain.write_text("damaged")
    assert re.fullmatch(r"([0-9A-F]{2}:){31}[0-9A-F]{2}", tls.self_signed(tmp_path).fingerprint)


def test_certificates_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    one, other = tls.self_signed(tmp_path / "a"), tls.self_signed(tmp_path / "b")
    with pytest.raises(UserError, match="cannot be used together"):
        tls.given(one.chain, other.key)
    with pytest.raises(UserError, match="expected a certificate"):
        tls.given(tmp_path / "none.pem", one.key)


def test_links_and_codes() -> None:
    assert link("127.0.0.1", 8000, False, None) == "http://127.0.0.1:8000/"
    assert link("::1", 8443, True, "secret-1") == "https://[::1]:8443/?token=secret-1"
    assert "0.0.0.0" not in link("0.0.0.0", 80, False, None)
    assert qr_svg("https://x/?token=1").startswith(b"<svg")
    assert len(qr_text("https://x/?token=1").splitlines()) > 10
    assert is_loopback("127.9.9.9")
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--host", "0.0.0.0"], "add --token new"),
        (["--token", "short"], "8 to 256"),
        (["--token", "has space in it"], "8 to 256"),
        (["--method", "magic"], "'opening', 'paper'"),
        (["--tls-cert", "x.pem"], "go together"),
        (["--network", "nothing"], "no network 'nothing'"),
        (["--camera", "nothing"], "neither a preset"),
        (["webcom://0"], "no source is called webcom"),
    ],
)
def test_wrong_calls(cli: Cli, arguments: list[str], says: str) -> None:
    given = arguments if "--network" in arguments else [*arguments, "--network", "net.onnx"]
    ran = cli("serve", "--port", "0", *given)
    assert ran.status == 2
    assert says in ran.err


def test_missing_sources_and_taken_ports_are_said(cli: Cli, serve: Serve) -> None:
    ran = cli("serve", "nothing.mp4", "--port", "0", "--network", "net.onnx")
    assert (ran.status, "nothing.mp4 does not exist" in ran.err) == (1, True)
    ran = cli("serve", "--port", serve().port, "--network", "net.onnx")
    assert (ran.status, "cannot listen on 127.0.0.1" in ran.err) == (1, True)


def test_the_command_serves_and_ends_on_sigterm(network: Path, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "doorway3ds.cli.main", "serve", "--port", "0"]
    call += ["--host", "0.0.0.0", "--token", "new", "--tls", "--network", str(network)]
    process = subprocess.Popen(
        call,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={"XDG_STATE_HOME": str(tmp_path), "PATH": "", "HOME": str(tmp_path)},
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.match(r"serving (https://\S+:(\d+))/\?token=([\w-]{32})\n", line)
        assert found, line
        local = f"https://127.0.0.1:{found[2]}"
        assert httpx.get(f"{local}/v1/info", verify=False, timeout=30).status_code == 401
        bearer = {"Authorization": f"Bearer {found[3]}"}
        info = httpx.get(f"{local}/v1/info", headers=bearer, verify=False, timeout=30).json()
        assert info["link"] == line.split()[1]
    finally:
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGTERM  # uvicorn raises it again, once all is closed
    assert "fingerprint" in said
    assert "█" in said or "▀" in said
    assert "Traceback" not in said
