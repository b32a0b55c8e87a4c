"""Keras on PyTorch, set up once per process; several processes share one training.

Several GPUs or hosts: started by `torchrun`, each process takes its share of every batch and the
gradients are added up (torch.distributed, gloo on CPUs and NCCL on GPUs).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from doorway3ds.errors import UserError

_PATIENCE = timedelta(days=1)  # features of many pictures take long; the others wait for them


@dataclass(frozen=True)
class Team:
    """The processes of one training: this one's number and how many there are."""

    rank: int = 0
    size: int = 1

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

    if not dist.is_initialized():
        on_gpu = torch.cuda.is_available()
        if on_gpu:
            torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
        dist.init_process_group("nccl" if on_gpu else "gloo", timeout=_PATIENCE)
    return Team(dist.get_rank(), dist.get_world_size())


def leave() -> None:
    """Ends the team once all its members are done; does nothing outside of one."""
    dist = sys.modules.get("torch.distributed")
    if dist is not None and dist.is_available() and dist.is_initialized():
        # a member that goes first takes the store along, and the others' threads die of it
        dist.barrier()
        dist.destroy_process_group()


def wants_half(precision: str) -> bool:
    """Whether to compute in bfloat16: `auto` means on GPUs that have it."""
    import torch

    if precision == "auto":
        return bool(torch.cuda.is_available() and torch.cuda.is_bf16_supported())
    return precision == "bfloat16"


def device_of(model: Any) -> Any:
    """Where the weights of a Keras model lie."""
    return model.weights[0].value.device
