"""Who may enter, and how much may come."""

from __future__ import annotations

import socket
import threading
import time

import httpx
import pytest

from tests.web.conftest import Serve, Served, wait_for

TOKEN = "correct-horse-battery"


def test_every_answer_carries_the_security_headers(shared: Served) -> None:
    client = shared.client
    for path in ("/", "/healthz", "/nowhere", "/static/main.js"):
        headers = client.get(path).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
        assert headers["referrer-policy"] == "no-referrer"
        assert "server" not in headers


def test_head_is_answered_wherever_get_is(shared: Served) -> None:
    for path, status in (("/healthz", 200), ("/", 200), ("/metrics", 200), ("/v1/decide", 405)):
        got, head = shared.client.get(path), shared.client.head(path)
        assert (got.status_code, head.status_code, head.content) == (status, status, b"")
        assert head.headers["content-type"] == got.headers["content-type"]
    assert shared.client.head("/v1/stream").status_code == 405


def test_a_bug_is_an_error_object_with_headers(
    shared: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("doorway3ds.web.serve.routes.read_upload", broken)
    answer = shared.client.post("/v1/decide", content=b"x")
    assert answer.status_code == 500
    assert answer.json()["error"]["code"] == "bug"
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_without_the_token_nothing_is_told(serve: Serve) -> None:
    served = serve(token=TOKEN)
    for path in ("/v1/info", "/metrics", "/openapi.json", "/v1/decide", "/nix"):
        for headers in ({}, {"Authorization": "Bearer wrong"}, {"Cookie": "doorway3ds=wrong"}):
            answer = httpx.get(served.url + path, headers=headers)
            assert answer.status_code == 401
            assert answer.json()["error"]["code"] == "unauthorized"
    assert httpx.get(served.url + "/healthz").status_code == 200


def test_the_token_opens_by_header_and_by_the_link(serve: Serve) -> None:
    served = serve(token=TOKEN)
    assert served.client.get("/v1/info").status_code == 200
    with httpx.Client(base_url=served.url) as browser:
        form = browser.get("/")
        assert form.status_code == 401
        assert "asks for its token" in form.text
        wrong = browser.get("/", params={"token": "wrong"})
        assert wrong.status_code == 401
        entered = browser.get("/", params={"token": TOKEN})
        assert entered.status_code == 303
        assert entered.headers["location"] == "/"
        cookie = entered.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=lax" in cookie
        assert browser.get("/").status_code == 200
        assert browser.get("/v1/info").status_code == 200


def test_without_a_token_only_local_names_are_answered(shared: Served) -> None:
    served = shared
    for host, status in [
        (f"localhost:{served.port}", 200),
        (f"127.0.0.1:{served.port}", 200),
        ("evil.example", 403),
        ("", 403),
        ("127.0.0.1.evil.example", 403),
        ("[bad", 403),
    ]:
        assert served.client.get("/v1/info", headers={"Host": host}).status_code == status, host


def test_pages_of_other_sites_may_not_post(shared: Served, photo: bytes) -> None:
    served = shared
    for origin, status in [
        (served.url, 200),
        ("https://evil.example", 403),
        ("null", 403),
        ("http://127.0.0.1:1", 403),
    ]:
        answer = served.client.post("/v1/decide", content=photo, headers={"Origin": origin})
        assert answer.status_code == status, origin


def test_large_bodies_are_refused_by_length_and_by_count(serve: Serve) -> None:
    client = serve(limits={"max_bytes": 10_000}).client
    announced = client.post("/v1/decide", content=b"x" * 10_001)

    def chunks() -> object:
        for _ in range(20):
            yield b"x" * 1000

    counted = client.post("/v1/decide", content=chunks())
    for answer in (announced, counted):
        assert answer.status_code == 413
        assert answer.json()["error"]["code"] == "too_large"


def request(served: Served, text: bytes, seconds: float = 10) -> bytes:
    """All that comes back for `text` sent as it is."""
    with socket.create_connection(("127.0.0.1", served.port), timeout=seconds) as raw:
        raw.sendall(text)
        return read_all(raw)


def read_all(raw: socket.socket) -> bytes:
    data = b""
    while part := raw.recv(65536):
        data += part
    return data


def head(served: Served, length: int) -> bytes:
    return (
        f"POST /v1/decide HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n"
        f"Content-Length: {length}\r\n\r\n"
    ).encode()


def test_a_slow_body_is_given_up(serve: Serve) -> None:
    served = serve(limits={"body_s": 0.4})
    start = time.monotonic()
    answer = request(served, head(served, 1000) + b"x")
    assert answer.startswith(b"HTTP/1.1 408 ")
    assert b'"too_slow_body"' in answer
    assert time.monotonic() - start < 5
    assert served.state.uploads == 0


def test_a_slow_head_is_cut_off(serve: Serve) -> None:
    served = serve(limits={"head_s": 0.3})
    assert request(served, b"") == b""
    assert request(served, b"GET /healthz HTTP/1.1\r\nHost: ") == b""


def test_a_slow_head_is_cut_off_after_an_answer_too(serve: Serve) -> None:
    served = serve(limits={"head_s": 2})  # long enough for a busy machine's next request
    whole = f"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n\r\n".encode()
    with socket.create_connection(("127.0.0.1", served.port), timeout=10) as raw:
        for _ in range(2):
            raw.sendall(whole)
            answer = b""
            while not answer.endswith(b"}"):
                answer += raw.recv(65536)
            assert answer.startswith(b"HTTP/1.1 200 ")
        raw.sendall(b"GET /healthz HTTP/1.1\r\nHo")
        start = time.monotonic()
        assert b"HTTP/1.1" not in read_all(raw)
        assert time.monotonic() - start < 8


def test_a_long_head_is_refused(shared: Served) -> None:
    answer = request(shared, b"GET / HTTP/1.1\r\nX: " + b"x" * 20_000)
    assert answer.startswith(b"HTTP/1.1 431 ")
    assert b'"bad_request"' in answer


def test_a_head_in_pieces_and_a_body_in_chunks_arrive_whole(shared: Served, photo: bytes) -> None:
    head = f"POST /v1/decide HTTP/1.1\r\nHost: 127.0.0.1:{shared.port}\r\n".encode()
    head += b"Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n"
    chunks = b"".join(
        b"%x\r\n%s\r\n" % (len(part), part)
        for part in (photo[at : at + 500] for at in range(0, len(photo), 500))
    )
    sent = head + chunks + b"0\r\n\r\n"
    with socket.create_connection(("127.0.0.1", shared.port), timeout=10) as raw:
        for at in range(0, len(sent), 37):
            raw.sendall(sent[at : at + 37])
        answer = read_all(raw)
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert b'"reason": "turn"' in answer


def test_what_is_no_http_gets_an_error_object(shared: Served) -> None:
    answer = request(shared, b"\x16\x03\x01\x02\x00 hello\r\n\r\n")
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert b'"bad_request"' in answer


def test_a_client_that_hangs_up_leaves_nothing_behind(shared: Served, photo: bytes) -> None:
    served = shared
    for sent in (head(served, 5000) + b"half", head(served, len(photo)) + photo):
        with socket.create_connection(("127.0.0.1", served.port)) as raw:
            raw.sendall(sent)
    wait_for(lambda: served.state.uploads == 0 and served.state.work.in_flight == 0)
    assert served.client.post("/v1/decide", content=photo).status_code == 200


def test_too_many_uploads_are_refused(serve: Serve, photo: bytes) -> None:
    served = serve(limits={"uploads": 2})
    slow = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(2)]
    try:
        for raw in slow:
            raw.sendall(head(served, 5000))
        wait_for(lambda: served.state.uploads == 2)
        answer = served.client.post("/v1/decide", content=photo)
        assert answer.status_code == 429
        assert int(answer.headers["retry-after"]) >= 1
    finally:
        for raw in slow:
            raw.close()
    wait_for(lambda: served.state.uploads == 0)
    assert served.client.post("/v1/decide", content=photo).status_code == 200


