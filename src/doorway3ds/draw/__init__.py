"""Annotated images: `annotate` composes a page, `overlay` marks the photograph itself."""

from doorway3ds.draw.page import annotate, overlay

__all__ = ["annotate", "overlay"]
