"""A campaign's tables as pandas data frames, for a notebook."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from midnet_bench.campaign.store import FILE_NAME, open_store


def data_frames(directory: Path) -> dict[str, pd.DataFrame]:
    """The tables of a campaign's finished trials by name, such as ``scores``, ``frames`` and ``robots``.

    Rows stand in the campaign's order, led by the factors of its grid and the seed; undefined is NaN.

    Raises:
        InputError: there is no store in ``directory``, or it is damaged, foreign or of a newer version.
    """
    parts: dict[str, list[pd.DataFrame]] = {}
    with open_store(directory / FILE_NAME) as store:
        for trial in store.trials():
            if trial.status != "finished":
                continue
            place = {**store.definition.cell_of(trial.parameters), "seed": trial.seed}
            for name, rows in trial.tables.items():
                parts.setdefault(name, []).append(pd.DataFrame(rows).assign(**place))
    return {
        name: _led_by_place(pd.concat(frames, ignore_index=True), place) for name, frames in parts.items()
    }


def _led_by_place(frame: pd.DataFrame, place: Mapping[str, object]) -> pd.DataFrame:
    return frame[[*place, *(column for column in frame.columns if column not in place)]]
