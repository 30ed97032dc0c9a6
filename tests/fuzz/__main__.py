"""Mutated inputs for every reader and every option: ``python -m tests.fuzz --cases 10000 --seed 1``.

Each must end in success, or in exit code 2 with one line. Prints a table of counts by reader; exit code 1 if
there is a find. The same seed gives the same cases, whatever their number.
"""

import argparse
import contextlib
import gc
import importlib
import os
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

os.environ |= {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NO_COLOR": "1", "MPLBACKEND": "agg"}

from midnet_bench import compiled
from midnet_bench.experiments import registry
from tests.fuzz import forked, originals, recordings
from tests.fuzz.readers import READERS, Case


class Tried(NamedTuple):
    """A case and how it ended."""

    number: int
    reader: str
    case: Case
    ended: forked.Ended
    find: str


def warm_up(root: Path) -> None:
    """Import everything and load all compiled loops: a fork then has no more to do than its case."""
    originals.write_campaigns(root / "originals")
    recordings.write_recordings(root / "originals" / "recordings")
    for name in registry.names():
        registry.experiment(name)
    importlib.import_module("matplotlib.font_manager")  # it looks for its cache, which no case may write
    for number, name in enumerate(READERS):
        folder = root / f"warm-{number}"
        folder.mkdir()
        case = READERS[name](None, folder)
        with (
            contextlib.chdir(folder),
            open(os.devnull, "w") as nowhere,
            contextlib.redirect_stdout(nowhere),
            contextlib.redirect_stderr(nowhere),
            contextlib.suppress(SystemExit),
        ):
            case.call()
    gc.freeze()


def tried(root: Path, number: int, seed: int) -> Tried:
    """The case of that number of a seed. Its folder is left."""
    name = list(READERS)[number % len(READERS)]
    folder = root / f"case-{number}"
    folder.mkdir()
    case = READERS[name](random.Random(f"{seed} {number}"), folder)
    return _ended(root, number, name, folder, case)


def untouched(root: Path) -> Iterator[Tried]:
    """Every reader's input as it is: what is refused of the mutants is then refused for their mutation."""
    for number, name in enumerate(READERS):
        folder = root / f"whole-{number}"
        folder.mkdir()
        yield _ended(root, number, name, folder, READERS[name](None, folder))


def _ended(root: Path, number: int, name: str, folder: Path, case: Case) -> Tried:
    places = [folder / path for path in case.may_write]
    kept = compiled.folder()
    # what runs trials tries first whether it can write beside it
    places += [root / "tmp", *([kept.parent] if kept else [])]
    ended = forked.run(case.call, folder, places, [folder / path for path in case.names])
    return Tried(number, name, case, ended, ended.find(case.good_codes))


def main() -> int:
    """Run the cases and print the table; 1 if there is a find."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="this one alone; what it says is printed, its folder kept")
    chosen = parser.parse_args()
    root = Path(tempfile.mkdtemp(prefix="midnet-fuzz-"))
    (root / "tmp").mkdir()
    tempfile.tempdir = str(root / "tmp")
    warm_up(root)
    if chosen.case is not None:
        one = tried(root, chosen.case, chosen.seed)
        print(f"{one.case.words}\n{one.ended.stderr}{one.ended}\nin {root / f'case-{one.number}'}")
        return int(bool(one.find))
    counts: Counter[tuple[str, str]] = Counter()
    peak_bytes, most_cpu_s = 0, 0.0
    for one in untouched(root):
        if one.find or one.ended.code == 2:
            print(f"untouched {one.reader}: {one.case.words}: {one.ended}")
            counts[one.reader, "finds"] += 1
    for number in range(chosen.cases):
        one = tried(root, number, chosen.seed)
        shutil.rmtree(root / f"case-{number}", ignore_errors=True)
        shutil.rmtree(root / "tmp")
        (root / "tmp").mkdir()
        counts[one.reader, "cases"] += 1
        counts[one.reader, "finds" if one.find else "refused" if one.ended.code == 2 else "succeeded"] += 1
        peak_bytes, most_cpu_s = max(peak_bytes, one.ended.peak_bytes), max(most_cpu_s, one.ended.cpu_s)
        if one.find:
            last = one.ended.stderr.strip().rpartition("\n")[2]
            print(
                f"case {number} ({one.reader}): {one.find}: {last[:200]}\n    {one.case.words[:300]}",
                flush=True,
            )
    shutil.rmtree(root)
    columns = ("cases", "succeeded", "refused", "finds")
    print(f"{'reader':18}" + "".join(f"{column:>11}" for column in columns))
    for name in READERS:
        print(f"{name:18}" + "".join(f"{counts[name, column]:11}" for column in columns))
    sums = {column: sum(counts[name, column] for name in READERS) for column in columns}
    print(f"{'all':18}" + "".join(f"{sums[column]:11}" for column in columns))
    print(f"at most {peak_bytes / 2**20:.0f} MB resident and {most_cpu_s:.1f} s of processor time")
    return int(sums["finds"] > 0)


if __name__ == "__main__":
    sys.exit(main())
