"""What the detection and the labyrinth test let a user set, and which of it a trial's numbers depend on."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, Self, TypeVar

import numpy as np

from midnet_bench.agents.agent_settings import PATROLS, GoalSettings, PatrolSettings
from midnet_bench.arena.arena import Arena
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.inputs import (
    EXACT,
    EXPLORED,
    arena_from,
    check_patrol,
    inline_arena,
    inline_prior_map,
    prior_map_from,
)
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.localization.localization_settings import UkfSettings
from midnet_bench.midnet.midnet_settings import MIDNetSettings, PriorMapSettings
from midnet_bench.navigation.navigation_settings import (
    LDS_WINDOW_M,
    MAX_RANGE_M,
    MIDNET_SOURCES,
    CostmapSettings,
    NavigatorSettings,
)
from midnet_bench.plugins import DETECTORS, FUSIONS
from midnet_bench.robots.turtlebot3 import is_burger_but_for_lidar
from midnet_bench.scoring.metric import METRICS, NONE, pinned_metrics
from midnet_bench.settings import Scalar, group, option
from midnet_bench.simulation.world_settings import NetworkSettings, SimulationSettings

Oracle = Literal[
    "none",
    "pose",
    "map",
    "delay",
    "window",
    "marks",
    "allies",
    "occlusion",
    "sight",
    "noise",
    "crop",
    "fusion",
]
OVERRIDING: tuple[Oracle, ...] = ("pose", "delay", "allies", "occlusion", "sight", "noise")
"""oracles under which the referee, not the guards, takes scans into the detection costmaps"""
Preset = Literal["paper", "best"]
FRAME_HZ = 5  # One MIDNet frame per LiDAR period (items 9, 42).
NO_SQUARE_M = 1e-6  # side of an ally's square that no box can be equal to: a box has at least a cell

START_S = 1.0  # to import the simulator and to place everything
SECONDS_PER_SIMULATED_SECOND = {"fast": (0.013, 0.003), "bullet": (0.030, 0.006), "mujoco": (0.024, 0.005)}
"""engine -> (of the world, of each robot of the team): CPU seconds of one core for a simulated second.

Measured with compiled loops on a virtual AMD EPYC: detection with 300 frames and labyrinth with 40 s, one and
five robots, with the causes of errors counted; ``mujoco`` without them.
"""
AnySettings = TypeVar("AnySettings", bound=Any)
DETECTION_ONLY = ("detector", "fusion", "deflate_boxes", "preset", "prior", "costmap", "midnet")
"""parameters that no robot drives by, unless what is detected moves it"""
ALLIES_ONLY = ("ally_diameter_m", "iou_ally", "ally_remove", "iou_fuse")
"""MIDNet's settings without a use in a team of one"""
GRIDS_ONLY = ("align", "min_area_cells", "min_returns")
"""MIDNet's settings without a use in another detector, which has costmaps and no binary grids"""


