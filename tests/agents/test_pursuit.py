import numpy as np

from midnet_bench.agents.agent_settings import PursuitSettings
from midnet_bench.agents.mobile_robot import Guard
from midnet_bench.agents.pursuit import Pursuit, TeamPursuit
from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.navigator import Navigator

FLOOR = OccupancyGrid(np.zeros((200, 200), np.int8), 0.05, (-5.0, -5.0))


def guards(*places: tuple[float, float]) -> list[Guard]:
    return [
        Guard(i, f"guard {i}", Pose2D(x, y, 0.0), Navigator(FLOOR), None, lambda robot: None, 30.0)
        for i, (x, y) in enumerate(places)
    ]


def pursuing(team: list[Guard], rule: str = "nearest") -> Pursuit:
    return Pursuit(team, PursuitSettings(rule=rule), TeamPursuit(rule, FLOOR, np.random.default_rng(1)))


def test_the_nearest_guard_goes_and_the_others_patrol() -> None:
    team = guards((-3.0, 0.0), (1.0, 0.0), (3.0, 3.0))
    pursuit = pursuing(team)
    pursuit.detected(7, (2.0, 0.0), 0.2)
    pursuit.update(0.2)
    assert [guard.goal for guard in team] == [None, (2.0, 0.0), None]


def test_two_targets_get_a_guard_each() -> None:
    team = guards((-3.0, 0.0), (0.0, 0.0))
    pursuit = pursuing(team)
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.detected(8, (2.0, 0.0), 0.2)
    pursuit.update(0.2)
    assert [guard.goal for guard in team] == [(2.0, 0.0), (1.0, 0.0)]


def test_a_pursuer_stays_on_his_target_and_follows_it() -> None:
    team = guards((0.0, 0.0), (3.0, 0.0))
    pursuit = pursuing(team)
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.update(0.2)
    pursuit.detected(7, (1.0 + 0.9 * PursuitSettings().retarget_m, 0.0), 0.4)
    pursuit.update(0.4)
    assert team[0].goal == (1.0, 0.0)
    pursuit.detected(7, (3.0, 0.1), 0.6)
    pursuit.update(0.6)
    assert [guard.goal for guard in team] == [(3.0, 0.1), None]


def test_a_target_out_of_sight_is_given_up() -> None:
    team = guards((0.0, 0.0))
    pursuit = pursuing(team)
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.update(0.2)
    pursuit.update(3.2)
    assert team[0].goal is not None
    pursuit.update(3.4)
    assert team[0].goal is None
    assert not pursuit.targets


def test_everybody_goes_after_the_nearest_one_under_all() -> None:
    team = guards((-3.0, 0.0), (3.0, 0.0))
    pursuit = pursuing(team, "all")
    pursuit.detected(7, (-2.0, 0.0), 0.2)
    pursuit.detected(8, (2.0, 0.0), 0.2)
    pursuit.update(0.2)
    assert [guard.goal for guard in team] == [(-2.0, 0.0), (2.0, 0.0)]


def test_nobody_goes_under_none() -> None:
    team = guards((0.0, 0.0))
    pursuit = pursuing(team, "none")
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.update(0.2)
    assert team[0].goal is None


def test_a_caught_target_frees_his_pursuer() -> None:
    team = guards((0.0, 0.0))
    pursuit = pursuing(team)
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.update(0.2)
    pursuit.drop(7)
    assert team[0].goal is None


def test_a_box_here_and_there_is_one_target_and_one_far_off_another() -> None:
    pursuit = pursuing(guards((0.0, 0.0)))
    assert pursuit.see([(1.0, 0.0)], 0.2) == [0]
    assert pursuit.see([(4.0, 0.0), (1.05, 0.0)], 0.4) == [1, 0]
    assert sorted(pursuit.targets) == [0, 1]


def test_a_pursuer_that_finds_the_place_empty_gives_its_target_up() -> None:
    team = guards((0.0, 0.0))
    pursuit = pursuing(team)
    pursuit.see([(0.4, 0.0)], 0.2)
    pursuit.update(0.2)
    pursuit.update(1.0)
    assert pursuit.targets
    pursuit.update(1.4)
    assert not pursuit.targets
    assert team[0].goal is None


def test_a_pursuer_that_is_still_on_its_way_keeps_its_target() -> None:
    team = guards((0.0, 0.0))
    pursuit = pursuing(team)
    pursuit.see([(3.0, 0.0)], 0.2)
    pursuit.update(0.2)
    pursuit.update(3.0)
    assert team[0].goal == (3.0, 0.0)


def test_a_guard_that_the_rule_calls_off_has_no_goal_and_its_target_goes_to_another() -> None:
    team = guards((0.0, 0.0), (-3.0, 0.0))
    pursuit = pursuing(team, "assignment")
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.update(0.2)
    assert [guard.goal for guard in team] == [(1.0, 0.0), None]
    pursuit.detected(7, (-2.0, 0.0), 0.4)
    pursuit.update(0.4)
    assert [guard.goal for guard in team] == [None, (-2.0, 0.0)]


def test_two_guards_exchange_their_targets_if_the_rule_says_so() -> None:
    team = guards((0.0, 0.0), (4.0, 0.0))
    pursuit = pursuing(team, "assignment")
    pursuit.detected(7, (1.0, 0.0), 0.2)
    pursuit.detected(8, (3.0, 0.0), 0.2)
    pursuit.update(0.2)
    assert [guard.goal for guard in team] == [(1.0, 0.0), (3.0, 0.0)]
    pursuit.detected(7, (3.0, 1.0), 0.4)
    pursuit.detected(8, (1.0, 1.0), 0.4)
    pursuit.update(0.4)
    assert [guard.goal for guard in team] == [(1.0, 1.0), (3.0, 1.0)]
    pursuit.drop(8)
    assert [guard.goal for guard in team] == [None, (3.0, 1.0)]
