"""Workers on Ray: the same worker as an actor of Ray Data, on this machine or a cluster."""

from __future__ import annotations

import logging
import pickle
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from doorway3ds.errors import UserError
from doorway3ds.lab.batch.items import Item
from doorway3ds.lab.batch.pool import one_by_one
from doorway3ds.lab.batch.rows import Row
from doorway3ds.lab.batch.worker import Chunk, Job, Worker

WINDOW = 512
"""Chunks that are handed to Ray at once: what bounds the driver's memory."""


def _actor(job: Job) -> type:
    """A class of actors that hold a worker; chunks and answers travel as pickled bytes."""

    class Actor:
        def __init__(self) -> None:
            self._worker = Worker(job)

        def __call__(self, batch: dict[str, Any]) -> dict[str, Any]:
            import numpy as np

            rows = [pickle.dumps(self._worker.answer(pickle.loads(one))) for one in batch["chunk"]]
            return {"place": batch["place"], "rows": np.array(rows, dtype=object)}

    return Actor


def answers(chunks: Iterable[Chunk], job: Job, address: str) -> Iterator[tuple[Item, Row | None]]:
    """Each item with its row, as `pool.answers`, decided by Ray's actors.

    address: of a cluster, or "auto": the cluster that this machine belongs to, else a new local
    Ray. Actors take a GPU each if the cluster has some, else one CPU each.

    Raises UserError if there is no Ray at the address.
    """
    ray = _connect(address)
    from ray.data import ActorPoolStrategy, DataContext

    context = DataContext.get_current()
    context.execution_options.preserve_order = True
    context.enable_progress_bars = False
    # A chunk that ends its actors is answered on this machine, item by item.
    context.max_errored_blocks = -1
    logging.getLogger("ray.data").setLevel(logging.ERROR)
    total = ray.cluster_resources()
    gpus = int(total.get("GPU", 0))
    size = max(gpus or int(total.get("CPU", 1)), 1)
    source = iter(chunks)
    while window := list(islice(source, WINDOW)):
        items = [
            {"place": place, "chunk": pickle.dumps(list(chunk))}
            for place, chunk in enumerate(window)
        ]
        given = ray.data.from_items(items, override_num_blocks=min(len(items), 4 * size))
        answered = given.map_batches(
            _actor(job),
            batch_size=1,
            num_cpus=0 if gpus else 1,
            num_gpus=1 if gpus else 0,
            compute=ActorPoolStrategy(min_size=1, max_size=size),
        )
        place = 0
        for row in answered.iter_rows():
            for missing in window[place : row["place"]]:
                yield from one_by_one(missing, job)
            rows = pickle.loads(row["rows"])
            yield from zip((item for item, _ in window[row["place"]]), rows, strict=True)
            place = row["place"] + 1
        for missing in window[place:]:
            yield from one_by_one(missing, job)


def _connect(address: str) -> Any:
    import ray

    if ray.is_initialized():
        return ray
    try:
        if address == "auto":
            try:
                ray.init(address="auto", log_to_driver=False, logging_level="ERROR")
            except ConnectionError:
                ray.init(log_to_driver=False, logging_level="ERROR", include_dashboard=False)
        else:
            ray.init(address=address, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"no Ray at {address}: {reason}; start one or use --ray auto") from error
    return ray
