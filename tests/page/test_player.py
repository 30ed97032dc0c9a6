"""The player: its functions in node, and the page in a headless Chromium."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import midnet_bench.page
from midnet_bench.page.recording import COLUMNS, packed, tracked
from midnet_bench.workflows.report import PAGE, write_report
from tests.cli.command import unpainted
from tests.conftest import campaign_folder
from tests.page.browser import CHROMIUM, Browser

TRIAL_JS = Path(midnet_bench.page.__file__).with_name("trial.js")
NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="there is no node to run JavaScript with")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")


def in_node(expression: str, given: Any = None) -> Any:
    """What JavaScript makes of ``trial`` (the module), ``given``, and the ``lists`` that it has packed."""
    code = (
        f"const trial = require({json.dumps(str(TRIAL_JS))});"
        "const given = JSON.parse(require('fs').readFileSync(0));"
        "const bytes = given && require('zlib').inflateSync(Buffer.from(given.packed, 'base64'));"
        "const lists = given && trial.unpack(bytes, given.columns, given.frames);"
        f"console.log(JSON.stringify({expression}))"
    )
    done = subprocess.run(
        [NODE, "-e", code], input=json.dumps(given), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@needs_node
def test_what_is_packed_comes_out_again_frame_by_frame() -> None:
    rng = np.random.default_rng(1)
    columns = {"a": ("key", "x", "y"), "none": ("key",), "b": ("key", "z")}
    frames: dict[str, list[list[list[int]]]] = {name: [] for name in columns}
    for _ in range(40):
        keys = rng.permutation(6)[: rng.integers(0, 7)].tolist()
        frames["a"].append([[key, *rng.integers(-32768, 32768, 2).tolist()] for key in keys])
        frames["b"].append([[key, int(rng.integers(0, 5))] for key in range(int(rng.integers(0, 3)))])
        frames["none"].append([])
    expression = (
        "Object.fromEntries(Object.keys(given.columns).map((name) => [name, "
        "[...Array(40).keys()].map((f) => trial.rowsAt(lists[name], f).map((row) => Object.values(row)))]))"
    )
    given = {"packed": packed(columns, frames), "columns": columns, "frames": 40}
    assert in_node(expression, given) == frames


def test_a_box_keeps_its_track_while_it_moves_little() -> None:
    frames = [
        [(0, 10, 10, 1), (1, 10, 10, 2)],
        [(1, 12, 11, 3), (0, 200, 10, 4), (0, 11, 10, 5)],
        [(0, 11, 10, 6)],
    ]
    (guard_0, guard_1), second, third = ([row[0] for row in rows] for rows in tracked(frames))
    assert (guard_0 % 32, guard_1 % 32) == (0, 1)
    assert second[0] == guard_1
    assert second[2] == guard_0 == third[0]
    assert second[1] % 32 == 0
    assert second[1] != guard_0
    assert [[row[1:] for row in rows] for rows in tracked(frames)] == [
        [list(row[1:]) for row in rows] for rows in frames
    ]


WORDS = ["intruder 1", "outside_window", "ally_trail", "guard 2"]


def one_trial() -> dict[str, Any]:
    """Six frames: intruder 1 missed at frames 2 to 4 and 6, a false box at 3 and 4."""
    miss = [1, 0, 2, 1, 0, 0, 0, 10, 10, 20, 20]
    false = [0, 1, 3, 2, 4, 150, 40, 300, 300, 10, 10]
    truth = [[1, 10, 10, 20, 20, 1, 0]]
    found = [[[1, 10, 10, 20, 20, 1, 1]], [[32, 10, 10, 20, 20, 1]]]
    frames = {
        "robots": [[] for _ in range(6)],
        "truths": [found[0], truth, truth, truth, found[0], truth],
        "found": [[] for _ in range(6)],
        "detections": [found[1], [], [[33, 300, 300, 10, 10, 0]], [[33, 300, 300, 10, 10, 0]], found[1], []],
        "errors": [[], [miss], [miss, false], [miss, false], [], [miss]],
    }
    head = {"words": WORDS, "explained": True, "frames": 6, "hz": 5}
    return {"packed": packed(COLUMNS, frames), "columns": COLUMNS, "frames": 6, "head": head}


@needs_node
@pytest.mark.parametrize(
    ("explained", "miss", "false"),
    [
        (True, ", outside window, at guard 1", "guard 2, ally trail, guard 2, 1.5 s old, 20 cm off"),
        (False, "", "guard 2"),
    ],
)
def test_errors_that_go_on_are_one_by_their_causes_or_from_truths_and_boxes(
    explained: bool, miss: str, false: str
) -> None:
    trial = one_trial()
    trial["head"] |= {"explained": explained}
    expression = "trial.episodes(given.head, lists).map((one) => [one.first, one.last, trial.inWords(one)])"
    assert in_node(expression, trial) == [
        [1, 3, f"missed: intruder 1{miss}"],
        [2, 3, f"false positive: {false}"],
        [5, 5, f"missed: intruder 1{miss}"],
    ]


@needs_node
def test_a_box_over_an_intruder_that_has_another_one_is_its_second() -> None:
    frames = {name: [[]] for name in COLUMNS}
    frames["truths"] = [[[1, 10, 10, 20, 20, 1, 1]]]  # type: ignore[list-item]
    frames["detections"] = [[[32, 10, 10, 20, 20, 1], [33, 25, 25, 10, 10, 0]]]  # type: ignore[list-item]
    head = one_trial()["head"] | {"explained": False, "frames": 1}
    given = {"packed": packed(COLUMNS, frames), "columns": COLUMNS, "frames": 1, "head": head}
    expression = "trial.errorsAt(given.head, lists, 0).map((one) => trial.inWords(one))"
    assert in_node(expression, given) == ["second box on one intruder: guard 2"]


@needs_node
def test_counts_add_up() -> None:
    totals, third, first, *scores = in_node(
        "((totals) => [totals, trial.countsAt(totals, 2), trial.countsAt(totals, 0), trial.f1(totals, 5), "
        "trial.recentF1(totals, 5, 2), trial.recentF1(totals, 1, 10)])(trial.tally(given.head, lists))",
        one_trial(),
    )
    assert totals == {"found": [1, 1, 1, 1, 2, 2], "missed": [0, 1, 2, 3, 3, 4], "false": [0, 0, 1, 2, 2, 2]}
    assert third == {"found": 0, "missed": 1, "false": 1}
    assert first == {"found": 1, "missed": 0, "false": 0}
    assert scores == pytest.approx([2 * 2 / (2 * 2 + 4 + 2), 2 / 3, 2 / 3])


@needs_node
@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("[[1, 1], [5, 1], [5, -1], [0, -1]].map(([at, step]) =>"
         "trial.neighbour([{first: 1}, {first: 2}, {first: 5}], at, step))", [2, None, 2, None]),
        ("trial.parseHash('#trial=2&frame=40&cause=delay&play=1')",
         {"trial": 2, "frame": 40, "cause": "delay", "play": 1}),
        ("trial.parseHash('#figures')", {}),
        ("trial.parseHash('#trial=-1&frame=x')", {}),
    ],
)  # fmt: skip
def test_neighbours_and_addresses(expression: str, value: object) -> None:
    assert in_node(expression) == value


FRAME = "Number(document.querySelector('#scrub').value)"
LIVE = "document.querySelector('#live').textContent"


@needs_browser
@pytest.mark.slow
def test_a_browser_plays_steps_scrubs_and_jumps_to_errors(recorded_page: Path) -> None:
    with Browser() as browser:
        browser.open(recorded_page, "#trial=2&frame=1")
        assert browser.value(FRAME) == 1
        browser.press(".")
        browser.press(".")
        browser.press(",")
        assert browser.value(FRAME) == 2
        assert browser.value(LIVE).startswith("Frame 2, 0.4 s. ")
        browser.press("ArrowRight", "ArrowRight")
        assert browser.value(FRAME) == 7
        browser.press("Home", "Home")
        browser.press(" ", "Space")
        assert browser.value("document.querySelector('#play').getAttribute('aria-label')") == "Pause (space)"
        browser.wait_for(f"{FRAME} === 10")
        browser.wait_for("document.querySelector('#play').getAttribute('aria-label') === 'Play (space)'")
        browser.value(
            "(() => { const s = document.querySelector('#scrub'); s.value = 4;"
            "s.dispatchEvent(new Event('input')); })()"
        )
        assert browser.value(LIVE).startswith("Frame 4, 0.8 s. ")
        # from the list of errors, by a cause, by a link of the funnel, by the keys
        assert browser.value("document.querySelectorAll('#errors button').length") > 0
        browser.value("[...document.querySelectorAll('#errors button')].at(-1).click()")
        time = browser.value("[...document.querySelectorAll('#errors .time')].at(-1).textContent")
        assert browser.value(FRAME) == round(5.0 * float(time.removesuffix(" s")))
        browser.value("document.querySelector('#causes .cause a').click()")
        browser.wait_for("document.querySelector('#cause').value !== 'all'")
        cause = browser.value("document.querySelector('#causes .cause a').textContent")
        browser.wait_for(f"{LIVE}.includes({json.dumps(cause)})")
        assert browser.value("document.activeElement.id") == "arena"
        assert cause in browser.value("document.querySelector('#arena').getAttribute('aria-label')")
        browser.press("Home", "Home")
        before = browser.value(FRAME)
        starts = browser.value(
            "[...document.querySelectorAll('#errors .time')]"
            ".map((one) => Math.round(5 * parseFloat(one.textContent)))"
        )
        browser.press("n")
        later = [start for start in starts if start > before]
        assert browser.value(FRAME) == (min(later) if later else before)
        assert browser.complaints == []
        assert all(one.startswith(("file://", "data:")) for one in browser.requests)


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
def test_a_phone_shows_the_page_without_scrolling_sideways(recorded_page: Path, dark: bool) -> None:
    with Browser(390, 844, dark) as browser:
        browser.open(recorded_page)
        assert browser.value("document.documentElement.scrollWidth <= window.innerWidth")
        paper = browser.value("getComputedStyle(document.body).backgroundColor")
        assert paper == ("rgb(22, 24, 27)" if dark else "rgb(255, 255, 255)")
        # the floor of the arena, in the colour of the scheme
        middle = (
            "(() => { const c = document.querySelector('#arena');"
            "const pixel = c.getContext('2d').getImageData(c.width / 2, c.height / 3, 1, 1).data;"
            "return [...pixel].slice(0, 3) })()"
        )
        assert browser.value(middle) == ([34, 37, 41] if dark else [250, 249, 246])
        assert browser.complaints == []


@needs_browser
@pytest.mark.slow
def test_a_labyrinths_trial_tells_who_was_caught(tmp_path: Path) -> None:
    folder = campaign_folder(
        tmp_path / "labyrinth",
        experiment="labyrinth",
        grid={"robots": [2]},
        trials=1,
        parameters={"engine": "fast", "intruders": 2, "time_limit_s": 30, "record": True},
    )
    with unpainted():
        results, *_ = write_report(folder)
    caught = results.table("intruders").dropna(subset=["caught_at_s"])
    assert len(caught)
    with Browser() as browser:
        browser.open(folder / PAGE, "#trial=0&frame=1")
        browser.press("End", "End")
        browser.wait_for("document.querySelectorAll('#events button').length > 0")
        told = browser.value("[...document.querySelectorAll('#events button')].map((one) => one.textContent)")
        for number, at_s in zip(caught["intruder"], caught["caught_at_s"], strict=True):
            assert any(
                line.startswith(f"intruder {number} caught by guard ") and line.endswith(f", {at_s:.1f} s")
                for line in told
            )
        assert f"{len(caught)} caught" in browser.value("document.querySelector('#score').textContent")
        assert browser.complaints == []
