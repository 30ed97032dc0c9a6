"""What can be set of the simulated world and its sensors; nothing here needs the simulator."""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from midnet_bench.plugins import load_reference
from midnet_bench.robots.lidars import LIDARS
from midnet_bench.robots.model import ROBOTS, RobotModel
from midnet_bench.settings import Scalar, Settings, group, option
from midnet_bench.simulation.engine import SIMULATORS

_ENGINES = {
    "bullet": "PyBullet, with wheels on a floor",
    "fast": "compiled loops of our own, planar and several times as fast",
    "mujoco": "MuJoCo, planar, with the extra midnet-bench[mujoco]",
}
LidarNoise = Literal["gazebo", "datasheet", "none"]


@dataclass(frozen=True)
class WorldSettings(Settings):
    """How the physics is stepped."""

    engine: str = option(
        "bullet",
        f"What moves the robots and casts their beams: {SIMULATORS.choices(**_ENGINES)}.",
        source="ours: PyBullet, for the paper's Gazebo (III)",
    )
    step_hz: int = option(
        30,
        "Physics steps per second.",
        ge=30,
        le=1000,
        multiple_of=10,
        source="ours: Gazebo steps at 1000 Hz and its wheels' plugin at 30 Hz",
    )


@dataclass(frozen=True)
class LidarSettings(Settings):
    """What the LiDARs' beams meet, and how wrong their ranges are."""

    robot_profile: Literal["urdf", "disc"] = option(
        "urdf",
        "What LiDAR beams meet of another robot: what is in their plane, of a Burger its LiDAR "
        "housing, 11 cm wide (urdf), or a disc of the whole robot's radius, of a Burger 0.105 m "
        "(disc).",
        source="package: turtlebot3_burger.urdf.xacro, collision",
    )
    noise: LidarNoise = option(
        "gazebo",
        "Range noise of the LDS-01: 10 mm at every range (gazebo), the maker's precision and "
        "accuracy, which grow with the range (datasheet), or none.",
        key="lidar_noise",
        source="package: turtlebot3_burger.gazebo.xacro, lds_lfcd_sensor, noise",
    )
    dropout: float = option(
        0.0,
        "Share of a LiDAR's beams that return nothing whatever they meet, drawn anew for each beam and scan.",
        ge=0,
        le=1,
        key="lidar_dropout",
        source="ours: off, the paper disturbs nothing",
    )
    hz: int | float = option(
        5,
        "Scans per second of every robot's LiDAR, at most one each physics step; another LiDAR than the "
        "LDS-01 has its own rate unless this is set.",
        ge=0.5,
        le=1000,
        key="lidar_hz",
        source="paper: V.A, 5 Hz",
    )


@dataclass(frozen=True)
class OdometrySettings(Settings):
    """Where odometry comes from and, for ``encoder``, how wrong it is.

    The last three are our choice: wheels true to a fifth of a millimetre, a track true to 1.6 mm, and slip
    that leaves 2 mm after a metre.
    """

    source: Literal["world", "encoder"] = option(
        "world",
        "Odometry that is exact, as Gazebo publishes it for a Burger (world), or computed from wheel "
        "encoders with wheels that slip (encoder).",
        key="odometry",
        source="package: turtlebot3_burger.gazebo.xacro, odometrySource",
    )
    radius_error: float = option(
        0.005,
        "Standard deviation of each wheel's radius, as a share of it, drawn once per robot; under "
        "odometry: encoder.",
        ge=0,
        le=0.2,
        key="wheel_radius_error",
        source="ours: off unless odometry=encoder; no figure of a Burger is published",
    )
    separation_error: float = option(
        0.01,
        "Standard deviation of the wheels' separation, as a share of it, drawn once per robot; under "
        "odometry: encoder.",
        ge=0,
        le=0.2,
        key="wheel_separation_error",
        source="ours: off unless odometry=encoder; no figure of a Burger is published",
    )
    slip_m_per_sqrt_m: float = option(
        0.002,
        "Standard deviation of a wheel's slip after one metre, metres; its variance grows with the "
        "distance; under odometry: encoder.",
        ge=0,
        le=0.2,
        key="wheel_slip",
        source="ours: off unless odometry=encoder; no figure of a Burger is published",
    )


