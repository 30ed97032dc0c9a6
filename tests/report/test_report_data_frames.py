from pathlib import Path

import pandas as pd

from midnet_bench.analysis.frames import data_frames
from midnet_bench.campaign.definition import Campaign
from midnet_bench.campaign.export import export_csv
from midnet_bench.campaign.store import FILE_NAME, open_store
from midnet_bench.experiments.campaigns import run_campaign


def test_frames_hold_what_the_csv_files_hold(tmp_path: Path) -> None:
    campaign = Campaign(
        experiment="detection", grid={"robots": [1, 2]}, trials=2, base_seed=3, parameters={"frames": 5}
    )
    run_campaign(campaign, tmp_path)
    with open_store(tmp_path / FILE_NAME) as store:
        export_csv(store, tmp_path)
    frames = data_frames(tmp_path)
    assert set(frames) == {"scores", "frames", "robots"}
    for name, frame in frames.items():
        pd.testing.assert_frame_equal(frame, pd.read_csv(tmp_path / f"{name}.csv"))
    assert frames["scores"].groupby("robots").size().to_dict() == {1: 2, 2: 2}
