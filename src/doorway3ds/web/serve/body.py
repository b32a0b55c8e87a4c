"""The image and the fields of a request, held in memory alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fastapi import Request
from pydantic import ValidationError
from starlette.datastructures import UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import ClientDisconnect

from doorway3ds.web.base.errors import ApiError, invalid
from doorway3ds.web.base.work import ClientGone
from doorway3ds.web.serve.fields import DecideFields

_MAX_FIELDS = 20
_SHOWN = 60  # letters of a name in messages
_MAX_FIELD_BYTES = 4096


class _InMemory(MultiPartParser):
    """Starlette's parser writes parts of more than 1 MiB to the disk; uploads are not kept."""

    spool_max_size = 2**40


@dataclass(frozen=True)
class Upload:
    """What came: the image file's bytes, its name if it has one, and how to decide."""

    data: bytes
    name: str | None
    fields: DecideFields

    @property
    def shown(self) -> str:
        """The name as an error's one line may hold it."""
        name = (self.name or "").rpartition("/")[2]
        return "".join(c if c.isprintable() else "?" for c in name)[:_SHOWN]


async def read_upload(request: Request, fields: DecideFields) -> Upload:
    """Reads the body of a request, which `Shield` bounds; `fields` are those of its query.

    Raises ApiError for a body or field that cannot be used, ClientGone if the client hung up.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    try:
        if kind == "multipart/form-data":
            data, name, parts = await _read_multipart(request)
            fields = _parse({**fields.model_dump(exclude_unset=True), **parts})
        elif kind == "application/json" or kind.startswith("text/"):
            raise ApiError(
                415,
                "unsupported_media_type",
                f"expected an image's bytes or multipart/form-data with the part image, got {kind}",
            )
        else:
            data, name = await request.body(), None
    except ClientDisconnect as error:
        raise ClientGone from error
    if not data:
        raise ApiError(
            400, "no_image", "no image came; send its bytes as the body or as part image"
        )
    return Upload(data, fields.name or name, fields)


def _parse(given: dict[str, Any]) -> DecideFields:
    try:
        return DecideFields.model_validate(given)
    except ValidationError as error:
        raise invalid(error.errors()) from error


async def _read_multipart(request: Request) -> tuple[bytes, str | None, dict[str, Any]]:
    parser = _InMemory(
        request.headers,
        request.stream(),
        max_files=1,
        max_fields=_MAX_FIELDS,
        max_part_size=_MAX_FIELD_BYTES,
    )
    try:
        form = await parser.parse()
    except MultiPartException as error:
        raise ApiError(400, "bad_multipart", error.message) from error
    except (ApiError, ClientDisconnect):
        raise
    except Exception as error:  # a damaged boundary or header raises what it likes
        raise ApiError(400, "bad_multipart", "the multipart body cannot be parsed") from error
    fields: dict[str, Any] = {}
    data, name = b"", None
    for key, value in form.multi_items():
        if isinstance(value, UploadFile):
            if key != "image":
                raise ApiError(422, "invalid_field", "the image's part must be called image")
            data, name = await value.read(), (value.filename or None)
            await value.close()
        elif key == "image":
            raise ApiError(422, "invalid_field", "image must be a file part, with a filename")
        else:
            fields[key] = value
    return data, name[:255] if name else None, fields
