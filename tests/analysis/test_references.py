"""The committed reference results: each table agrees with the frames or trials that it was made from."""

from pathlib import Path

import numpy as np

from midnet_bench.analysis.frames import load_results
from midnet_bench.experiments.registry import tables_of

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
COUNTS = ["tp", "fp", "fn", "intruders_in_range", "matched", "duplicates", "missed"]


def test_the_frames_of_the_detection_reference_sum_to_its_scores() -> None:
    tables = load_results(REFERENCE / "detection", tables_of).tables
    cells = ["robots", "seed"]
    summed = tables["frames"].groupby(cells)[[*COUNTS, "error_sum_m"]].sum()
    scores = tables["scores"].set_index(cells)
    assert len(scores) == 40
    assert (tables["frames"].groupby(cells).size() == scores["frames"]).all()
    assert (summed[COUNTS] == scores[COUNTS]).all(axis=None)
    np.testing.assert_allclose(summed["error_sum_m"], scores["error_sum_m"], rtol=1e-12)


def test_the_labyrinth_reference_has_every_trial_and_eq_11_holds_in_each() -> None:
    tables = load_results(REFERENCE / "labyrinth").tables
    place = ["intruders", "robots", "seed"]
    trials = tables["trial"].set_index(place)
    caught = (
        (tables["intruders"]["outcome"] == "caught")
        .groupby([tables["intruders"][key] for key in place])
        .sum()
    )
    assert len(trials) == 500
    assert (trials["caught"] == caught).all()
    numbers = trials.index.get_level_values("intruders")
    np.testing.assert_allclose(trials["success_rate"], 100.0 * trials["caught"] / numbers)
