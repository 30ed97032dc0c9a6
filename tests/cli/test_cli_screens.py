"""Screens at 80 columns are as committed; ``python -m tests.cli.make_screens`` writes them anew."""

import pytest

from tests.cli.make_screens import FOLDER, screens


@pytest.mark.slow
def test_every_screen_is_the_committed_one_and_fits() -> None:
    now = dict(screens())
    committed = {path.stem: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.txt")}
    assert sorted(now) == sorted(committed)
    for name, text in now.items():
        assert text == committed[name], f"{name}: write the screens anew: python -m tests.cli.make_screens"
        assert max(map(len, text.splitlines())) <= 80, name
        assert "…" not in text
