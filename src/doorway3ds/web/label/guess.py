"""What the network would mark in an image, drawn in advance."""

from __future__ import annotations

from doorway3ds.camera.choice import FitCamera
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.images.codec import Picture
from doorway3ds.sources.base import View
from doorway3ds.types import Decision
from doorway3ds.web.label.marks import MarkedOpening, Marks
from doorway3ds.web.label.pictures import Guess, Guesser

_SURE = 0.5  # score from which a further opening is drawn, too
_FURTHER = 3


def guesser(pipeline: Pipeline, fit: FitCamera) -> Guesser:
    """Asks the pipeline; `fit` gives the camera of an image."""

    def guess(picture: Picture) -> Guess:
        decision = pipeline.decide(View(fit).of_picture(picture))
        return Guess(marks_of(decision), float(decision.p_open))

    return guess


def marks_of(decision: Decision) -> Marks:
    """A decision's openings as marks, to a tenth of a pixel; none where it sees no open doorway."""
    best, *others = decision.selection.openings or (None,)
    if best is None or not decision.open:
        return Marks()
    further = [opening for opening in others if opening.score >= _SURE][:_FURTHER]
    width = decision.frame.camera.width
    found = []
    for opening in (best, *further):
        left = -0.5 if opening.cut in ("left", "both") else round(opening.left_px, 1)
        right = width - 0.5 if opening.cut in ("right", "both") else round(opening.right_px, 1)
        clear = decision.selection.clear if opening is best else None
        if left < right:
            found.append(MarkedOpening(left, right, clear=clear))
    return Marks(tuple(found))
