"""The names that ``import midnet_bench`` offers, as a notebook uses them."""

from pathlib import Path

import numpy as np
import pytest

import midnet_bench as mb

REPOSITORY = Path(__file__).parents[1]


def room() -> mb.OccupancyGrid:
    """6 x 4 m with walls around."""
    walls = np.zeros((80, 120), np.int8)
    walls[[0, -1], :] = walls[:, [0, -1]] = 100
    return mb.OccupancyGrid(walls, 0.05, (-3.0, -2.0))


def costmap() -> mb.OccupancyGrid:
    """4 x 4 m with an obstacle of 0.3 x 0.3 m around (0, 0)."""
    costs = np.zeros((80, 80), np.int8)
    costs[37:43, 57:63] = 100
    return mb.OccupancyGrid(costs, 0.05, (-3.0, -2.0))


def test_every_public_name_is_there_and_listed() -> None:
    assert set(mb.__all__) <= set(dir(mb))
    for name in mb.__all__:
        assert getattr(mb, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'MIDnet'"):
        mb.MIDnet  # noqa: B018


def test_own_costmaps_give_the_box_that_the_map_lacks() -> None:
    frame = mb.MIDNet(mb.prior_map(room())).update([mb.Observation(mb.Pose2D(-1.0, 0.0, 0.0), costmap())])
    (box,) = frame.detections
    assert box.x_min == pytest.approx(-0.15)
    assert box.y_max == pytest.approx(0.15)
    assert box.area == pytest.approx(0.09)


def test_a_prior_map_is_the_one_that_trials_subtract() -> None:
    path = REPOSITORY / "midnet_bench/arena/maps/map1.yaml"
    with mb.simulate("detection", robots=1, frames=1) as frames:
        of_the_trial = frames.trial.prior
    for given in (path, str(path), mb.load_map(str(path))):
        prior = mb.prior_map(given)
        assert prior.data.dtype == np.uint8
        assert np.array_equal(prior.data, of_the_trial.data)
        assert (prior.resolution, prior.origin) == (of_the_trial.resolution, of_the_trial.origin)


def test_the_parameters_of_a_prior_map_move_its_walls() -> None:
    plain, thin = mb.prior_map(room()), mb.prior_map(room(), thresh_global=100)
    assert (plain.data == 0).sum() > (thin.data == 0).sum() == (room().data == 100).sum()
    with pytest.raises(mb.InputError, match=r"thresh_globl.*did you mean 'thresh_global'"):
        mb.prior_map(room(), thresh_globl=90)
    with pytest.raises(mb.InputError, match=r"thresh_global.*101"):
        mb.prior_map(room(), thresh_global=101)
    with pytest.raises(mb.InputError, match="uint8"):
        mb.prior_map(mb.OccupancyGrid(np.zeros((4, 4), np.uint8), 0.05, (0.0, 0.0)))


def test_frames_carry_what_each_robot_told() -> None:
    with mb.simulate("detection", robots=2, frames=3, engine="fast") as frames:
        told = [frame.observations for frame in frames]
    assert [len(one) for one in told] == [2, 2, 2]
    for guard in told[-1]:
        assert guard.costmap.data.dtype == np.int8
        assert guard.scan.ranges_m.shape == (360,)
    assert not np.array_equal(told[0][0].costmap.data, told[-1][0].costmap.data)
    (view,) = next(mb.simulate("labyrinth", robots=1, engine="fast")).observations
    assert abs(view.pose.x) < 10.0


@pytest.mark.slow
def test_simulated_frames_are_those_of_the_campaign(tmp_path: Path, trials_in_this_process: None) -> None:
    (tmp_path / "one.yaml").write_text("experiment: detection\nparameters: {robots: 1, frames: 6}\n")
    campaign = mb.load_campaign(str(tmp_path / "one.yaml"))
    outcome = mb.run_campaign(campaign, str(tmp_path / "out"), jobs=1)
    assert (outcome.finished, outcome.failed) == (1, 0)
    stored = mb.results(str(tmp_path / "out")).tables["frames"]

    frames = mb.simulate("detection", seed=1, robots=1, frames=6)
    assert iter(frames) is frames
    counts = [frame.counts for frame in frames]
    assert [count.tp for count in counts] == stored["tp"].tolist()
    assert [count.fn for count in counts] == stored["fn"].tolist()
    assert list(frames) == []


def test_a_simulation_that_is_left_early_is_closed() -> None:
    with mb.simulate("labyrinth", robots=1, explain=True) as frames:
        first = next(frames)
        assert first.explanation is not None
        trial = frames.trial
    assert list(frames) == []
    with pytest.raises(Exception):  # noqa: B017, PT011 - the physics server is gone, whatever it says
        trial.next_frame()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"experiment": "detektion"}, "did you mean 'detection'"),
        ({"experiment": "mapping"}, "has no frames"),
        ({"robts": 1}, "did you mean 'robots'"),
        ({"frames": -1}, "frames"),
    ],
)
def test_what_cannot_be_simulated_says_why(arguments: dict, words: str) -> None:
    with pytest.raises(mb.InputError, match=words):
        mb.simulate(**arguments)


def test_campaigns_load_by_name_and_are_checked(tmp_path: Path) -> None:
    assert mb.load_campaign("labyrinth").trials == 20
    (tmp_path / "wrong.yaml").write_text("experiment: detection\nparameters: {frames: -1}\n")
    with pytest.raises(mb.InputError, match=r"wrong\.yaml.*frames"):
        mb.load_campaign(tmp_path / "wrong.yaml")
