"""The named options of every experiment: the paper's values, our readings of its gaps, and their ranges.

Flat on purpose: each field is a key of a campaign file, of its grid, and of ``--set key=value``. The
item numbers are those of the paper notes in ``docs/readings.md``.
"""

from typing import Any, Literal, Self

from pydantic import Field, ModelWrapValidatorHandler, ValidationInfo, field_validator, model_validator

from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.inputs import (
    arena_from,
    check_prior_map,
    inline_arena,
    inline_prior_map,
)
from midnet_bench.io.checked_yaml import Spec


class GuardParameters(Spec):
    """What the detection and the labyrinth test share: the arena, the robots, MIDNet and its inputs."""

    arena: str = Field("map1", description="name of a packaged arena, or a YAML file")
    prior_map: str = Field(
        "explored",
        validate_default=True,
        description="explored (by robots; comes with the package), exact (rendered), or a YAML file; item 12",
    )
    robots: int = Field(1, ge=1, le=20, description="security robots")

    localization: Literal["ukf", "ukf+map", "truth"] = Field("ukf", description="item 10")
    odometry: Literal["world", "encoder"] = Field("world", description="exact, or wheels that slip")
    lidar_noise: Literal["gazebo", "datasheet", "none"] = Field("gazebo", description="LDS-01 range noise")
    robot_profile: Literal["urdf", "disc"] = Field("urdf", description="what beams see of a Burger; item 28")

    thresh_local: int = Field(99, ge=1, le=100, description="Eq. 1 on the local costmap; item 1")
    thresh_global: int = Field(30, ge=1, le=100, description="Eq. 1 on the prior map's costmap; item 1")
    cost_scaling: float = Field(10.0, gt=0, le=100, description="costmap decay, 1/m; item 1")
    inscribed_radius_m: float = Field(0.105, gt=0, le=1, description="cost 99 reaches this far; item 1")
    inflation_radius_m: float = Field(0.55, ge=0, le=3, description="costmap inflation ends here; item 1")
    unknown_in_prior: Literal["free", "occupied"] = Field("free", description="item 4")
    resolution_m: float = Field(0.05, ge=0.02, le=0.2, description="of prior map and local costmaps; item 6")
    local_size_m: float = Field(4.0, ge=1, le=20, description="side of the local costmap; item 6")
    obstacle_range_m: float = Field(2.5, gt=0, le=10, description="marking range, usable range; item 7")
    raytrace_range_m: float = Field(3.0, gt=0, le=10, description="clearing range; item 7")
    local_map: Literal["persistent", "single_scan", "decay"] = Field("persistent", description="item 8")
    decay_s: float = Field(1.0, gt=0, le=60, description="how long a mark lives under local_map: decay")
    inf_is_valid: bool = Field(True, description="whether a beam without return clears, costmap_2d's name")
    footprint_clearing: bool = Field(True, description="item 11")
    align: Literal["floor", "origin"] = Field("floor", description="crop by the pose or by the grid; item 16")
    min_area_cells: int = Field(1, ge=1, le=1000, description="smaller blobs are dropped; item 23")
    deflate_boxes: bool = Field(False, description="shrink boxes by the local inflation; item 25")
    ally_diameter_m: float = Field(0.297, gt=0, le=2, description="di of Algorithm 2; item 27")
    iou_ally: float = Field(0.05, gt=0, le=1, description="t of Algorithm 2; item 29")
    iou_fuse: float = Field(0.1, gt=0, le=1, description="t of Algorithms 3 and 4; item 29")
    ally_remove: Literal["first", "best", "all"] = Field("first", description="item 30")

    controller: Literal["dwa", "trajectory_rollout"] = Field("dwa", description="local planner")
    z_factor: float = Field(0.5, gt=0, le=2, description="z = z_factor * p / q, Eq. 12")
    goal_timeout_s: float = Field(30.0, gt=0, le=600, description="no progress: new goal; item 62")
    intruder_speed_mps: float = Field(0.22, gt=0, le=0.22, description="mobile intruders; items 49, 57")

    @field_validator("arena")
    @classmethod
    def _take_in_the_arena(cls, value: str) -> str:
        return inline_arena(value)

    @field_validator("prior_map")
    @classmethod
    def _take_in_the_prior_map(cls, value: str, others: ValidationInfo) -> str:
        # without an arena there is a fault to report already
        return inline_prior_map(value, others.data["arena"]) if "arena" in others.data else value

    @model_validator(mode="wrap")
    @classmethod
    def _fits_together(cls, values: Any, make: ModelWrapValidatorHandler[Self]) -> Self:
        made = make(values)
        try:
            check_prior_map(made.prior_map, arena_from(made.arena), made.resolution_m, made.robots)
        except InputError as error:
            # what was made holds the map itself; only what was given names its file
            given = values.get("prior_map") if isinstance(values, dict) else None
            if given is None or given == made.prior_map:
                raise
            raise InputError(f"prior_map: {given}: {str(error).removeprefix('prior_map: ')}") from error
        return made


class DetectionParameters(GuardParameters):
    """Map 1, section V.A: who is seen, frame by frame."""

    frames: int = Field(1999, ge=1, le=1_000_000, description="MIDNet frames to score, at 5 Hz; item 42")
    in_range: Literal["edge", "centre"] = Field("edge", description="what counts as within reach; item 46")
    require_line_of_sight: bool = Field(False, description="hidden intruders are not missed ones; item 46")
    truth_box: Literal["extent", "inflated"] = Field("extent", description="item 45")


class ReadingsParameters(DetectionParameters):
    """The detection test under many readings at once; the parameters are what each one starts from."""

    readings: Literal["calibration", "items"] = Field("items", description="combinations, or one at a time")


class LabyrinthParameters(GuardParameters):
    """Map 2, section V.B: who is caught before he escapes."""

    arena: str = Field("map2", description="name of a packaged arena, or a YAML file")
    intruders: int = Field(1, ge=1, le=20, description="mobile intruders")
    capture: Literal["within", "detected", "contact"] = Field("within", description="item 53")
    capture_distance_m: float = Field(0.5, gt=0, le=5, description="centre to centre, capture: within")
    pursuit: Literal["nearest", "all", "none"] = Field("nearest", description="item 53")
    pursuit_timeout_s: float = Field(3.0, gt=0, le=600, description="since the last detection; item 54")
    evasion: Literal["none", "flee"] = Field("none", description="item 57")
    flee_radius_m: float = Field(1.5, gt=0, le=10, description="guards nearer than this, evasion: flee")
    escape_distance_m: float = Field(12.0, ge=0, le=100, description="start to escape; item 56")
    escape_radius_m: float = Field(0.3, gt=0, le=5, description="escaped when this near; item 56")
    time_limit_s: float = Field(600.0, gt=0, le=36_000, description="item 58")
