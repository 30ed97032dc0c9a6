"""Labels at an instant, and which box is right for which label."""

from pathlib import Path

import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.truth import Label, LabelTable, matched


def table(tmp_path: Path, *rows: str) -> LabelTable:
    path = tmp_path / "truth.csv"
    path.write_text("\n".join(("t,id,x,y", *rows)) + "\n")
    return LabelTable(path)


@pytest.mark.parametrize(
    ("rows", "time_s", "there", "gaps"),
    [
        # between two labels half a second apart the place is interpolated
        (["0.0,car,0.0,0.0", "0.5,car,1.0,2.0"], 0.25, [Label("car", 0.5, 1.0)], []),
        # a longer gap stays one
        (
            ["0.0,car,0.0,0.0", "0.512,car,1.0,2.0", "0.128,bus,4.0,4.0"],
            0.128,
            [Label("bus", 4.0, 4.0)],
            [Label("car", 0.25, 0.5)],
        ),
        (["0.0,car,0.0,0.0", "0.512,car,1.0,2.0", "0.25,bus,4.0,4.0"], 0.125, None, None),
        # a label within 20 ms belongs to the scan
        (["1.0,car,3.0,4.0"], 0.981, [Label("car", 3.0, 4.0)], []),
        (["1.0,car,3.0,4.0"], 1.019, [Label("car", 3.0, 4.0)], []),
        (["1.0,car,3.0,4.0"], 0.979, None, None),
        (["1.0,car,3.0,4.0"], 1.021, None, None),
        # a row without id is a scan without intruders
        (["1.0,,,", "9.0,car,0.0,0.0"], 1.0, [], []),
    ],
)
def test_labels_at_an_instant(
    rows: list[str], time_s: float, there: list[Label] | None, gaps: list[Label] | None, tmp_path: Path
) -> None:
    labels = table(tmp_path, *rows).at(round(time_s * NS), None)
    assert (labels and labels.there, labels and labels.gaps) == (there, gaps)


@pytest.mark.parametrize("time_s", ["16000000007", "-16000000007", "1600000000500"])
def test_a_time_that_64_bits_of_nanoseconds_do_not_hold_is_refused(tmp_path: Path, time_s: str) -> None:
    with pytest.raises(InputError, match=r"truth\.csv:3: t: "):
        table(tmp_path, "1600000000.5,car,0.0,0.0", f"{time_s},car,0.0,0.0")


def test_a_time_that_contradicts_the_scan_index_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("scan_index,t,id,x,y\n3,10.0,car,1.0,2.0\n4,23.1,car,1.0,2.0\n")
    known = LabelTable(path)
    labels = known.at(round(10.4 * NS), 3)
    assert labels is not None
    assert labels.there == [Label("car", 1.0, 2.0)]
    with pytest.raises(InputError, match=r"truth\.csv: scan_index 4 has t 23\.1"):
        known.at(round(10.1 * NS), 4)


@pytest.mark.parametrize(("gap_m", "is_right"), [(0.349, True), (0.351, False)])
def test_a_box_is_right_up_to_the_matching_distance(gap_m: float, is_right: bool) -> None:
    match = matched([Box(0.0, 0.0, 0.1, 0.1)], [Label("car", 0.1 + gap_m, 0.05)], 0.35)
    assert (match.truth_of, match.detection_of) == (([0], [0]) if is_right else ([None], [None]))
    assert match.touched == ([[0]] if is_right else [[]])


def test_of_two_boxes_on_a_label_the_one_with_the_nearer_centre_is_its_own() -> None:
    wide, narrow = Box(-1.0, -1.0, 1.2, 1.2), Box(-0.1, -0.1, 0.1, 0.1)
    for boxes, own in (([wide, narrow], 1), ([narrow, wide], 0)):
        match = matched(boxes, [Label("car", 0.0, 0.0)], 0.35)
        assert match.detection_of == [own]
        assert match.touched == [[0], [0]]


def test_as_many_pairs_as_can_be_and_a_box_too_far_off_stays_alone() -> None:
    """The box that lies near both labels takes the one that no other box can have."""
    boxes = [Box(0.0, 0.0, 1.0, 0.1), Box(-0.4, 0.0, -0.3, 0.1), Box(5.0, 0.0, 5.1, 0.1)]
    labels = [Label(name, x, 0.05) for name, x in (("left", 0.0), ("right", 1.0), ("far", 5.6))]
    match = matched(boxes, labels, 0.35)
    assert (match.truth_of, match.detection_of) == ([1, 0, None], [1, 0, None])
