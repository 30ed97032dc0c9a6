"""The named options of map construction (section II.A), flat like those of the other experiments."""

from typing import Literal

from pydantic import Field, field_validator

from midnet_bench.experiments.guarded.inputs import inline_arena
from midnet_bench.io.checked_yaml import Spec


class MappingParameters(Spec):
    """How a team of Burgers explores an arena and merges what its robots see."""

    arena: str = Field("map1", description="name of a packaged arena, or a YAML file")
    robots: int = Field(1, ge=1, le=20, description="explorers")
    odometry: Literal["world", "encoder"] = Field("encoder", description="exact, or wheels that slip")
    lidar_noise: Literal["gazebo", "datasheet", "none"] = Field("gazebo", description="LDS-01 range noise")
    robot_profile: Literal["urdf", "disc"] = Field("urdf", description="what beams see of a Burger; item 28")
    resolution_m: float = Field(0.05, ge=0.02, le=0.2, description="of the maps and global costmaps")
    particles: int = Field(30, ge=1, le=1000, description="of each robot's GMapping")
    merge: Literal["start_poses", "features"] = Field(
        "start_poses", description="by known start poses as they go, or by features at the end"
    )
    goal_timeout_s: float = Field(30.0, gt=0, le=600, description="no progress: another frontier; item 62")
    time_limit_s: float = Field(3600.0, gt=0, le=36_000, description="simulated; ends an exploration")

    @field_validator("arena")
    @classmethod
    def _take_in_the_arena(cls, value: str) -> str:
        return inline_arena(value)
