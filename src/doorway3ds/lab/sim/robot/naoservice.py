"""What a virtual NAO's services share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao import VirtualNao


def returns(signature: str) -> Callable[[Any], Any]:
    """Declares a method's return signature to qi, as `qi.bind` does, without importing it."""

    def mark(method: Any) -> Any:
        method.__qi_name__, method.__qi_signature__ = None, None
        method.__qi_return_signature__ = signature
        return method

    return mark


class Service:
    # Calls run at the same time: stopMove must not wait for moveTo.
    __qi_threading__ = "multi"

    def __init__(self, nao: VirtualNao) -> None:
        self._nao = nao
