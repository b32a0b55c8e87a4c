"""The routes of marking. Images are asked for by number: no path comes from a request."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Any, cast

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from doorway3ds.errors import UserError
from doorway3ds.web.base.access import ServerSettings
from doorway3ds.web.base.errors import ApiError, errors, file_or
from doorway3ds.web.base.routes import json_answer
from doorway3ds.web.base.state import ServerState, server_state
from doorway3ds.web.label.marks import MAX_OPENINGS, MarkedOpening, Marks
from doorway3ds.web.label.pictures import Pictures, Prepared
from doorway3ds.web.label.table import MarkedMeanwhile, Table


class LabelState(ServerState):
    """What the routes of marking share."""

    def __init__(self, settings: ServerSettings, pictures: Pictures, table: Table) -> None:
        super().__init__(settings, "label.html")
        self.pictures = pictures
        self.table = table


def label_state(request: Request) -> LabelState:
    """What the server of a request shares between its routes."""
    return cast(LabelState, server_state(request))


router = APIRouter()
State = Annotated[LabelState, Depends(label_state)]
Number = Annotated[int, Path(ge=0, description="Number of the image, from 0.")]
Confidence = Annotated[int, Field(ge=1, le=3)]
Column = Annotated[float, Field(allow_inf_nan=False)]
_ALWAYS = (401, 403)
_KEEP = {"Cache-Control": "private, max-age=86400"}


class OpeningBody(BaseModel):
    """One opening; its edges in the image's own pixels, at mid-height."""

    model_config = ConfigDict(extra="forbid", strict=True)

    left_px: Column
    right_px: Column
    half_open: bool = False
    clear: bool | None = None
    confidence: Confidence = 3


class MarksBody(BaseModel):
    """What is marked in an image; without openings, `closed` tells a closed door from none."""

    model_config = ConfigDict(extra="forbid", strict=True)

    openings: list[OpeningBody] = Field(default=[], max_length=MAX_OPENINGS)
    closed: bool = False
    confidence: Confidence = 3


class ChangeBody(BaseModel):
    """marks null takes an image's marks away. revision: of the marks that are changed."""

    model_config = ConfigDict(extra="forbid", strict=True)

    marks: MarksBody | None
    revision: str = Field(max_length=40)


@router.get("/v1/folder", responses=errors(*_ALWAYS), summary="The folder and its state")
async def folder(state: State) -> Response:
    """`start` is the image to go on with: the first unmarked one after the last marked one."""
    states = await asyncio.to_thread(state.table.states)
    pictures = state.pictures
    there = set(pictures.names)
    marked = [n for n, name in enumerate(pictures.names) if name in states]
    after = marked[-1] if marked else -1
    return json_answer(
        {
            "name": pictures.folder.resolve().name,
            "pictures": len(pictures),
            "marked": len(marked),
            "start": _unmarked(state, states, after) or 0,
            "guesses": pictures.guesses,
            "left_out": list(pictures.left_out),
            "rows_of_others": sum(name not in there for name in states),
            "link": state.access.link,
        }
    )


@router.get("/v1/unmarked", responses=errors(*_ALWAYS, 422), summary="The next unmarked")
async def unmarked(
    state: State, after: Annotated[int, Query(ge=-1, description="Look from here on.")] = -1
) -> Response:
    """`number` is null where every image that can be read is marked."""
    states = await asyncio.to_thread(state.table.states)
    return json_answer({"number": _unmarked(state, states, after)})


def _unmarked(state: LabelState, states: Any, after: int) -> int | None:
    """The first unmarked image after number `after`, going round; None if all are marked."""
    count = len(state.pictures)
    for step in range(1, count + 1):
        number = (after + step) % count
        if state.pictures.names[number] not in states and number not in state.pictures.unreadable:
            return number
    return None


@router.get(
    "/v1/pictures/{number}",
    responses=errors(*_ALWAYS, 404, 422, 429, 503),
    summary="One image's size, its marks and the network's guess",
)
async def picture(state: State, number: Number) -> Response:
    """An image that cannot be read has no width, and `problem` says why."""
    name = _name(state, number)
    try:
        seen: Prepared | None = await state.work.run(lambda: state.pictures.prepare(number))
        problem = None if seen is None else seen.problem
    except UserError as error:
        seen, problem = None, str(error)
    marks, revision = await asyncio.to_thread(state.table.get, name)
    guess = None if seen is None or seen.guess is None else seen.guess
    version = state.pictures.version(number)
    return json_answer(
        {
            "number": number,
            "name": name,
            "width": seen.width if seen else None,
            "height": seen.height if seen else None,
            "image": f"/v1/pictures/{number}/image.jpg?version={version}" if seen else None,
            "problem": problem,
            "guess": None if guess is None else asdict(guess.marks),
            "p_open": None if guess is None else guess.p_open,
            "marks": None if marks is None else asdict(marks),
            "revision": revision,
        }
    )


@router.get(
    "/v1/pictures/{number}/image.jpg",
    response_class=Response,
    responses=file_or(
        "image/jpeg", "A copy, upright, of moderate size.", 400, *_ALWAYS, 404, 422, 429, 503
    ),
)
async def image(
    state: State,
    number: Number,
    version: Annotated[str, Query(max_length=80, description="Lets browsers keep it.")] = "",
) -> Response:
    _name(state, number)
    seen = await state.work.run(lambda: state.pictures.prepare(number))
    headers = _KEEP if version == state.pictures.version(number) else {}
    return Response(seen.jpeg, media_type="image/jpeg", headers=headers)


@router.put(
    "/v1/pictures/{number}",
    responses=errors(400, *_ALWAYS, 404, 408, 409, 413, 422, 429, 503),
    summary="Save one image's marks",
)
async def save(request: Request, state: State, number: Number, change: ChangeBody) -> Response:
    """Answers once the table is written. 409 if somebody else has marked the image since
    `revision`: nothing is then changed."""
    name = _name(state, number)
    seen = await state.work.run(lambda: state.pictures.prepare(number))
    marks = None if change.marks is None else _marks(change.marks, seen.width)
    place = state.pictures.place(number)
    try:
        revision = await asyncio.to_thread(state.table.put, name, marks, change.revision, place)
    except MarkedMeanwhile as error:
        raise ApiError(
            409, "marked_meanwhile", "somebody else has marked this image meanwhile"
        ) from error
    except UserError as error:
        raise ApiError(503, "not_written", str(error), {"Retry-After": "5"}) from error
    states = await asyncio.to_thread(state.table.states)
    marked = sum(name in states for name in state.pictures.names)
    return json_answer({"revision": revision, "marked": marked})


def _marks(body: MarksBody, width: int) -> Marks:
    """Marks in the image's columns, to a tenth of a pixel; ApiError if they make no sense."""
    openings = []
    try:
        for opening in body.openings:
            left = round(max(opening.left_px, -0.5), 1)
            right = round(min(opening.right_px, width - 0.5), 1)
            openings.append(
                MarkedOpening(left, right, opening.half_open, opening.clear, opening.confidence)
            )
        return Marks(tuple(openings), body.closed, body.confidence)
    except ValueError as error:
        raise ApiError(422, "invalid_field", f"marks: {error}") from error


def _name(state: LabelState, number: int) -> str:
    if number >= len(state.pictures):
        raise ApiError(
            404, "no_picture", f"images are numbered from 0 to {len(state.pictures) - 1}"
        )
    return state.pictures.names[number]
