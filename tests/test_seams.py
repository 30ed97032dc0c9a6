"""What the options that name code take, and what a trial's parameters say of it."""

from pathlib import Path

import pytest

from midnet_bench.errors import InputError
from midnet_bench.rivals.seams import DETECTORS, FUSIONS
from midnet_bench.seams import PluginError, code_in

MINE = """
class Mine:
    def __init__(self, prior_map, range_m, away_m=0.3, name="a"):
        self.away_m, self.name = away_m, name
    def detect(self, team):
        return [[] for _ in team]

class Broken:
    def __init__(self, prior_map, range_m):
        raise KeyError("nothing")
    def detect(self, team): ...
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.py"
    file.write_text(MINE)
    return file


def test_a_name_of_this_package_stands_as_it_is() -> None:
    assert DETECTORS.pinned(" midnet ") == "midnet"
    assert FUSIONS.pinned("tracks( keep_s=1 ,hits=2)") == "tracks(hits=2, keep_s=1)"
    assert FUSIONS.make("suppression(iou=0.5)") is not None


def test_a_file_is_known_by_its_name_and_a_digest_of_its_bytes(mine: Path) -> None:
    pinned = DETECTORS.pinned("mine.py:Mine(name=b, away_m=0.5)")
    place, _, digest = pinned.partition("#")
    assert place == "mine.py:Mine(away_m=0.5, name=b)"
    assert DETECTORS.pinned(f"{mine}:Mine(away_m=0.5, name=b)") == pinned
    assert DETECTORS.pinned(pinned) == pinned
    assert code_in(["midnet", 3, None, pinned])[digest].content == mine.read_bytes()
    mine.write_text(MINE + "\n")
    assert DETECTORS.pinned("mine.py:Mine(name=b, away_m=0.5)") != pinned
    # what was pinned is what runs, whatever became of the file
    mine.unlink()
    made = DETECTORS.make(pinned, None, 2.5)
    assert (made.away_m, made.name) == (0.5, "b")


def test_an_installed_package_is_known_by_its_version() -> None:
    pinned = FUSIONS.pinned("midnet_bench.rivals.plain_fusions:NoFusion")
    assert pinned.startswith("midnet_bench.rivals.plain_fusions:NoFusion")
    assert FUSIONS.make(pinned).fuse([], 0.0).shape == (0, 4)
    with pytest.raises(InputError, match="what is here is"):
        FUSIONS.pinned("midnet_bench.rivals.plain_fusions:NoFusion@99.9")


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("midnett", "detector: unknown name 'midnett'; did you mean 'midnet'?"),
        ("midnet(thresh_local=3)", "goes by keys"),
        ("midnet#abc", "comes with midnet-bench"),
        ("clusters(noise=1)", "no option 'noise'; did you mean 'noise_m'?"),
        ("clusters(noise_m)", "'noise_m' is no key=value"),
        ("clusters(noise_m=1, noise_m=2)", "there twice"),
        ("clusters(noise_m=1", "expected NAME"),
        ("", "expected NAME"),
        ("mine.py:Nobody", "no 'Nobody' in mine.py"),
        ("gone.py:Mine", "gone.py cannot be read"),
        ("mine.py:Mine#000000000000", "no file with the digest"),
        ("mine.py:Mine(prior_map=1)", "no option 'prior_map'"),
        ("no_such_package.here:Mine", "ModuleNotFoundError"),
        ("os.path:join", "expected a class with a method 'detect'"),
    ],
)
def test_a_wrong_value_is_one_line_that_begins_with_the_option(value: str, says: str, mine: Path) -> None:
    with pytest.raises(InputError) as caught:
        DETECTORS.pinned(value)
    message = str(caught.value)
    assert message.startswith("detector: ")
    assert says in message
    assert "\n" not in message


def test_one_that_cannot_be_made_is_named(mine: Path) -> None:
    with pytest.raises(PluginError, match=r"Broken#\w+: mine.py:10 in __init__: KeyError: 'nothing'"):
        DETECTORS.make(DETECTORS.pinned("mine.py:Broken"), None, 2.5)
