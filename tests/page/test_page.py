"""``report.html`` of real campaigns: complete in itself, and what it says is what the files say."""

import base64
import csv
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.trial import Scalar
from midnet_bench.experiments.registry import experiment_of, tables_of
from midnet_bench.page.page import FALSE_BOXES, MISSES, Content, Funnel, report_page
from midnet_bench.page.recording import Recording
from midnet_bench.workflows.report import PAGE, write_report
from tests.cli.command import REPOSITORY, unpainted
from tests.stores import labyrinth_store

VOID = {"meta", "link", "img", "input", "br"}


class Parsed(HTMLParser):
    """The elements of a page with their attributes, and that every one that was opened was closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: dict[str, str] = {}
        self._open: list[tuple[str, str]] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        self.elements.append((tag, attributes))
        if tag not in VOID:
            self._open.append((tag, attributes.get("id", "")))

    def handle_endtag(self, tag: str) -> None:
        opened, _ = self._open.pop()
        assert opened == tag

    def handle_data(self, data: str) -> None:
        for _, id_ in self._open:
            if id_:
                self.texts[id_] = self.texts.get(id_, "") + data

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.elements if name == tag]


def check_complete(folder: Path) -> Parsed:
    """The page of a folder, which loads nothing, names everything, and has the files' own bytes."""
    text = (folder / PAGE).read_text(encoding="utf-8")
    assert len(text.encode()) < 10_000_000
    page = Parsed(text)
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    for tag, attributes in page.elements:
        for name in ("src", "href", "srcset", "action", "poster", "data"):
            if name in attributes:
                assert re.match("data:|#", attributes[name]), (tag, attributes[name][:60])
        for name in ("aria-describedby", "aria-labelledby", "for"):
            assert attributes.get(name, ids[0]) in ids
        target = attributes.get("href", "")
        assert not target.startswith("#") or target[1:] in ids or target.startswith("#trial="), target
    assert not re.search(r"@import|url\(", text)
    assert all(image["alt"] for image in page.all("img"))
    assert all(button.get("aria-label") for button in page.all("button"))
    downloads = {link["download"]: link["href"] for link in page.all("a") if "download" in link}
    for name, link in downloads.items():
        if (folder / name).exists():
            assert base64.b64decode(link.split("base64,")[1]) == (folder / name).read_bytes(), name
    tables = {path.stem for path in folder.glob("*.tex")}
    assert tables <= {name.removesuffix(".csv") for name in downloads}
    return page


@pytest.mark.slow
def test_a_recorded_campaigns_page_is_complete_and_made_alike_again(
    recorded_page: Path, recorded_campaign: Path
) -> None:
    page = check_complete(recorded_page.parent)
    head = json.loads(page.texts["trials"])
    assert [(trial["cell"], trial["seed"], trial["frames"]) for trial in head["trials"]] == [
        ("1-robot", 1, 10),
        ("1-robot", 2, 10),
        ("3-robot", 1, 10),
        ("3-robot", 2, 10),
    ]
    assert {f"{kind}-{n}" for kind in ("trial", "scans") for n in range(4)} <= set(page.texts)
    write_report(recorded_campaign)
    assert (recorded_campaign / PAGE).read_bytes() == recorded_page.read_bytes()


@pytest.mark.slow
def test_the_funnel_counts_each_recorded_error_and_its_examples_show_it(recorded_campaign: Path) -> None:
    results = load_results(recorded_campaign, tables_of)
    errors, funnel = results.table("errors"), Funnel()
    recordings = list(experiment_of(results).report.recordings(results))
    for place, recording in enumerate(recordings):
        funnel.add(recording, place)
    is_miss = errors["kind"] == "miss"
    for side, rows in ((MISSES, errors[is_miss]), (FALSE_BOXES, errors[~is_miss])):
        for cell, robots in (("1-robot", 1), ("3-robot", 3)):
            counted = {c: funnel.total(side, cell, c) for c in funnel.causes(side)}
            wanted = rows[rows["robots"] == robots]["cause"].value_counts().to_dict()
            assert {cause: count for cause, count in counted.items() if count} == wanted
            assert funnel.total(side, cell) == sum(wanted.values())
    assert funnel.examples
    for (_, cause), example in funnel.examples.items():
        recording = recordings[example.trial]
        there = recording.frames["errors"][example.frame - 1]
        assert cause in [recording.words[row[2] - 1] for row in there]


