"""Requests made up from the API's own description, and damaged ones."""

from __future__ import annotations

import random

from tests.web.conftest import Served, ask_made_up


def test_made_up_requests_get_documented_answers(shared: Served) -> None:
    assert ask_made_up(shared, each=12, passed_over=["/v1/stream"]) >= 50


def test_damaged_pictures_never_break_the_server(shared: Served, photo: bytes) -> None:
    rng = random.Random(1)
    for _ in range(60):
        data = bytearray(photo)
        for _ in range(rng.randint(1, 20)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        if rng.random() < 0.5:
            del data[rng.randrange(len(data)) :]
        answer = shared.client.post("/v1/decide?view=true", content=bytes(data))
        assert answer.status_code in (200, 400), answer.text
    assert shared.client.get("/healthz").json()["in_flight"] == 0
