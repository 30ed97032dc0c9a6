"""``MapFiles``: where a map goes, and what lies beside it."""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from midnet_bench.arena.prior_maps import resampled
from midnet_bench.campaign.provenance import Provenance, now_utc
from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.guarded.inputs import EXACT, arena_from, prior_map_from
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.files import cannot_be_written, write_atomically
from midnet_bench.io.map_server import load_map, save_binary_map, save_map
from midnet_bench.workflows.prior_map import PRIOR_MAP_PARAMETERS, prior_map

YAML_ENDINGS = (".yaml", ".yml")
CONFIGURATION = "configuration.json"
SET_BY_EXACT = ("resolution_m", *PRIOR_MAP_PARAMETERS)
"""what an exact map and its binary grid depend on, beside the arena"""


@dataclass(frozen=True)
class MapFiles:
    """The paths of a map's files."""

    map: Path
    """its YAML file"""
    prefix: str
    """of the names of all files that are not called after the map"""

    @classmethod
    def at(cls, output: Path) -> "MapFiles":
        """``output``/map.yaml and so on; or, if ``output`` names a YAML file, that one and files beside it.

        The folder is made. Raises InputError if the map cannot be written there, MidnetBenchError if the disk
        is full.
        """
        is_map = output.suffix in YAML_ENDINGS
        folder = output.parent if is_map else output
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise cannot_be_written(folder, error) from error
        files = cls(output, f"{output.stem}_") if is_map else cls(output / "map.yaml", "")
        for yaml_path in (files.map, files.binary):
            for path in (yaml_path, yaml_path.with_suffix(".pgm")):
                if path.is_dir():
                    raise InputError(f"{path}: a folder lies where the map goes; give another place with -o")
        return files

    def refuse_another(self, configuration: Mapping[str, Any]) -> None:
        """Raises InputError if a map lies here that was not made by this very configuration.

        Nothing of a map is overwritten without a word, and no files of two runs lie side by side.
        """
        path = self.named(CONFIGURATION)
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            found = None
        is_same = found == json.loads(json.dumps(configuration))
        if not is_same and (path.exists() or self.map.exists()):
            raise InputError(
                f"{self.map}: the map of another run is there; give another place with -o, or remove it first"
            )

    @property
    def binary(self) -> Path:
        """The YAML file of the binary grid."""
        return self.map.with_stem(f"{self.map.stem}_binary")

    def named(self, name: str) -> Path:
        """The file of that name; beside a map of a given name, led by the map's."""
        return self.map.with_name(f"{self.prefix}{name}")


def write_map(files: MapFiles, grid: OccupancyGrid, comment: str, **parameters: Scalar) -> list[Path]:
    """Write a map (int8, map frame) and the binary grid that MIDNet subtracts of it; the two YAML files.

    ``parameters`` are those of ``prior_map`` that are not to have their default.
    """
    save_map(grid, files.map, comment=comment)
    save_binary_map(prior_map(grid, **parameters), files.binary)
    return [files.map, files.binary]


def write_exact_map(settings: Mapping[str, Scalar], output: str | Path) -> tuple[OccupancyGrid, list[Path]]:
    """Draw an arena's walls as a map, and write it with its binary grid and what it was made from.

    Args:
        settings: the ``arena``, and any of ``SET_BY_EXACT``.
        output: where to, as ``MapFiles`` takes it; no other run's map may be there.

    Returns:
        The map, int8: 100 occupied, 0 free; and the files, the map first.

    Raises:
        InputError: a setting is wrong or changes nothing, or nothing can be written.
        MidnetBenchError: there is no room.
    """
    _refuse_others(settings, "an exact map", ("arena", *SET_BY_EXACT))
    chosen = DetectionParameters.parse({"prior_map": EXACT, **settings}, "command line")
    values = {key: value for key, value in chosen.flat().items() if key in ("arena", *SET_BY_EXACT)}
    files = MapFiles.at(Path(output))
    configuration = {"map": EXACT, **values}
    files.refuse_another(configuration)
    place = arena_from(chosen.arena)
    grid = prior_map_from(EXACT, chosen.arena, chosen.resolution_m)
    configured = write_configuration(files, configuration)
    binary = {name: values[name] for name in PRIOR_MAP_PARAMETERS}
    return grid, [*write_map(files, grid, f"{place.name}, drawn exactly", **binary), configured]


def write_resampled_map(
    path: Path, settings: Mapping[str, Scalar], output: str | Path
) -> tuple[OccupancyGrid, list[Path]]:
    """Write a map_server map in cells of another size, with its binary grid and what it was made from.

    Args:
        path: the map's YAML file.
        settings: any of ``SET_BY_EXACT``; ``resolution_m`` is the size.
        output: where to, as ``MapFiles`` takes it; no other run's map may be there.

    Returns:
        The map, as :func:`~midnet_bench.arena.prior_maps.resampled` gives it; and the files, the map first.

    Raises:
        InputError: the map or a setting is wrong or changes nothing, or nothing can be written.
        MidnetBenchError: there is no room.
    """
    _refuse_others(settings, "a resampled map", SET_BY_EXACT)
    chosen = DetectionParameters.parse({"prior_map": EXACT, **settings}, "command line")
    values = {key: value for key, value in chosen.flat().items() if key in SET_BY_EXACT}
    found = load_map(path)
    grid = resampled(found, chosen.resolution_m)
    files = MapFiles.at(Path(output))
    configuration = {"map": str(path), **values}
    files.refuse_another(configuration)
    configured = write_configuration(files, configuration)
    binary = {name: values[name] for name in PRIOR_MAP_PARAMETERS}
    comment = f"{path.name}, resampled from {found.resolution:g} m to {grid.resolution:g} m"
    return grid, [*write_map(files, grid, comment, **binary), configured]


def _refuse_others(settings: Mapping[str, Scalar], what: str, allowed: tuple[str, ...]) -> None:
    """Raises InputError if a setting is known, but changes nothing."""
    for name in settings.keys() & DetectionParameters.defaults().keys() - {*allowed}:
        taken = ", ".join(key for key in allowed if key != "arena")
        raise InputError(f"--set {name}: changes nothing of {what}; --set takes {taken}")


def write_configuration(files: MapFiles, configuration: Mapping[str, Any]) -> Path:
    """Write ``configuration.json``, what was run; first of all, so that what follows has a name."""
    path = files.named(CONFIGURATION)
    write_atomically(path, json.dumps(configuration, indent=1) + "\n")
    return path


def write_provenance(files: MapFiles, provenance: Provenance) -> Path:
    """Write ``provenance.json``: by which code, where and when.

    ``provenance`` was collected when the run began; it ends now.
    """
    path = files.named("provenance.json")
    write_atomically(path, json.dumps([{**provenance, "ended_utc": now_utc()}], indent=1) + "\n")
    return path
