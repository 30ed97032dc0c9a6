"""What map construction (section II.A) lets a user set."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Self

from midnet_bench.agents.agent_settings import GoalSettings
from midnet_bench.experiments.guarded.inputs import inline_arena
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.localization.localization_settings import UkfSettings
from midnet_bench.mapping.mapping_settings import BURGER_UKF, GmappingSettings
from midnet_bench.navigation.navigation_settings import BURGER_COSTMAP, NavigatorSettings
from midnet_bench.robots.turtlebot3 import is_burger_but_for_lidar
from midnet_bench.settings import Scalar, group, option
from midnet_bench.simulation.world_settings import OdometrySettings, SimulationSettings

_UNPUBLISHED = "ours: no figure of a Burger is published"


@dataclass(frozen=True)
class MappingParameters(Parameters):
    """How a team of robots explores an arena and merges what its robots see."""

    arena: str = option(
        "map1", "Name of a packaged arena, or an arena's YAML file.", source="paper: III, Map 1"
    )
    robots: int = option(
        1, "Number of exploring robots.", ge=1, le=20, source="paper: II.A, single-robot exploration"
    )
    resolution_m: float = option(
        0.05,
        "Side of a cell of the maps and of the global costmaps.",
        ge=0.02,
        le=0.2,
        source="package: slam_gmapping, delta",
    )
    merge: Literal["start_poses", "features"] = option(
        "start_poses",
        "How the robots' maps are merged: by their known start poses while they explore "
        "(start_poses), or by matching features of the maps at the end (features).",
        source="package: multirobot_map_merge, known_init_poses",
    )
    time_limit_s: float = option(
        3600.0,
        "Simulated time after which an exploration ends.",
        gt=0,
        le=36_000,
        source="ours: II.A has no limit",
    )

    simulation: SimulationSettings = group(
        SimulationSettings(odometry=OdometrySettings(source="encoder")),
        "simulation",
        sources={
            "odometry.source": "ours: Gazebo's exact odometry leaves GMapping nothing to correct",
            "odometry.radius_error": _UNPUBLISHED,
            "odometry.separation_error": _UNPUBLISHED,
            "odometry.slip_m_per_sqrt_m": _UNPUBLISHED,
        },
    )
    ukf: UkfSettings = group(UkfSettings(), "pose filter", prefix="ukf_")
    gmapping: GmappingSettings = group(BURGER_UKF, "GMapping")
    navigator: NavigatorSettings = group(
        NavigatorSettings(global_costmap=replace(BURGER_COSTMAP, track_unknown=True)),
        "navigator",
        sources={"global_costmap.track_unknown": "package: explore_lite, which needs unknown cells"},
    )
    goals: GoalSettings = group(GoalSettings(), "goals")

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.slam, self.explorer_navigator  # raises here, not in a trial, if the resolution does not suit

    @classmethod
    def defaults_with(cls, values: Mapping[str, Scalar]) -> Self:
        """All defaults; for another robot than a Burger those that its measures decide."""
        settings = cls.usual()
        simulation = settings.simulation.with_robot_of(values)
        if simulation == settings.simulation:
            return settings
        robot, navigator = simulation.robot_model, settings.navigator
        if not is_burger_but_for_lidar(robot):
            navigator = navigator.of_robot(robot)
        return replace(settings, simulation=simulation, navigator=navigator)

    @property
    def remarks(self) -> list[str]:
        """See :class:`Parameters`."""
        return self.simulation.remarks

    @property
    def pose_filter(self) -> UkfSettings:
        """What the pose filter trusts."""
        return self.ukf.suited_to(self.simulation.odometry.source)

    @property
    def slam(self) -> GmappingSettings:
        """GMapping at these maps' resolution."""
        return replace(self.gmapping, resolution_m=self.resolution_m)

    @property
    def explorer_navigator(self) -> NavigatorSettings:
        """What an explorer drives by, on maps of this resolution."""
        settings = self.navigator
        return replace(
            settings, global_costmap=replace(settings.global_costmap, resolution=self.resolution_m)
        )

    @property
    def expected_wall_s(self) -> float:
        """See :class:`Parameters`: 40 s for each team that explores Map 1, which takes one robot 400 s."""
        return min(40.0, 0.1 * self.robots * self.time_limit_s)

    def with_files_read(self) -> Self:
        """See :class:`Parameters`: the arena by its contents."""
        return replace(self, arena=inline_arena(self.arena), simulation=self.simulation.with_files_read())
