"""Any recorded log as scans: which format it is, and whether there is anything in it to map."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.mapping.carmen import parse_carmen
from midnet_bench.mapping.log_text import read_lines
from midnet_bench.mapping.scan_log import ScanLog, with_ceiling
from midnet_bench.mapping.scan_table import parse_table


def read_scan_log(path: Path) -> ScanLog:
    """The scans of a log, gzipped or plain: a table if it begins with a number, else CARMEN's format.

    The largest range is that of the sensor or, where readings pile up below it, that of ``with_ceiling``.

    Raises:
        InputError: one line with the file and, where there is one, the line: an empty or unreadable file, no
            scan, missing odometry, odometry too far off for a map, a scan of another length, a word that is
            no number, NaN for odometry, or no range that says anything. Single NaN ranges are beams that say
            nothing.
    """
    lines = read_lines(path)
    words = next((line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")), [""])
    log = parse_table(path, lines) if _is_number(words[0]) else parse_carmen(path, lines)
    if log.invalid_ranges == len(log) * log.geometry.beams:
        raise InputError(f"{path}: every range in the log is NaN or infinite; there is nothing to map")
    told_m = log.geometry.range_max_m
    log = replace(log, geometry=with_ceiling(log.geometry, log.scans))
    largest_m = log.geometry.range_max_m
    # 1 cm below it GMapping begins to take readings for "nothing came back"
    if not any(np.any((scan.ranges_m > 0.0) & (scan.ranges_m < largest_m - 0.01)) for scan in log):
        sensors = f"the sensor's {largest_m:g} m"
        lowered = f"{largest_m:g} m, where readings pile up, which therefore count as 'nothing came back'"
        raise InputError(
            f"{path}: no range lies between 0 and {lowered if largest_m < told_m else sensors}; "
            "there is nothing to map"
        )
    return log


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
