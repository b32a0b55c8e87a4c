"""The routes of a guided calibration."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Body, Depends, Query, Response

from doorway3ds.camera.board import print_lines, printable
from doorway3ds.camera.info import camera_info_of
from doorway3ds.errors import UserError
from doorway3ds.web.base.errors import ApiError, errors, file_or
from doorway3ds.web.base.routes import json_answer
from doorway3ds.web.serve import schemas
from doorway3ds.web.serve.calibration import BoardFields, CalibrationFields, CalibrationRun
from doorway3ds.web.serve.state import ServeState, serve_state

router = APIRouter()
State = Annotated[ServeState, Depends(serve_state)]
_ALWAYS = (401, 403)


@router.get(
    "/v1/calibration",
    response_model=schemas.CalibrationAnswer,
    responses=errors(*_ALWAYS, 404),
    summary="How far the guided calibration is",
)
async def progress(state: State) -> Response:
    """`state` is none, taking, computing, done or failed. A result is kept until the next start or
    DELETE."""
    state.require_live()
    return _answer(state.calibration)


@router.post(
    "/v1/calibration",
    response_model=schemas.CalibrationAnswer,
    responses=errors(400, *_ALWAYS, 404, 408, 409, 413, 422),
    summary="Begin a guided calibration of the source",
)
async def begin(state: State, fields: Annotated[CalibrationFields, Body()]) -> Response:
    """Frames are taken by themselves once the board is sharp, still and in a new place; the source
    goes on deciding. One calibration at a time."""
    live = state.require_live()
    if state.calibration is not None and state.calibration.running:
        raise ApiError(409, "calibrating", "a calibration is under way; finish or delete it first")
    state.calibration = CalibrationRun(live, fields)
    return _answer(state.calibration)


@router.post(
    "/v1/calibration/finish",
    response_model=schemas.CalibrationAnswer,
    responses=errors(*_ALWAYS, 404, 409),
    summary="Compute the camera with the frames taken so far",
)
async def finish(state: State) -> Response:
    state.require_live()
    if state.calibration is None:
        raise ApiError(409, "not_calibrating", "no calibration is under way")
    state.calibration.finish()
    return _answer(state.calibration)


@router.delete(
    "/v1/calibration",
    response_model=schemas.CalibrationAnswer,
    responses=errors(*_ALWAYS, 404),
    summary="Drop the calibration, or its result",
)
async def drop(state: State) -> Response:
    state.require_live()
    run, state.calibration = state.calibration, None
    if run is not None:
        run.cancel()
    return _answer(None)


@router.get(
    "/v1/calibration/camera.yaml",
    response_class=Response,
    responses=file_or("application/yaml", "A ROS camera_info file.", *_ALWAYS, 404),
    summary="The calibrated camera's file",
)
async def camera_file(state: State) -> Response:
    state.require_live()
    run = state.calibration
    if run is None or run.found is None:
        raise ApiError(404, "no_calibration", "there is no calibrated camera yet")
    headers = {"Content-Disposition": f'attachment; filename="{run.fields.name}.yaml"'}
    text = camera_info_of(run.found.camera)
    return Response(text, media_type="application/yaml", headers=headers)


@router.get(
    "/v1/calibration/board.pdf",
    response_class=Response,
    responses=file_or("application/pdf", "One A4 page.", *_ALWAYS, 422, 429, 503),
    summary="The board to print at 100 %",
)
async def board_pdf(state: State, fields: Annotated[BoardFields, Query()]) -> Response:
    board = fields.pattern()

    def page() -> bytes:
        try:
            return printable(board, print_lines(fields.options.given()))
        except UserError as error:  # it does not fit on the page
            raise ApiError(422, "invalid_field", str(error)) from error

    headers = {"Content-Disposition": 'inline; filename="board.pdf"'}
    return Response(await state.work.run(page), media_type="application/pdf", headers=headers)


def _answer(run: CalibrationRun | None) -> Response:
    return json_answer({"state": "none"} if run is None else run.to_dict())
