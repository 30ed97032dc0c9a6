"""``MapFiles``: where a map goes, and what lies beside it."""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from midnet_bench.campaign.files import write_atomically
from midnet_bench.campaign.provenance import Provenance, now_utc
from midnet_bench.errors import InputError
from midnet_bench.experiments.inputs import EXACT
from midnet_bench.experiments.parameters import DetectionParameters, GuardParameters
from midnet_bench.experiments.watch import binary_prior
from midnet_bench.grid import OccupancyGrid
from midnet_bench.map_server import save_binary_map, save_map
from midnet_bench.spec import parse

YAML_ENDINGS = (".yaml", ".yml")


@dataclass(frozen=True)
class MapFiles:
    """The paths of a map's files."""

    map: Path
    """its YAML file"""
    prefix: str
    """of the names of all files that are not called after the map"""

    @classmethod
    def at(cls, output: Path) -> "MapFiles":
        """``output``/map.yaml and so on; or, if ``output`` is a YAML file, that one and files beside it.

        The folder is made. Raises InputError if nothing can be written there.
        """
        is_map = output.suffix in YAML_ENDINGS
        folder = output.parent if is_map else output
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
        return cls(output, f"{output.stem}_") if is_map else cls(output / "map.yaml", "")

    @property
    def binary(self) -> Path:
        """The YAML file of the binary grid."""
        return self.map.with_stem(f"{self.map.stem}_binary")

    def named(self, name: str) -> Path:
        """The file of that name; beside a map of a given name, led by the map's."""
        return self.map.with_name(f"{self.prefix}{name}")


def write_map(
    files: MapFiles, grid: OccupancyGrid, comment: str, parameters: GuardParameters | None = None
) -> list[Path]:
    """Write a map (int8, map frame) and the binary grid that MIDNet subtracts of it; the two YAML files.

    The binary grid is that of the detection test's defaults unless ``parameters`` are given.
    """
    if parameters is None:
        fitting = {"prior_map": EXACT, "resolution_m": grid.resolution}
        parameters = parse(DetectionParameters, fitting, str(files.map))
    save_map(grid, files.map, comment=comment)
    save_binary_map(binary_prior(grid, parameters), files.binary)
    return [files.map, files.binary]


def write_origin(files: MapFiles, configuration: Mapping[str, Any], provenance: Provenance) -> list[Path]:
    """Write ``configuration.json``, what was run, and ``provenance.json``: by which code, where and when.

    ``provenance`` was collected when the run began; it ends now.
    """
    contents = {
        "configuration.json": configuration,
        "provenance.json": [{**provenance, "ended_utc": now_utc()}],
    }
    for name, content in contents.items():
        write_atomically(files.named(name), json.dumps(content, indent=1) + "\n")
    return [files.named(name) for name in contents]
