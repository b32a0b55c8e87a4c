"""Keras on PyTorch, set up once per process; several processes share one training.

Several GPUs or hosts: started by `torchrun`, each process takes its share of every batch and the
gradients are added up (torch.distributed, gloo on CPUs and NCCL on GPUs).
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any

from doorway3ds.errors import UserError

_PATIENCE = timedelta(days=1)  # features of many images take long; the others wait for them
_FAREWELL_S = 60.0  # the leader's files are written by then: it waits no longer for the others
_LOOK_S = 0.1


@dataclass(frozen=True)
class Team:
    """The processes of one training: this one's number and how many there are.

    store: what they tell each other by beside the gradients; None for a team of one.
    """

    rank: int = 0
    size: int = 1
    store: Any = field(default=None, repr=False, compare=False)

    @property
    def leads(self) -> bool:
        """Whether this process writes files and speaks."""
        return self.rank == 0

    def share(self, indices: Sequence[int]) -> Sequence[int]:
        """This process's part of a batch."""
        return indices[self.rank :: self.size]

    def add_up(self, tensors: Sequence[Any]) -> None:
        """Replaces each tensor by its sum over all processes."""
        if self.size > 1:
            import torch.distributed as dist

            for tensor in tensors:
                dist.all_reduce(tensor)

    def align(self, variables: Sequence[Any]) -> None:
        """Gives Keras variables the leader's values in every process."""
        if self.size > 1:
            import torch.distributed as dist

            for variable in variables:
                dist.broadcast(variable.value.data, src=0)

    def told(self, value: Any) -> Any:
        """The leader's value, in every process."""
        if self.size == 1:
            return value
        import torch.distributed as dist

        box = [value]
        dist.broadcast_object_list(box, src=0)
        return box[0]


ALONE = Team()


def start(threads: int | None = None) -> Any:
    """Keras with the PyTorch back end and channels first; raises UserError for another back end."""
    # the back end is chosen when Keras is first imported
    os.environ["KERAS_BACKEND"] = "torch"
    import keras
    import torch

    if keras.config.backend() != "torch":
        raise UserError(
            f"Keras runs on {keras.config.backend()} in this process; training needs PyTorch: "
            "set KERAS_BACKEND=torch before Keras is imported"
        )
    keras.config.set_image_data_format("channels_first")
    if threads:
        torch.set_num_threads(threads)
    return keras


def join() -> Team:
    """The team that `torchrun` has started this process in; a team of one without it."""
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1:
        return ALONE
    import torch
    import torch.distributed as dist

    on_gpu = torch.cuda.is_available()
    if on_gpu:
        torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
    store, rank, size = next(dist.rendezvous("env://", timeout=_PATIENCE))
    store.set_timeout(_PATIENCE)
    backend = "nccl" if on_gpu else "gloo"
    dist.init_process_group(backend, timeout=_PATIENCE, store=store, rank=rank, world_size=size)
    return Team(rank, size, store)


def leave(team: Team, farewell_s: float = _FAREWELL_S) -> None:
    """Ends the team once all its members are done; does nothing for a team of one.

    The leader closes its connections when everyone has said to be done, and goes last, since the
    store may live in its process. farewell_s: how long it waits for the others to say so. The
    work is done by then, so what breaks on the way out fails nobody.
    """
    if team.store is None:
        return
    import torch.distributed as dist

    others = range(1, team.size)
    end = time.monotonic() + (farewell_s if team.leads else _PATIENCE.total_seconds())
    with contextlib.suppress(RuntimeError):  # of which torch's errors of connections are
        team.store.set(f"done/{team.rank}", "")
        awaited = others if team.leads else [0]
        _wait_for(team.store, [f"done/{rank}" for rank in awaited], end)
    with contextlib.suppress(RuntimeError):
        dist.destroy_process_group()
    with contextlib.suppress(RuntimeError):
        team.store.set(f"left/{team.rank}", "")
        if team.leads:
            _wait_for(team.store, [f"left/{rank}" for rank in others], end)


def _wait_for(store: Any, keys: list[str], end: float) -> None:
    """Until all keys are set, or the monotonic clock says `end`."""
    # asked again and again: a wait inside the store would shut out torch's own threads
    while not store.check(keys) and time.monotonic() < end:
        time.sleep(_LOOK_S)


def wants_half(precision: str) -> bool:
    """Whether to compute in bfloat16: `auto` means on GPUs that have it."""
    import torch

    if precision == "auto":
        return bool(torch.cuda.is_available() and torch.cuda.is_bf16_supported())
    return precision == "bfloat16"


def device_of(model: Any) -> Any:
    """Where the weights of a Keras model lie."""
    return model.weights[0].value.device
