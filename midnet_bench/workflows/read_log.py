"""What ``map --from-log`` takes. It stands apart from the mapping, since bags take a while to import."""

from collections.abc import Callable
from pathlib import Path

from midnet_bench.io.scan_logs import ScanLog, read_scan_log
from midnet_bench.recording.files.bags import is_bag


def read_log(path: Path, note: Callable[[str], None]) -> ScanLog:
    """A CARMEN log, a table of scans, or any recording of ``replay``. Raises InputError: it is none."""
    if path.suffix == ".csv" or path.is_dir() or (path.exists() and is_bag(path)):
        from midnet_bench.recording.scan_log import scan_log_of  # which takes a compiler

        return scan_log_of(path, note)
    return read_scan_log(path)
