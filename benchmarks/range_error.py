"""How far off is a network's distance to a doorway, by the distance that it says?

    3ds eval direction nyu --method opening --save-answers answers.jsonl
    python benchmarks/range_error.py nyu answers.jsonl

Prints a row for each span of distances: doorways, the median and the 68th percentile of the error
(the latter is what a standard deviation would be, without the weight of a few that are far off),
the middle of the signed error, and the 68th percentile over the distance said, to be compared with
`depth_error` of the network's metadata.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np

from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.evaluate.direction import judge
from doorway3ds.lab.evaluate.runners import match_answers
from doorway3ds.lab.evaluate.stored import read_answers

EDGES_M = (0.0, 1.5, 2.5, 3.5, 5.0, 12.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("answers", type=Path, nargs="+")
    options = parser.parse_args()
    dataset = read_dataset(options.dataset)
    runs = match_answers(dataset.samples, read_answers(options.answers))
    for label, records in runs.records.items():
        print(f"{label}, {options.dataset.name}")
        rows = []
        for record in records:
            outcome = judge(record)
            if outcome.matched is None:
                continue
            true_m, said_m = record.truth.openings[outcome.matched].range_m, record.listed[0][1]
            # A bearing to another thing than the doorway says nothing of the doorway's distance.
            if true_m is not None and said_m is not None and outcome.inside:
                rows.append((said_m, said_m - true_m))
        table = np.array(rows)
        print("distance said | doorways | median | 68 % | middle | 68 %, share")
        for low, high in [*itertools.pairwise(EDGES_M), (0.0, 99.0)]:
            span = table[(table[:, 0] >= low) & (table[:, 0] < high)]
            if not len(span):
                continue
            off = np.abs(span[:, 1])
            share = np.quantile(off / span[:, 0], 0.68)
            print(
                f"{low:g} to {high:g} m | {len(span)} | {np.median(off):.2f} m | "
                f"{np.quantile(off, 0.68):.2f} m | {np.median(span[:, 1]):+.2f} m | "
                f"{100 * share:.0f} %"
            )


if __name__ == "__main__":
    main()