@dataclass(frozen=True)
class GuardParameters(Parameters):
    """What the experiments with guards share. Item numbers are those of ``midnet_bench/docs/readings.md``."""

    preset: Preset = option(
        "paper",
        "Which values are the defaults: the paper's by its own sources (paper), or those with the "
        "highest scores (best): local_size_m=6, local_map=decay, decay_s=0.5, "
        "fusion=components(iou=0.02), align=origin. What is set beside it comes first.",
        source="ours: off, paper changes nothing",
    )
    arena: str = option(
        "map1", "Name of a packaged arena, or an arena's YAML file.", source="paper: III, Map 1"
    )
    prior_map: str | None = option(
        None,
        "The map that is subtracted and driven by: explored by robots as the package has it, the best"
        " of 30 maps (explored) or the worst (explored-worst), drawn from the arena's walls (exact), "
        "or a map_server YAML file; null: explored where the package has such a map (map1, map2, "
        "empty), else exact.",
        source="paper: II.A, explored, and the best map saved",
    )
    robots: int = option(
        1, "Number of security robots.", ge=1, le=20, source="paper: V, teams from one robot"
    )
    localization: Literal["ukf", "ukf+map", "truth"] = option(
        "ukf",
        "Which pose is used to crop the map and to drive: the pose filter's (ukf), the filter's "
        "corrected by matching scans to the prior map (ukf+map), or the true one (truth).",
        source="paper: II.B, robot_localization",
    )
    detector: str = option(
        "midnet",
        f"Detector: {DETECTORS.choices()}; its options follow in brackets, such as clusters(noise_m=0.02).",
        source="paper: IV",
    )
    fusion: str = option(
        "paper",
        f"Fusion of the guards' boxes into one list: {FUSIONS.choices(paper='Algorithms 3 and 4')}.",
        source="paper: IV.C.2, Algorithms 3 and 4",
    )
    metrics: str = option(
        NONE,
        f"Further metrics, taken frame by frame: none, {METRICS.choices()}; several with semicolons between "
        "them.",
        source="ours: off, the paper has none beside Eqs. 8 to 12",
    )
    record: bool = option(
        False,
        "Keep every frame's boxes, poses and scans, and the cause of each error; with an oracle the "
        "errors alone. 'errors' and the player of 'report' read them.",
        source="ours: off, an output",
    )
    resolution_m: float = option(
        0.05,
        "Side of a cell of the prior map and of the local costmaps.",
        ge=0.02,
        le=0.2,
        source="turtlebot3: local_costmap_params.yaml, resolution",
    )
    deflate_boxes: bool = option(
        False,
        "Shrink each box by what the local costmap's inflation added to it.",
        source="paper: IV.B.4, boxes as boundingRect makes them",
    )
    stationary_scale: float = option(
        1.0,
        "Size of the stationary intruders that are drawn, as a multiple of the arena's.",
        gt=0,
        le=3,
        source="ours: the paper gives no size; the arena's are 0.4 to 1.0 m",
    )
    intruder_speed_mps: float = option(
        0.18,
        "Top speed of the mobile intruders, at most that of the robot.",
        gt=0,
        le=1,
        source="turtlebot3: dwa_local_planner_params.yaml, max_vel_x",
    )
    mobile_scale: float = option(
        1.0,
        "Factor on the diameter of what LiDAR beams meet of a mobile intruder; its body stays as it is.",
        ge=0.1,
        le=3,
        source="paper: III, all mobile robots are Burgers",
    )
    start_error_m: float = option(
        0.0,
        "Distance from a guard's start to where it takes itself to be then, in a random direction.",
        ge=0,
        le=2,
        source="ours: off, the paper disturbs nothing",
    )
    start_error_deg: float = option(
        0.0,
        "Error of the heading that a guard takes itself to have at the start, to either side.",
        ge=0,
        le=180,
        source="ours: off, the paper disturbs nothing",
    )
    dying_guards: int = option(
        0,
        "Number of guards, from the first on, that die: they stop and fall silent, their bodies stay.",
        ge=0,
        le=20,
        source="ours: off, the paper disturbs nothing",
    )
    dying_after_s: float = option(
        60.0, "Simulated time at which guards die.", ge=0, le=36_000, source="ours: off unless guards die"
    )
    oracle: Oracle = option(
        "none",
        "Which cause of error is taken from the detector alone, with the guards' motion as it is: "
        "true poses (pose), the prior map drawn from the walls (map), one more scan at the frame's "
        "instant (delay), a costmap that holds obstacle_range_m all round (window), "
        "local_map=single_scan (marks), beams on guards void and no box removed (allies), intruders "
        "seen through (occlusion), that and window (sight), exact ranges (noise), align=origin "
        "(crop), boxes fused by whose intruder they touch (fusion).",
        source="ours: off, the paper has none",
    )

    prior: PriorMapSettings = group(PriorMapSettings(), "prior map")
    costmap: CostmapSettings = group(
        CostmapSettings(size_m=LDS_WINDOW_M, raytrace_range_m=3.5, inf_is_valid=True),
        "MIDNet's local costmaps",
        sources=MIDNET_SOURCES,
    )
    midnet: MIDNetSettings = group(MIDNetSettings(), "MIDNet")
    simulation: SimulationSettings = group(SimulationSettings(), "simulation")
    network: NetworkSettings = group(NetworkSettings(), "network")
    ukf: UkfSettings = group(UkfSettings(), "pose filter", prefix="ukf_")
    navigator: NavigatorSettings = group(NavigatorSettings(), "navigator")
    patrol: PatrolSettings = group(PatrolSettings(), "patrol")
    goals: GoalSettings = group(GoalSettings(), "goals")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dying_guards > self.robots:
            raise InputError(
                f"dying_guards: {self.dying_guards} of {self.robots} guards cannot die; set robots"
            )
        if self.localization == "truth" and (self.start_error_m or self.start_error_deg):
            raise InputError(
                "start_error_m, start_error_deg: no start is wrong under localization: truth; take ukf"
            )
        if self.record and self.network.is_used:
            raise InputError("record: errors are not explained where a network lies between; leave it out")
        fastest_mps = self.simulation.robot_model.max_linear_mps
        if self.intruder_speed_mps > fastest_mps:
            raise InputError(
                f"intruder_speed_mps: {self.intruder_speed_mps} is out of range; "
                f"a {self.simulation.robot_model.name} reaches {fastest_mps:g}"
            )
        if self.oracle in OVERRIDING and self.network.is_used:
            raise InputError(
                f"oracle: {self.oracle} leaves no costmap for a network to carry; take map, window or marks, "
                "or leave out the options of the network (message_delay_s and its like)"
            )
        if self.oracle == "fusion" and self.detector != "midnet":
            raise InputError("oracle: fusion goes with detector=midnet only: it fuses the guards' own boxes")

    @classmethod
    def defaults_with(cls, values: Mapping[str, Scalar]) -> Self:
        """All defaults; for another robot than a Burger those that its measures decide."""
        settings = cls.usual()
        if values.get("preset") == "best":
            settings = replace(
                settings,
                preset="best",
                fusion="components(iou=0.02)",
                costmap=replace(settings.costmap, size_m=6.0, memory="decay", decay_s=0.5),
                midnet=replace(settings.midnet, align="origin"),
            )
        simulation = settings.simulation.with_robot_of(values)
        if simulation == settings.simulation:
            return settings
        robot, patrol = simulation.robot_model, settings.patrol
        costmap = settings.costmap.of_lidar(robot.lidar)
        if is_burger_but_for_lidar(robot):
            return replace(settings, simulation=simulation, costmap=costmap)
        return replace(
            settings,
            simulation=simulation,
            intruder_speed_mps=robot.max_linear_mps,
            costmap=costmap.of_robot(robot),
            midnet=replace(settings.midnet, ally_diameter_m=robot.diameter_m),
            navigator=settings.navigator.of_robot(robot),
            patrol=replace(patrol, clearance_m=max(patrol.clearance_m, robot.footprint_reach_m)),
        )

    @property
    def effort(self) -> float:
        """See :class:`Parameters`."""
        return float(self.robots)

    @property
    def simulated_s(self) -> float:
        """About how long a trial lasts, simulated seconds. Experiments override the paper's."""
        return 400.0

    @property
    def expected_wall_s(self) -> float:
        """See :class:`Parameters`; an engine of your own counts as ``bullet``."""
        usual = SECONDS_PER_SIMULATED_SECOND["bullet"]
        world, robot = SECONDS_PER_SIMULATED_SECOND.get(self.simulation.world.engine, usual)
        return START_S + self.simulated_s * (world + robot * self.robots)

    @cached_property
    def usable_range_m(self) -> float:
        """How far from a guard's LiDAR a return is marked, which is no farther than it reaches, metres."""
        return min(self.costmap.obstacle_range_m, self.simulation.robot_model.lidar.range_max_m)

    @property
    def remarks(self) -> list[str]:
        """See :class:`Parameters`: of a LiDAR that is used to other than its range."""
        costmap, lidar = self.costmap, self.simulation.robot_model.lidar
        asked_m, usable_m = costmap.obstacle_range_m, self.usable_range_m
        usual, lines = self.usual().costmap.of_lidar(lidar), self.simulation.remarks
        if asked_m > lidar.range_max_m:
            lines.append(f"obstacle_range_m={asked_m:g}: the LiDAR ends at {usable_m:g} m, and its use too")
        elif asked_m < min(lidar.range_max_m, MAX_RANGE_M) and asked_m != usual.obstacle_range_m:
            lines.append(f"a LiDAR of {lidar.range_max_m:g} m is used to {usable_m:g} m (obstacle_range_m)")
        if costmap.size_m / 2.0 < usable_m <= usual.size_m / 2.0:
            lines.append(
                f"local_size_m={costmap.size_m:g}: the local costmap ends {costmap.size_m / 2.0:g} m from "
                f"its robot, and intruders are in range up to {usable_m:g} m"
            )
        return lines

    @property
    def guarded_place(self) -> Arena:
        """The arena, with its stationary intruders at their size."""
        return guarded_place(self.arena, self.stationary_scale)

    @cached_property
    def local_costmap(self) -> CostmapSettings:
        """The costmap in which each guard looks for intruders."""
        costmap = self.costmap.but(
            resolution=self.resolution_m, track_unknown=self.midnet.unknown == "occupied"
        )
        if self.oracle == "marks":
            return replace(costmap, memory="single_scan")
        if self.oracle in ("window", "sight"):
            # the range begins at the sensor, within the footprint, and ends with what is inflated there
            beyond_m = self.simulation.robot_model.footprint_reach_m + costmap.inflation_radius_m
            return replace(costmap, size_m=max(costmap.size_m, 2.0 * (costmap.obstacle_range_m + beyond_m)))
        return costmap

    @cached_property
    def prior_costmap(self) -> CostmapSettings:
        """The costmap from which the prior map is cut: one set of parameters for both (item 3).

        Where unknown cells count as free (item 4) they are free before inflation, as in TurtleBot3's global
        costmap, whose obstacle layer does not track them: an explored wall is one cell thick, and inflation
        that spared the unknown cells behind it would let every noisy return there through.
        """
        return self.local_costmap.but(track_unknown=self.prior.unknown == "occupied")

    @property
    def midnet_settings(self) -> MIDNetSettings:
        """What MIDNet works by, the shrinking of boxes included (item 25)."""
        midnet = self.midnet
        if self.oracle == "allies":
            midnet = replace(midnet, ally_diameter_m=NO_SQUARE_M, iou_ally=1.0)
        if self.oracle == "crop":
            midnet = replace(midnet, align="origin")
        if not self.deflate_boxes:
            return midnet
        return replace(midnet, deflate_boxes_m=self.local_costmap.reach_m(midnet.thresh_local))

    @cached_property
    def guard_navigator(self) -> NavigatorSettings:
        """What a guard drives by, on maps of this resolution."""
        costmap = self.navigator.global_costmap.but(resolution=self.resolution_m)
        return self.navigator.but(global_costmap=costmap)

    @cached_property
    def intruder_navigator(self) -> NavigatorSettings:
        """The same at the intruders' speed."""
        settings, top_mps = self.guard_navigator, self.intruder_speed_mps
        limits = settings.dwa.limits, settings.rollout_limits
        return settings if {one.max_vel_x_mps for one in limits} == {top_mps} else settings.at_speed(top_mps)

    @property
    def robot_simulation(self) -> SimulationSettings:
        """The simulated world; a robot that knows its true pose takes it from exact odometry."""
        if self.localization != "truth":
            return self.simulation
        return replace(self.simulation, odometry=replace(self.simulation.odometry, source="world"))

    @property
    def pose_filter(self) -> UkfSettings | None:
        """What the pose filter trusts; None where robots know their true poses."""
        return None if self.localization == "truth" else self.ukf.suited_to(self.simulation.odometry.source)

    def with_files_read(self) -> Self:
        """See :class:`Parameters`: arena and prior map by their contents, checked to go together."""
        arena = inline_arena(self.arena)
        prior_map = inline_prior_map(self.prior_map, arena)
        try:
            grid = prior_map_from(prior_map, arena, self.resolution_m)
            if prior_map.startswith("{"):  # a user's
                reach_m = self.simulation.robot_model.footprint_reach_m
                check_patrol(grid, arena, self.robots, self.patrol.clearance_m, reach_m)
        except InputError as error:
            # what was read holds the map itself; only what was given names its file
            if self.prior_map == prior_map:
                raise
            raise InputError(
                f"prior_map: {self.prior_map or EXPLORED}: {str(error).removeprefix('prior_map: ')}"
            ) from error
        read = self.but(
            arena=arena,
            prior_map=prior_map,
            detector=DETECTORS.pinned(self.detector),
            fusion=FUSIONS.pinned(self.fusion),
            metrics=self.metrics if self.metrics == NONE else pinned_metrics(self.metrics),
            patrol=self.patrol.but(rule=PATROLS.pinned(self.patrol.rule)),
            simulation=self.simulation.with_files_read(),
        )
        # what several parts share may not suit each of them: tell that here, not in a trial
        _ = read.prior_costmap, read.guard_navigator, read.intruder_navigator
        return read


