"""What tests of recordings share."""

import pytest


@pytest.fixture
def no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A replay looks at how its setup fits, and not for a better one, which takes half of its time."""
    search = "midnet_bench.recording.fitting.setup_check._quick_search"
    monkeypatch.setattr(search, lambda search: [search.as_set])
