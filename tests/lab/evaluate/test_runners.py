import json
import math

import numpy as np
import pytest

from doorway3ds.decide.gates import decide
from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.evaluate import direction, runners
from doorway3ds.lab.evaluate.runners import Protocol
from doorway3ds.lab.evaluate.stored import Label, read_answers
from doorway3ds.types import Perception, Selection


class Oracle:
    """A network that knows the doorway of the miniature's first picture: columns 290 to 390."""

    name = "oracle"
    gives = frozenset({"p_open", "columns", "depth"})

    def __call__(self, image, camera):
        depth = np.full((46, 62), 2.0, np.float32)
        columns = columns_from_spans([(290, 390)], camera.width)
        return Perception(0.9, columns, depth, network=self.name)


def run(nyu, **options):
    samples = read_dataset(nyu).samples
    answer = runners.methods_on(Oracle(), "oracle", ["opening", "paper"], **options)
    return runners.run_direction(samples, answer)


def test_methods_stand_side_by_side_on_one_pass(nyu):
    runs = run(nyu)
    assert [str(label) for label in runs.records] == ["opening on oracle", "paper on oracle"]
    outcome = direction.judge(runs.records[Label("opening", "oracle")][0])
    assert abs(outcome.error_deg) < 0.5
    assert outcome.within == outcome.inside == 1
    assert runs.left_out == {}


def test_true_depth_leads_the_paper_to_the_deep_columns(nyu):
    """The miniature's true depth is deepest in columns 300 to 400 of the uncut picture."""
    runs = run(nyu, truth_depth=True)
    label = Label("paper", "oracle + true depth")
    assert direction.judge(runs.records[label][0]).inside == 1


def test_no_network_at_all_needs_true_depth_and_the_paper_method(nyu):
    with pytest.raises(CallError, match="opening columns"):
        runners.methods_on(None, "true depth", ["opening"])
    samples = read_dataset(nyu).samples
    answer = runners.methods_on(None, "true depth", ["paper"])
    runs = runners.run_direction(samples, answer, p_open_known=False)
    (records,) = runs.records.values()
    assert all(math.isnan(r.p_open) for r in records)
    assert records[0].reason != "no_door"


def test_unknown_methods_are_refused():
    with pytest.raises(CallError, match="got 'best'"):
        runners.methods_on(Oracle(), "oracle", ["best"])


def test_any_function_of_a_frame_can_be_measured(nyu):
    def left(frame):
        seen = Perception(0.9)
        return decide(seen, Selection(12.0, None, None, None), frame, "paper")

    def answer(frame, _):
        return {Label("left", "none"): left(frame)}

    (records,) = runners.run_direction(read_dataset(nyu).samples, answer).records.values()
    assert {r.listed for r in records} == {((12.0, None),)}


def test_a_damaged_picture_is_left_out_and_named(nyu):
    (nyu / "images" / "0003.jpg").write_bytes(b"damaged")
    runs = run(nyu)
    assert list(runs.left_out) == ["0003.jpg"]
    assert {len(records) for records in runs.records.values()} == {2}
    for picture in (nyu / "images").iterdir():
        picture.write_bytes(b"damaged")
    with pytest.raises(UserError, match="no image is left"):
        run(nyu)


def test_stored_answers_score_as_the_live_ones(nyu, tmp_path):
    runs = run(nyu)
    lines = [json.dumps(answer) for column in runs.answers.values() for answer in column]
    file = tmp_path / "answers.jsonl"
    file.write_text("\n".join(lines) + "\n\n")
    again = runners.match_answers(read_dataset(nyu).samples, read_answers([file]))
    assert again.records == runs.records


def test_answers_of_look_match_by_the_end_of_their_path(nyu, tmp_path):
    answer = {
        "image": str(nyu / "images" / "0002.jpg"),
        "method": "opening",
        "network": "other",
        "p_open": 0.7,
        "reason": "turn",
        "bearing_deg": 3.0,
        "range_m": None,
        "clear": True,
        "openings": [{"bearing_deg": 3.0, "range_m": None}],
    }
    file = tmp_path / "look.jsonl"
    file.write_text(json.dumps(answer) + "\n")
    runs = runners.match_answers(read_dataset(nyu).samples, read_answers([file]))
    (records,) = runs.records.values()
    assert [r.truth.image for r in records] == ["0002.jpg"]
    assert set(runs.left_out) == {"0003.jpg", "0045.jpg"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no stored answers"),
        ("{", "line 1: expected an object"),
        ("[1, 2]", "line 1: expected an object"),
        ('{"image": "0002.jpg"}', "line 1: expected an object"),
    ],
)
def test_damaged_answers_are_refused(tmp_path, content, message):
    file = tmp_path / "answers.jsonl"
    file.write_text(content)
    with pytest.raises(UserError, match=message):
        read_answers([file])


def test_an_answer_without_a_field_names_picture_and_field(nyu, tmp_path):
    file = tmp_path / "answers.jsonl"
    file.write_text('{"image": "0002.jpg", "method": "a", "network": "b", "openings": []}')
    with pytest.raises(UserError, match=r"a on b to 0002\.jpg lacks or spoils 'bearing_deg'"):
        runners.match_answers(read_dataset(nyu).samples, read_answers([file]))


def test_classifier_records_carry_kinds_of_negatives_only(nyu):
    samples = read_dataset(nyu).samples
    runs = runners.run_classifier(samples, {"oracle": Oracle()})
    assert [(r.is_open, r.kinds) for r in runs.records["oracle"]] == [
        (True, ()),
        (True, ()),
        (False, ("closed door",)),
    ]
    assert runs.left_out == {}


def test_depth_runs_say_crop_and_mirroring(nyu):
    (nyu / "depth" / "0003.png").unlink()
    samples = read_dataset(nyu).samples
    runs = runners.run_depth(samples, {"oracle": Oracle()}, mirror=True)
    assert runs.left_out == {"0003.jpg": "no true depth"}
    assert set(runs.records) == {
        Protocol("oracle", crop, mirrored)
        for crop in ("whole", "eigen")
        for mirrored in (False, True)
    }
    eigen = runs.records[Protocol("oracle", "eigen", False)][0].errors
    # 2 m against 51 x 9.9955 / 255 m; the columns at "10 m or more" are no depth
    assert eigen.rmse == pytest.approx(2 - 51 * 9.9955 / 255, abs=1e-6)
    assert eigen.pixels == 425 * (560 - 100)


def test_worst_depth_cases_are_those_of_the_lowest_delta1(nyu):
    shares = iter((0.5, 0.1, 0.9))

    def partly_right(image, camera):
        depth = np.full((46, 62), 9.0, np.float32)
        depth[: round(46 * next(shares))] = 2.0
        return Perception(0.9, depth_m=depth)

    runs = runners.Runs()
    for sample in read_dataset(nyu).samples:  # as folds are added
        runs.add(runners.run_depth([sample], {"some": partly_right}, mirror=False, worst=1))
    assert [sample.name for sample, _, _ in runs.worst["some"]] == [
        "0003.jpg",
        "0002.jpg",
        "0045.jpg",
    ]
    _, depth_m, record = runs.worst["some"][0]
    assert depth_m.shape == (46, 62)
    assert record.errors.delta1 == pytest.approx(0.1, abs=0.02)