def content(**changed: object) -> Content:
    """A page of one table."""
    table = Table(
        "scores", "Scores <of> two", [{"name": "a & b", "value": 0.5}, {"name": "paper", "value": 1.0}]
    )
    parts = {
        "title": "t",
        "lead": "l",
        "conclusion": "c",
        "headline": [table],
        "verdicts": "",
        "claims": None,
        "counterfactuals": None,
    }
    parts |= {"tables": [], "pictures": [], "provenance": [], "configuration": {}, "version": "1"}
    return Content(**{**parts, **changed})  # type: ignore[arg-type]


@pytest.mark.slow
def test_what_does_not_fit_is_left_out_scans_first_and_told(recorded_campaign: Path) -> None:
    results = load_results(recorded_campaign, tables_of)
    recordings: list[Recording] = list(experiment_of(results).report.recordings(results))

    def made(most_bytes: int) -> str:
        text = report_page(content(), recordings, most_bytes)
        assert len(text.encode()) <= most_bytes
        return text

    whole = made(10_000_000)
    size = len(whole.encode())
    assert "left out" not in Parsed(whole).texts["player"].split("Keys:")[1]
    assert "To keep the page" not in whole
    fewer = made(size - 100)
    assert "3 of 4 trials have their scans here, those with the most errors first" in fewer
    assert all(f'id="trial-{n}"' in fewer for n in range(4))
    scans = sum(len(text) for id_, text in Parsed(whole).texts.items() if id_.startswith("scans-"))
    fewest = made(size - scans - 100)
    told = re.search(r"(\d) of 4 recorded trials, those with the fewest errors, are left out", fewest)
    assert 0 < len(json.loads(Parsed(fewest).texts["trials"])["trials"]) == 4 - int(told[1])


def test_a_page_says_what_it_is_given_as_text_and_has_a_chapter_for_what_is_there() -> None:
    table = Table("counterfactuals", "Without", [{"cause": "<script>alert(1)</script>", "removed": 0.9}])
    text = report_page(content(title="<b>", counterfactuals=table), [])
    page = Parsed(text)
    assert page.all("b") == []
    assert page.all("script") == []
    assert "What goes when a cause is taken away" in page.texts["counterfactuals"]
    assert "<script>alert(1)</script>" in page.texts["counterfactuals"]
    assert [link["href"] for link in page.all("a") if link["href"].startswith("#")] == [
        "#results",
        "#counterfactuals",
        "#provenance",
    ]


@pytest.mark.slow
def test_a_page_without_recorded_trials_has_figures_with_their_numbers(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"intruders": [1, 5], "robots": [1, 2, 3, 4, 5]}
    store = tmp_path / "campaign.sqlite"
    labyrinth_store(store, lambda k, q, seed: min(k, q + seed % 2), seeds=4, grid=grid).close()
    write_report(tmp_path)
    page = check_complete(tmp_path)
    assert "player" not in page.texts
    images = page.all("img")
    assert len(images) == 2
    assert "5 intruders" in images[0]["alt"]
    links = {link["download"]: link["href"] for link in page.all("a") if "download" in link}
    lines = base64.b64decode(links["success_rate_data.csv"].split("base64,")[1]).decode().splitlines()
    assert lines[0] == "panel,series,at,value,low,high"
    assert len(lines) == 1 + 2 * 5
    rates = {(row[0].split(",")[0], row[2]): row[3:] for row in csv.reader(lines[1:])}
    value, low, high = map(float, rates["5 intruders", "2"])
    assert value == pytest.approx(50.0)
    assert low < value < high
    assert "Caught of all intruders: 1 robot " in page.texts["results"]
    assert page.texts["results"].index("success_rate") < page.texts["results"].index("wall")
    statements = (tmp_path / "claims.csv").read_text().splitlines()[1:]
    assert f"Of {len(statements)} claims " in page.texts["verdicts"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mapping", "detection", "people"])
def test_every_experiment_has_a_page(name: str, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(REPOSITORY / "results" / "reference" / name, tmp_path / name))
    with unpainted():
        write_report(folder)
    page = check_complete(folder)
    assert page.texts["results"]
