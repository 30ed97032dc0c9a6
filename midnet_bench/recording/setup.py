"""``setup.yaml``: how topics, frames, clocks and labels of a recording are used; options of detectors."""

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BeforeValidator, Field, field_validator

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import Pose2D
from midnet_bench.io.checked_yaml import Spec, parse, read_yaml
from midnet_bench.midnet.midnet_settings import MIDNetSettings, PriorMapSettings
from midnet_bench.navigation.navigation_settings import MIDNET_SOURCES, CostmapSettings
from midnet_bench.plugins import DETECTORS, FUSIONS
from midnet_bench.recording.files.readings import CODES, Meaning
from midnet_bench.recording.poses import Clock
from midnet_bench.robots.model import ROBOTS, RobotModel
from midnet_bench.settings import Scalar, Settings, group, option

Preset = Literal["real", "paper"]

PRESETS: dict[Preset, dict[str, Scalar]] = {
    "paper": {},
    "real": {
        "local_map": "single_scan",
        "local_size_m": 0.0,
        "min_returns": 2,
        "thresh_global": 40,
        "return_area_m2": 0.004,
        "unknown_in_prior": "occupied",
        "align": "origin",
        "ally_remove": "all",
        "ally_diameter_m": 0.42,
        "iou_ally": 0.05,
    },
}
"""values that differ from the defaults, which are those of a trial; ``benchmarks/real_preset.py``
chose ``thresh_global`` and ``return_area_m2`` by the rule that it states"""
LARGEST = 1e7  # of metres, degrees and seconds
FOUND = "found"  # value of key ``start``: the map is searched
EVERY = ""  # key of a value that holds for every robot
Value = TypeVar("Value")
Text = Annotated[str, Field(min_length=1)]
Coordinate = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Mount = tuple[Coordinate, Coordinate, Coordinate]
Seconds = Annotated[float, Field(ge=-1e10, le=1e10)]


