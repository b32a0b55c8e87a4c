"""The routes of the live page and the API."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Body, Depends, Query, Request, Response
from fastapi.responses import StreamingResponse

from doorway3ds import __version__
from doorway3ds.camera.presets import PRESETS
from doorway3ds.decide.pipeline import NEEDS
from doorway3ds.draw import annotate
from doorway3ds.images.codec import encode_jpeg, read_image
from doorway3ds.types import Decision
from doorway3ds.web.base.errors import ApiError, busy, errors, file_or
from doorway3ds.web.base.routes import json_answer
from doorway3ds.web.serve import schemas
from doorway3ds.web.serve.body import Upload, read_upload
from doorway3ds.web.serve.fields import DecideFields, SourceFields, upload_frame
from doorway3ds.web.serve.live import Live, Snapshot
from doorway3ds.web.serve.state import ServeState, serve_state
from doorway3ds.web.serve.view import view_of

router = APIRouter()
State = Annotated[ServeState, Depends(serve_state)]
_ALWAYS = (401, 403)
_BEAT_S = 10.0  # between signs of life on a stream without news


@router.post(
    "/v1/decide",
    response_model=schemas.DecisionAnswer,
    responses=errors(400, *_ALWAYS, 408, 413, 415, 422, 429, 500, 503),
    openapi_extra=schemas.upload_body(),
    summary="Decide on one image",
)
async def decide(
    request: Request, state: State, fields: Annotated[DecideFields, Query()]
) -> Response:
    """Send the image's bytes with the fields in the query, or multipart/form-data with the part
    `image` and the fields as parts (a part outranks the query). The image is not kept."""
    upload, decision = await _decide(request, state, fields)
    answer = {"image": upload.name, **decision.to_dict()}
    if upload.fields.view:
        answer["view"] = await asyncio.to_thread(view_of, decision)
    return json_answer(answer)


@router.post(
    "/v1/annotate",
    response_class=Response,
    responses=file_or(
        "image/jpeg", "The annotated image.", 400, *_ALWAYS, 408, 413, 415, 422, 429, 500, 503
    ),
    openapi_extra=schemas.upload_body(),
    summary="Draw the decision on one image",
)
async def draw(
    request: Request, state: State, fields: Annotated[DecideFields, Query()]
) -> Response:
    """Takes what /v1/decide takes; returns the annotated page as a JPEG."""
    _, decision = await _decide(request, state, fields)
    picture = await state.work.run(lambda: encode_jpeg(annotate(decision)), _hang_up(request))
    return Response(picture, media_type="image/jpeg")


async def _decide(
    request: Request, state: ServeState, fields: DecideFields
) -> tuple[Upload, Decision]:
    with _counted(state, "uploads"):
        upload = await read_upload(request, fields)
    decision = await state.work.run(lambda: _look(upload, state), _hang_up(request))
    state.metrics.decided("request", str(decision.reason), decision.timings_ms)
    return upload, decision


def _look(upload: Upload, state: ServeState) -> Decision:
    pipeline = state.pipelines.get(upload.fields)
    start = time.perf_counter()
    name = upload.shown or "the image"
    picture = read_image(upload.data, name=name, max_pixels=state.settings.limits.max_pixels)
    decoded = (time.perf_counter() - start) * 1e3
    frame = upload_frame(picture, upload.fields, state.settings.camera)
    decision = pipeline.decide(frame)
    return replace(decision, timings_ms={"decode": decoded, **decision.timings_ms})


def _hang_up(request: Request) -> Any:
    async def gone() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass

    return gone


@contextmanager
def _counted(state: ServeState, what: Literal["uploads", "streams"]) -> Iterator[None]:
    """Holds one of the places for `what`; 429 if there is none."""
    if getattr(state, what) >= getattr(state.settings.limits, what):
        raise busy(what, 1 if what == "uploads" else 10)
    setattr(state, what, getattr(state, what) + 1)
    try:
        yield
    finally:
        setattr(state, what, getattr(state, what) - 1)


@router.get(
    "/v1/stream",
    response_class=StreamingResponse,
    responses={
        **errors(*_ALWAYS, 404, 422, 429),
        200: {
            "content": {"text/event-stream": {"schema": {"type": "string"}}},
            "description": "Events `decision` (data: the decision's JSON) and `source` (data: the "
            "source's state).",
        },
    },
    summary="Follow the server's source",
)
async def stream(
    state: State,
    view: Annotated[bool, Query(description="Add `view`, as in /v1/decide.")] = False,
    max_hz: Annotated[float, Query(gt=0, le=60, description="Decisions a second at most.")] = 30,
) -> Response:
    """Server-sent events. A client that reads slowly misses decisions; none comes late."""
    live = state.require_live()
    if state.streams >= state.settings.limits.streams:
        raise busy("streams", 10)

    async def events() -> AsyncIterator[bytes]:
        seen: tuple[int, str] = (-1, "")
        told: tuple[str, str | None] | None = None
        with _counted(state, "streams"):
            yield b"retry: 2000\n\n"
            while not state.closing.is_set():
                now = (live.frames, live.state)
                if told != (now[1], live.doubt):
                    told = (now[1], live.doubt)
                    yield _event("source", _source(live))
                newest = live.newest
                if newest is not None and newest.number > seen[0]:
                    now = (newest.number, now[1])
                    data = await asyncio.to_thread(newest.to_dict, view)
                    yield _event("decision", data, newest.number)
                    await _rest(state, 1 / max_hz)
                seen = now
                if not await live.change(seen, _BEAT_S):
                    yield b": still here\n\n"

    headers = {"X-Accel-Buffering": "no"}
    return StreamingResponse(events(), media_type="text/event-stream", headers=headers)


async def _rest(state: ServeState, seconds: float) -> None:
    try:
        await asyncio.wait_for(state.closing.wait(), seconds)
    except TimeoutError:
        return


def _event(kind: str, data: Any, number: int | None = None) -> bytes:
    head = f"event: {kind}\n" + (f"id: {number}\n" if number is not None else "")
    return f"{head}data: {json.dumps(data, allow_nan=False)}\n\n".encode()


def _snapshot(live: Live, frame: int | None) -> Snapshot:
    snapshot = live.newest if frame is None else live.get(frame)
    if snapshot is None and frame is not None and live.newest is not None:
        raise ApiError(404, "frame_gone", f"the image of frame {frame} is no longer kept")
    if snapshot is None:
        raise ApiError(
            503,
            "no_frame",
            f"the source has sent no image yet{f': {live.problem}' if live.problem else ''}",
            {"Retry-After": "1"},
        )
    return snapshot


@router.get(
    "/v1/frame.jpg",
    response_class=Response,
    responses=file_or("image/jpeg", "X-Frame is the frame's number.", *_ALWAYS, 404, 422, 429, 503),
    summary="The source's newest image",
)
async def frame_jpg(
    request: Request,
    state: State,
    style: Annotated[
        Literal["overlay", "plain", "page"],
        Query(description="With its marks, as it came, or the whole annotated page."),
    ] = "overlay",
    frame: Annotated[
        int | None, Query(ge=0, description="The frame of an event, while it is kept.")
    ] = None,
) -> Response:
    snapshot = _snapshot(state.require_live(), frame)
    data = await state.work.run(lambda: snapshot.jpeg(style), _hang_up(request))
    return Response(data, media_type="image/jpeg", headers={"X-Frame": str(snapshot.number)})


@router.get(
    "/v1/decision",
    response_model=schemas.DecisionAnswer,
    responses=errors(*_ALWAYS, 404, 503),
    summary="The source's newest decision",
)
async def newest_decision(state: State) -> Response:
    """For programs that ask when they need to know; those that follow use /v1/stream."""
    live = state.require_live()
    return json_answer({"image": live.name, **_snapshot(live, None).to_dict()})


@router.put(
    "/v1/source",
    response_model=schemas.SourceAnswer,
    responses=errors(400, *_ALWAYS, 404, 408, 413, 422),
    summary="Decide on the source by other settings",
)
async def change_source(state: State, fields: Annotated[SourceFields, Body()]) -> Response:
    """All settings at once; those left out are the server's own. Everybody who follows the source
    sees the change."""
    live = state.require_live()
    await asyncio.to_thread(live.use, fields)
    return json_answer(_source(live))


def _source(live: Live) -> dict[str, Any]:
    return {
        "name": live.name,
        "state": live.state,
        "problem": live.problem,
        "warning": live.doubt,
        "frames": live.frames,
        "skipped": live.skipped,
        "fields": live.fields.model_dump(exclude_none=True),
    }


@router.get(
    "/v1/info",
    response_model=schemas.InfoAnswer,
    responses=errors(*_ALWAYS),
    summary="What this server can do",
)
async def info(state: State) -> Response:
    settings, limits = state.settings, state.settings.limits
    return json_answer(
        {
            "version": __version__,
            "method": settings.decide.method,
            "network": settings.decide.network,
            "methods": list(NEEDS),
            "networks": [
                {"name": name, "methods": state.pipelines.methods(name)}
                for name in state.pipelines.networks
            ],
            "cameras": [
                {"name": name, "hfov_deg": camera.hfov_deg, "vfov_deg": camera.vfov_deg}
                for name, (camera, _) in PRESETS.items()
            ],
            "camera_given": settings.camera.given,
            "limits": {
                "max_bytes": limits.max_bytes,
                "max_pixels": limits.max_pixels,
                "in_flight": limits.in_flight,
            },
            "source": _source(state.live) if state.live else None,
            "calibrating": state.calibration is not None,
            "link": settings.link,
        }
    )
