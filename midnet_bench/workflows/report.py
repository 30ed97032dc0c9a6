"""Everything that can be said of a campaign, from its store alone."""

import json
from pathlib import Path

from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.export import export_csv
from midnet_bench.campaign.store import FILE_NAME, Store, open_store
from midnet_bench.io.files import write_atomically


def write_report(directory: Path) -> list[Table]:
    """Write CSVs, tables, figures, configuration and provenance of a campaign; the tables worth printing.

    Raises:
        InputError: there is no store, or it is damaged, foreign or of a newer version.
    """
    with open_store(directory / FILE_NAME) as store:
        export_csv(store, directory)
        _write_provenance(store, directory)
        if store.definition.experiment == "detection":
            from midnet_bench.experiments.detection.tables import write_detection_report

            return write_detection_report(store, directory)
        if store.definition.experiment == "mapping":
            from midnet_bench.experiments.mapping.tables import write_mapping_report

            return write_mapping_report(store, directory)
        if store.definition.experiment == "readings":
            from midnet_bench.experiments.readings.tables import write_readings_report

            return write_readings_report(store, directory)
        from midnet_bench.experiments.labyrinth.tables import write_labyrinth_report

        return write_labyrinth_report(store, directory)


def _write_provenance(store: Store, directory: Path) -> None:
    """``configuration.json``: what was run, resolved; ``provenance.json``: by which code, where and when."""
    configuration = json.loads(store.definition.to_json())
    write_atomically(directory / "configuration.json", json.dumps(configuration, indent=1) + "\n")
    write_atomically(directory / "provenance.json", json.dumps(store.runs(), indent=1) + "\n")
