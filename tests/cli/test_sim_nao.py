"""`3ds sim nao` as a user calls it."""

from __future__ import annotations

import pytest

from doorway3ds.cli.sim import reason_of

TAKEN = (
    "an error occurred when listening to one of the requested endpoints:\n"
    "failed to listen on 127.0.0.1:9559: bind: Address already in use "
    "[system:98 at /build/x.hpp:161 in function 'bind']"
)
FORBIDDEN = (
    "an error occurred when listening to one of the requested endpoints:\n"
    "failed to listen on 127.0.0.1:80: bind: Permission denied [system:13 at /build/x.hpp:161]"
)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (TAKEN, "another program listens there; stop it or choose another port with --listen"),
        (FORBIDDEN, "permission denied"),
        ("", "no reason given"),
    ],
)
def test_why_it_cannot_listen_is_one_line_without_libqis_files(error: str, reason: str) -> None:
    assert reason_of(RuntimeError(error)) == reason


@pytest.mark.nao
def test_libqis_own_error_for_a_taken_port_is_understood() -> None:
    qi = pytest.importorskip("qi")
    qi.logging.setLevel(qi.logging.FATAL)
    first, second = qi.Session(), qi.Session()
    first.listenStandalone("tcp://127.0.0.1:0")
    with pytest.raises(RuntimeError) as caught:
        second.listenStandalone(first.endpoints()[0])
    first.close()
    assert "another program listens there" in reason_of(caught.value)