@dataclass(frozen=True)
class ReplaySettings(Settings):
    """All that lies between a map, poses and scans and the boxes; see ``DetectorSettings``."""

    detector: str = option(
        "midnet",
        "Detector of boxes: midnet, subtraction, clusters, background, or your own as in a trial.",
        source="paper: IV",
    )
    fusion: str = option(
        "paper",
        "Fusion of the robots' boxes into one list, as in a trial.",
        source="paper: IV.C.2, Algorithms 3 and 4",
    )
    robot: str = option(
        "burger",
        "Robot model, for its footprint and radius: burger, waffle, or your own as in a trial.",
        source="paper: III, Turtlebot3 Burgers",
    )
    deflate_boxes: bool = option(
        False,
        "Shrink each box by what the local costmap's inflation added to it.",
        source="paper: IV.B.4, boxes as boundingRect makes them",
    )
    return_area_m2: float = option(
        0.0,
        "Area off the mapped walls from which on a return counts as one for min_returns, its width times "
        "its depth beyond a margin that grows where returns do not fit the map; 0: each return counts.",
        ge=0,
        le=1,
        source="ours: a wall beside its place on the map covers little; see detectors/detector_node.py",
    )
    local_size_m: float = option(
        3.5,
        "Side of the local costmaps; 0: as much as the obstacle range needs.",
        ge=0,
        le=200,
        source=MIDNET_SOURCES["size_m"],
    )
    prior: PriorMapSettings = group(PriorMapSettings(), "prior map")
    costmap: CostmapSettings = group(
        CostmapSettings(size_m=3.5, raytrace_range_m=3.5, inf_is_valid=True),
        "MIDNet's local costmaps",
        only=(
            *("obstacle_range_m", "raytrace_range_m", "inflation_radius_m", "cost_scaling_factor"),
            *("inscribed_radius_m", "footprint_clearing", "inf_is_valid", "memory", "decay_s"),
        ),
        sources=MIDNET_SOURCES,
    )
    midnet: MIDNetSettings = group(MIDNetSettings(), "MIDNet")

    @classmethod
    def of(cls, preset: Preset, values: Mapping[str, Scalar], resolution_m: float) -> "ReplaySettings":
        """A preset with values set by the user, for a map of this resolution.

        Raises:
            InputError: an unknown key, or a value that is out of range.
        """
        settings = cls.from_flat({**PRESETS[preset], **values})
        model = settings.robot_model
        costmap = replace(settings.costmap, resolution=resolution_m)
        if settings.robot != "burger":
            costmap = costmap.of_robot(model)
        far_m = costmap.obstacle_range_m
        if "raytrace_range_m" not in values:  # a beam clears beyond the range up to which it marks
            costmap = replace(costmap, raytrace_range_m=max(costmap.raytrace_range_m, far_m + 0.5))
        # the range begins at the sensor, within the footprint, and ends with what is inflated there
        beyond_m = model.footprint_reach_m + costmap.inflation_radius_m
        size_m = settings.local_size_m or 2.0 * (far_m + beyond_m)
        return replace(
            settings,
            costmap=replace(costmap, size_m=max(size_m, 1.0)),
            detector=DETECTORS.pinned(settings.detector),
            fusion=FUSIONS.pinned(settings.fusion),
        )

    @property
    def robot_model(self) -> RobotModel:
        """The robot that the recording's are taken to be."""
        return ROBOTS.make(ROBOTS.pinned(self.robot))

    @property
    def local_costmap(self) -> CostmapSettings:
        """Each robot's local costmap."""
        return replace(self.costmap, track_unknown=self.midnet.unknown == "occupied")

    @property
    def prior_costmap(self) -> CostmapSettings:
        """The costmap from which the prior map is cut."""
        return replace(self.costmap, track_unknown=self.prior.unknown == "occupied")

    @property
    def midnet_settings(self) -> MIDNetSettings:
        """What MIDNet works by, the shrinking of boxes included."""
        shrunk_m = self.local_reach_m if self.deflate_boxes else 0.0
        return replace(self.midnet, deflate_boxes_m=shrunk_m, return_area_m2=self.return_area_m2)

    @property
    def local_reach_m(self) -> float:
        """How far about a return cells count as occupied."""
        return self.costmap.reach_m(self.midnet.thresh_local)

    @property
    def prior_reach_m(self) -> float:
        """How far about a mapped wall cells are taken off."""
        return self.costmap.reach_m(self.prior.thresh)

    @property
    def range_m(self) -> float:
        """Up to which an intruder is to be found."""
        return self.costmap.obstacle_range_m

    def in_words(self, increment_rad: float) -> list[str]:
        """What the thresholds mean in metres, a line each, for a LiDAR with beams so far apart."""
        cell_m, reach_m, grown_m = self.costmap.resolution, self.local_reach_m, self.prior_reach_m
        least = self.midnet.min_returns
        side_m = cell_m * (2 * math.floor(reach_m / cell_m + 1e-9) + 1)
        lines = [
            f"a return counts from {grown_m:.2f} m off a mapped wall; cells about it reach {reach_m:.2f} m, "
            f"so the tolerance to errors of pose, map and range is {grown_m - reach_m:.2f} m (cells of "
            f"{cell_m:g} m)",
            f"one return alone makes a box of {side_m:.2f} m; a box needs "
            + (f"{least} returns" if least else "no return of the last scan"),
            f"window {self.costmap.size_m:.3g} m, range {self.range_m:g} m, marks: {self.costmap.memory}",
        ]
        if self.return_area_m2:
            lines.append(
                f"a return counts as one from {self.return_area_m2:g} m2 off the walls on, less where the "
                "wall returns about it are off the map too"
            )
        half_m = self.costmap.size_m / 2.0
        if half_m < self.range_m:
            lines.append(
                f"sees {half_m:g} m ahead although the LiDAR range is {self.range_m:g} m: objects in "
                f"between are missed; try --set local_size_m={2.0 * (self.range_m + 0.5):g}"
            )
        apart_m = self.range_m * abs(increment_rad)
        if self.costmap.memory != "single_scan" and apart_m > cell_m:
            lines.append(
                f"beams are {apart_m:.3f} m apart at {self.range_m:g} m, more than a cell: rays miss marks, "
                "and ghosts remain; --set local_map=single_scan leaves none"
            )
        return lines


def _by_name(value: Any) -> Any:
    return value if isinstance(value, Mapping) or value is None else {EVERY: value}


