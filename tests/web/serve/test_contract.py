"""Requests made up from the API's own description, and damaged ones."""

from __future__ import annotations

import random

import pytest

from tests.web.conftest import Served


def test_made_up_requests_get_documented_answers(shared: Served) -> None:
    schemathesis = pytest.importorskip("schemathesis")
    from hypothesis import HealthCheck, Phase, given, settings
    from schemathesis.specs.openapi.checks import positive_data_acceptance

    schema = schemathesis.openapi.from_dict(shared.client.get("/openapi.json").json())
    tried = 0
    for found in schema.get_all_operations():
        operation = found.ok()
        if operation.path == "/v1/stream":
            continue

        @given(case=operation.as_strategy())
        @settings(
            max_examples=12,
            deadline=None,
            derandomize=True,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        def documented(case: object) -> None:
            nonlocal tried
            tried += 1
            # A schema cannot say which bytes are a picture, nor which networks there are.
            case.call_and_validate(  # type: ignore[attr-defined]
                base_url=shared.url, excluded_checks=[positive_data_acceptance]
            )

        documented()
    assert tried >= 50


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