def guarded_place(arena: str, stationary_scale: float) -> Arena:
    """See :attr:`GuardParameters.guarded_place`."""
    place = arena_from(arena)
    least_m, greatest_m = place.stationary_intruders.size_m
    size_m = (least_m * stationary_scale, greatest_m * stationary_scale)
    drawn = place.stationary_intruders.model_copy(update={"size_m": size_m})
    return place.model_copy(update={"stationary_intruders": drawn})


Guarded = TypeVar("Guarded", bound=GuardParameters)


def with_defaults(settings: AnySettings, names: Iterable[str]) -> AnySettings:
    """The settings with those of these names at their defaults."""
    return settings.but(**{name: getattr(type(settings), name) for name in names})


def result_key(parameters: Guarded, keep_thresh_local: bool = False, **changes: Any) -> Guarded:
    """The parameters with those at their defaults that change nothing: trials of equal ones are the same.

    A threshold stands for the least cost that a costmap can have from there on. In cells of 5 cm there is
    none between 91 and 99, and thresholds from 92 to 99 select the same cells. ``keep_thresh_local``: whether
    it has another use than to select cells.
    """
    parameters = _without_idle_oracle(parameters)
    prior, midnet, costmap = parameters.prior, parameters.midnet, parameters.costmap
    deflate_boxes, unused = parameters.deflate_boxes, set[str]()
    if parameters.detector != "midnet":
        prior, deflate_boxes = PriorMapSettings(), False
        unused.update(GRIDS_ONLY, () if keep_thresh_local else ("thresh_local",))
    else:
        prior = prior.but(thresh=_least_cost(parameters.prior_costmap, prior.thresh))
        if not (keep_thresh_local or deflate_boxes):
            least = _least_cost(parameters.local_costmap, midnet.thresh_local)
            midnet = midnet.but(thresh_local=least)
    unused.update(("iou_fuse",) * (parameters.fusion != "paper"), ALLIES_ONLY * (parameters.robots == 1))
    return parameters.but(
        preset=GuardParameters.preset,
        prior=prior,
        midnet=with_defaults(midnet, unused),
        costmap=costmap if costmap.memory == "decay" else with_defaults(costmap, ("decay_s",)),
        deflate_boxes=deflate_boxes,
        **changes,
    )


def _without_idle_oracle(parameters: Guarded) -> Guarded:
    """The same without an oracle where it changes nothing, or where other options have the same effect."""
    oracle, changes = parameters.oracle, dict[str, Any]()
    if oracle in ("window", "marks"):
        local = parameters.local_costmap
        changes = {"costmap": parameters.costmap.but(size_m=local.size_m, memory=local.memory)}
    elif oracle == "crop":
        changes = {"midnet": parameters.midnet.but(align="origin")}
    elif (oracle, parameters.robots) != ("allies", 1) and (oracle, parameters.prior_map) != ("map", EXACT):
        return parameters
    return parameters.but(oracle="none", **changes)


@lru_cache
def _least_cost(settings: CostmapSettings, thresh: int) -> int:
    """The least published cost that cells near an obstacle of such a costmap can have from ``thresh`` on."""
    from midnet_bench.navigation import costmap  # which takes a compiler

    costs = costmap.inflation_costs(settings, settings.inflation_radius_m)
    published = np.unique(costmap.published(costs[None, :]))
    return int(published[published >= thresh].min())