def _topics(value: Any) -> Any:
    each = value if isinstance(value, list) else [value]
    if not each or not all(isinstance(topic, str) and topic for topic in each):
        raise ValueError("a topic is needed, or a list of topics")
    if len(set(each)) < len(each):
        raise ValueError("a topic is there twice")
    return value


ByName = Annotated[dict[str, Value], BeforeValidator(_by_name)]
"""One value for every robot, or a mapping from robot names to values; kept as a mapping."""
Topics = Annotated[str | list[str], BeforeValidator(_topics)]


def _key(default: Any, description: str, **limits: Any) -> Any:
    return Field(default=default, description=description, **limits)


class AllySetup(Spec):
    """One ally; without ``diameter_m`` it has the detector's ``ally_diameter_m``."""

    topic: Text
    diameter_m: float | None = Field(default=None, gt=0.0, le=20.0)


class RecordingSetup(Spec):
    """What a recording needs beside its files; each key of ``setup.yaml`` with its default."""

    map: Text | None = _key(None, "prior map: a map_server YAML, or a topic")
    background: Text | None = _key(
        None, "in place of map: another recording, or first-10 for the first 10 s of this one"
    )
    hit_threshold: float = _key(
        0.1, "share of beams that end in an occupied cell of the background", ge=0.0, le=1.0
    )
    resolution_m: float = _key(0.05, "side of a cell of the background", ge=0.01, le=0.2)
    scan: ByName[Topics] = _key(
        {},
        "topic of the scans, a list for several lasers, TOPIC@FRAME for one of those on a topic, "
        "or {NAME: ...} for each robot; default all LaserScans",
    )
    pose: ByName[Text] = _key(
        {}, "pose of the robot: a topic, tf, a CSV or TUM file, or at:X,Y,YAW_DEG for one at rest"
    )
    start: ByName[Mount | Literal["found"]] = _key(
        {}, "poses by odometry: where the robot began, [x, y, yaw_deg] on the map, or found"
    )
    mount: ByName[Mount] = _key(
        {}, "laser on the robot: [x, y, yaw_deg]; of several {TOPIC: ...}; default from tf, else 0"
    )
    mirrored: ByName[bool] = _key(
        {EVERY: False}, "true: reverse the order of the beams, as of a laser upside down"
    )
    map_frame: Text = _key("map", "frame of tf that the map is in")
    clock: Clock = _key("header", "header or record: which time stamps are used")
    delay_s: ByName[Seconds] = _key({}, "seconds by which the scans are stamped too late")
    offset_s: dict[str, Seconds] = _key({}, "{FILE: SECONDS} to add to all times of one of several files")
    no_return: dict[str, Meaning] = _key(
        {}, "{inf|nan|zero|below|above: clears|nothing|invalid}; default found from the scans"
    )
    deskew: bool = _key(False, "true: correct the robot's motion during a scan")
    rate_hz: float | None = _key(None, "frames a second; default one at each scan", ge=0.01, le=1000.0)
    from_s: float = _key(0.0, "scans from here on, seconds after the recording's beginning", ge=0.0, le=1e9)
    to_s: float | None = _key(None, "scans up to here; default to the recording's end", gt=0.0, le=1e9)
    max_pose_age_s: float = _key(0.5, "scans farther in time from a pose are left out", ge=0.0)
    allies: dict[str, AllySetup] = _key(
        {}, "{NAME: {topic: TOPIC, diameter_m: 0.3}}: moving objects that are no intruders"
    )
    max_ally_age_s: float = _key(0.5, "an older pose of an ally is not used", ge=0.0)
    truth: ByName[Text] = _key(
        {}, "labels: a CSV (t or scan_index, id, x, y), or {NAME: TOPIC} with poses of intruders"
    )
    match_distance_m: float = _key(0.35, "a box may be this far from its label", ge=0.0)
    sector_deg: tuple[float, float] | None = _key(
        None, "[from, to]: only what lies in this part of the robot's view is scored"
    )
    window_m: float | None = _key(
        None, "only what lies in a square of this side about the robot is scored", ge=0.1
    )
    preset: Literal["real", "paper", "both"] = _key("both", "detector options: real, paper or both")
    settings: dict[str, Scalar] = _key({}, "detector options by key, as --set gives them")
    localize: bool | None = _key(
        None, "true: correct the poses by matching scans to the map; default true with start"
    )
    unmapped: bool = _key(False, "true: write stationary objects missing on the map, and a map with them")

    @field_validator("no_return", mode="before")
    @classmethod
    def _invalid_is_nothing(cls, value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value
        for code in value:
            if code not in CODES:
                raise ValueError(f"no such code '{code}'{nearest_name(str(code), CODES)}")
        return {code: "nothing" if said == "invalid" else said for code, said in value.items()}

    @property
    def presets(self) -> tuple[Preset, ...]:
        """The first is drawn in films."""
        return ("real", "paper") if self.preset == "both" else (self.preset,)

    @classmethod
    def load(cls, path: Path) -> Self:
        """The setup of a YAML file; files it names are looked for in its folder first.

        Raises:
            InputError: the file cannot be read; or file, key and what is wrong.
        """
        return parse(cls, read_yaml(path), str(path)).with_paths(
            lambda text: str(path.parent / text) if (path.parent / text).is_file() else text
        )

    def changed(self, values: Mapping[str, Any], source: str = "replay") -> Self:
        """The same with other values, checked. Raises InputError: source, key and what is wrong."""
        return parse(type(self), {**self.model_dump(), **values}, source)

    def with_paths(self, path_of: Callable[[str], str]) -> Self:
        """The same with ``path_of`` applied to every value that may name a file."""
        named: dict[str, Any] = {
            key: {name: path_of(text) for name, text in getattr(self, key).items()}
            for key in ("pose", "truth")
        }
        single = {key: path_of(text) for key in ("map", "background") if (text := getattr(self, key))}
        return self.model_copy(update={**named, **single})

    def of_each(self, key: str, names: Sequence[str]) -> dict[str, Any]:
        """The values of a key by robot (by file of ``offset_s``); names without a value are left out.

        Raises:
            InputError: no robot or file has a name that is there.
        """
        values, kind = getattr(self, key), "file" if key == "offset_s" else "robot"
        for name in values:
            if name not in (EVERY, *names):
                raise InputError(f"{key}: {name}: no {kind} is called '{name}'{nearest_name(name, names)}")
        found = {name: values.get(name, values.get(EVERY)) for name in names}
        return {name: value for name, value in found.items() if value is not None}

    def to_yaml(self, folder: Path) -> str:
        """The text of a ``setup.yaml`` in a folder: every key with its meaning, defaults commented out."""
        default, lines = (
            type(self)(),
            ["# how 'midnet-bench replay FILE --setup setup.yaml' reads a recording"],
        )
        values = self.with_paths(
            lambda text: os.path.relpath(text, folder) if Path(text).is_file() else text
        ).model_dump(exclude_none=True)
        for key, field in type(self).model_fields.items():
            value = values.get(key)
            if isinstance(value, dict) and set(value) == {EVERY}:
                value = value[EVERY]
            mark = "# " if getattr(self, key) == getattr(default, key) else ""
            lines += ["", f"# {field.description}", f"{mark}{key}: {json.dumps(value)}"]
        return "\n".join(lines) + "\n"


def by_name(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """``NAME=VALUE`` or ``VALUE`` of an option, by name. Raises InputError: a name is there twice."""
    values: dict[str, str] = {}
    for text in texts or ():
        name, sign, value = text.partition("=")
        key, value = (name, value) if sign else (EVERY, text)
        if key in values:
            twice = repr(key) if key else "a value for all robots"
            raise InputError(f"{option} {text}: {twice} is given twice")
        values[key] = value
    return values


def mount_of(text: str, option: str) -> Pose2D:
    """``X,Y,YAW_DEG``. Raises InputError: these are no three numbers."""
    parts = text.split(",")
    if len(parts) != 3:
        raise InputError(f"{option} {text}: three numbers are needed: X,Y,YAW_DEG (metres, degrees)")
    x, y, yaw_deg = (number_of(part, f"{option} {text}") for part in parts)
    return Pose2D(x, y, math.radians(yaw_deg))


def number_of(text: str, source: str) -> float:
    """A finite number, at most ``LARGEST``. Raises InputError otherwise."""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{source}: {text!r} is not a number") from None
    if not abs(value) <= LARGEST:
        raise InputError(f"{source}: {text!r} is out of range; allowed: -{LARGEST:g} to {LARGEST:g}")
    return value