def test_beyond_the_limit_decisions_are_refused_at_once(
    serve: Serve, photo: bytes, held: threading.Event
) -> None:
    served = serve(limits={"in_flight": 3}, workers=1)
    statuses: list[int] = []
    threads = [
        threading.Thread(
            target=lambda: statuses.append(
                httpx.post(f"{served.url}/v1/decide", content=photo, timeout=30).status_code
            )
        )
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    wait_for(lambda: served.state.work.in_flight == 3)
    refused = served.client.post("/v1/decide", content=photo)
    assert refused.status_code == 429
    assert refused.json()["error"]["code"] == "busy"
    assert int(refused.headers["retry-after"]) >= 1
    held.set()
    for thread in threads:
        thread.join()
    assert statuses == [200] * 3
    assert served.client.post("/v1/decide", content=photo).status_code == 200


def test_a_decision_that_takes_too_long_is_given_up(
    serve: Serve, photo: bytes, held: threading.Event
) -> None:
    served = serve(limits={"decision_s": 0.2})
    answer = served.client.post("/v1/decide", content=photo)
    assert answer.status_code == 503
    assert "retry-after" in answer.headers
    # It goes on in its thread and counts until it ends.
    assert served.state.work.in_flight == 1
    held.set()
    wait_for(lambda: served.state.work.in_flight == 0)


def test_the_end_waits_for_what_is_at_hand(
    serve: Serve, photo: bytes, held: threading.Event
) -> None:
    served = serve()
    answers: list[httpx.Response] = []
    post = threading.Thread(
        target=lambda: answers.append(
            httpx.post(f"{served.url}/v1/decide", content=photo, timeout=30)
        )
    )
    post.start()
    wait_for(lambda: served.state.work.in_flight == 1)
    end = threading.Thread(target=served.stop)
    end.start()
    time.sleep(0.3)
    held.set()
    end.join()
    post.join()
    assert answers[0].status_code == 200