@dataclass(frozen=True)
class ImuSettings(Settings):
    """The Burger's IMU; defaults: what its description states."""

    noise: Literal["gazebo", "none"] = option(
        "gazebo",
        "Errors of the IMU: those that the Burger's description states (gazebo), or none, as Gazebo's"
        " ROS 1 plugin published it.",
        key="imu_noise",
        source="ours: the description states errors that Gazebo's ROS 1 plugin leaves out",
    )


@dataclass(frozen=True)
class NetworkSettings(Settings):
    """What happens to the messages from the guards to MIDNet; by default they arrive, all and at once."""

    delay_s: float = option(
        0.0,
        "Delay of each message from a guard to MIDNet, seconds.",
        ge=0,
        le=60,
        key="message_delay_s",
        source="ours: off, the paper disturbs nothing",
    )
    jitter_s: float = option(
        0.0,
        "Mean of what is added to each message's delay, exponentially distributed, seconds.",
        ge=0,
        le=60,
        key="message_jitter_s",
        source="ours: off, the paper disturbs nothing",
    )
    loss: float = option(
        0.0,
        "Share of the messages from guards to MIDNet that are lost, each independently of the others.",
        ge=0,
        le=1,
        key="message_loss",
        source="ours: off, the paper disturbs nothing",
    )
    timeout_s: float | None = option(
        None,
        "Age from which MIDNet leaves a guard's last costmap out, seconds; null: it goes by it for ever.",
        gt=0,
        le=3600,
        key="message_timeout_s",
        source="ours: off, the paper disturbs nothing",
    )

    @property
    def is_used(self) -> bool:
        """Whether any of it is other than at once, whole and for ever."""
        return self != NetworkSettings()


@dataclass(frozen=True)
class SimulationSettings(Settings):
    """A world and the sensors of the robots in it."""

    robot: str = option(
        "burger",
        "What guards, explorers and mobile intruders are: "
        f"{ROBOTS.choices('your own RobotModel', burger='TurtleBot3', waffle='TurtleBot3')}, "
        f"with another LiDAR as burger(lidar=NAME); the names are {', '.join(LIDARS)}.",
        source="paper: III, Turtlebot3 Burgers",
    )
    world: WorldSettings = group(WorldSettings(), "world")
    lidar: LidarSettings = group(LidarSettings(), "LiDAR")
    odometry: OdometrySettings = group(OdometrySettings(), "odometry")
    imu: ImuSettings = group(ImuSettings(), "IMU")

    def with_files_read(self) -> "SimulationSettings":
        """The same, robot and engine from outside with their digests or versions. Raises InputError."""
        world = self.world.but(engine=SIMULATORS.pinned(self.world.engine))
        return self.but(robot=ROBOTS.pinned(self.robot), world=world)

    def with_robot_of(self, values: Mapping[str, Scalar]) -> "SimulationSettings":
        """The same with the robot of some flat keys and its LiDAR's rate, or as it is if they name none."""
        changed = self.but(robot=str(values.get("robot", self.robot)))
        if changed is self or (hz := changed.robot_model.lidar_hz) == self.lidar.hz:
            return changed
        return replace(changed, lidar=self.lidar.but(hz=hz))

    @property
    def remarks(self) -> list[str]:
        """Where sensors differ from their settings, a line each."""
        asked, most = self.lidar.hz, self.world.step_hz
        if asked <= most:
            return []
        return [
            f"a LiDAR of {asked:g} Hz scans once a physics step, {most} times a second; "
            f"step_hz={min(1000, math.ceil(asked / 10) * 10)} lets it keep its rate"
        ]

    @property
    def robot_model(self) -> RobotModel:
        """What all robots are."""
        return own_robot(self.robot) if self.robot in ROBOTS.own else ROBOTS.make(ROBOTS.pinned(self.robot))


@functools.cache
def own_robot(name: str) -> RobotModel:
    """One of this package's, by its name."""
    return load_reference(ROBOTS.own[name] or "")
