"""How several processes end one training."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")
from tests.lab.train.team import pair

pytestmark = pytest.mark.train

# One process of two; it writes when it has left.
_MEMBER = """
import os, sys, time
from pathlib import Path
import torch
import torch.distributed as dist
from doorway3ds.lab.train.engine import backend as engine

out, case = Path(sys.argv[1]), sys.argv[2]
team = engine.join()
total = torch.ones(1)
team.add_up([total])
assert total == 2
if case == "slow" and not team.leads:
    close = dist.destroy_process_group
    dist.destroy_process_group = lambda: (time.sleep(2), close())
if case == "late" and not team.leads:
    time.sleep(2)
if case == "gone" and team.leads:
    os._exit(3)
if case == "stuck" and not team.leads:
    time.sleep(300)
engine.leave(team, **({"farewell_s": 0.5} if case == "stuck" else {}))
assert not dist.is_initialized()
(out / str(team.rank)).write_text(repr(time.time()))
"""


@pytest.mark.parametrize("case", ["slow", "late"])
def test_the_leader_goes_last(tmp_path: Path, case: str) -> None:
    with pair(_MEMBER, tmp_path, case) as members:
        assert [member.wait(timeout=200) for member in members] == [0, 0]
    leader, member = (float((tmp_path / rank).read_text()) for rank in "01")
    assert leader > member - 0.1  # the member writes its time after its last word to the leader


def test_a_leader_that_is_gone_fails_no_member(tmp_path: Path) -> None:
    with pair(_MEMBER, tmp_path, "gone") as members:
        assert [member.wait(timeout=200) for member in members] == [3, 0]


def test_the_leader_waits_for_nobody_without_end(tmp_path: Path) -> None:
    with pair(_MEMBER, tmp_path, "stuck") as (leader, member):
        assert leader.wait(timeout=200) == 0
        assert member.poll() is None
