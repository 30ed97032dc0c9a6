"""What the fuzzer tries: for each reader, how a mutated input is made and which command takes it."""

import gzip
import json
import random
import shutil
import sqlite3
import sys
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from typer.main import get_command

from benchmarks.relations import read_dense_odometry, read_relations
from midnet_bench import cli
from midnet_bench.campaign import store as rows
from midnet_bench.cli.app import app
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import parameters_model
from midnet_bench.io.scan_logs import read_scan_log
from midnet_bench.mapping.log_mapping import held_in_memory, map_scans
from midnet_bench.settings import leaves
from midnet_bench.workflows.library import simulate
from midnet_bench.workflows.maps import write_trajectory
from midnet_bench.workflows.report import write_report
from tests.fuzz import mutations, originals, recordings
from tests.fuzz.mutations import chance, pick, text_file

Random = random.Random
DRAWN = 0.03  # share of the cases whose pictures are drawn, which takes longer than all else


@dataclass(frozen=True)
class Case:
    """A command on a mutated input that lies in its working folder."""

    call: Callable[[], None]
    words: str  # the command line, or what stands for it
    may_write: Sequence[str]  # in the working folder; "." is all of it
    good_codes: Sequence[int] = (0,)
    names: Sequence[str] = ()  # paths that the user asks it to write to


def command(*arguments: str, writes: Sequence[str] = (), good_codes: Sequence[int] = (0,)) -> Case:
    """The case that is a command line of midnet-bench."""

    def call() -> None:
        sys.argv = ["midnet-bench", *arguments]
        cli.main()

    return Case(call, f"midnet-bench {' '.join(map(repr, arguments))}", writes, good_codes)


def function(words: str, call: Callable[[], object], writes: Sequence[str] = ()) -> Case:
    """The case that is a function, whose InputError is the refusal, as the command line has it."""

    def refuse() -> None:
        try:
            call()
        except InputError as error:
            cli.messages.set_up()
            cli.messages.log.error("%s", cli.messages.one_line(f"error: {error}"))
            raise SystemExit(error.exit_code) from None

    return Case(refuse, words, writes)


Make = Callable[[Random | None, Path], Case]
"""Writes a reader's input into a folder, mutated by the generator, or as it is if there is none."""


def campaign(rng: Random | None, folder: Path) -> Case:
    """Campaign files, asked what would run."""
    text = text_file(pick(rng, list(originals.campaigns().values())), rng, True)
    (folder / "campaign.yaml").write_bytes(text)
    return command("run", "campaign.yaml", "-n")


def arena(rng: Random | None, folder: Path) -> Case:
    """Arena files, drawn as a map or asked for a campaign."""
    (folder / "arena.yaml").write_bytes(text_file(pick(rng, originals.arenas()), rng, True))
    exact = ("map", "arena.yaml", "--exact", "-o", "out")
    planned = ("labyrinth", "--arena", "arena.yaml", "--trials", "1", "-n")
    return command(*pick(rng, (exact, planned)), writes=("out",))


def trial(rng: Random | None, folder: Path) -> Case:
    """Two frames of a trial in an arena, with settings."""
    text = originals.arenas()[0]
    if rng is not None:
        text = mutations.tree(text, rng)
    (folder / "arena.yaml").write_bytes(text)
    parameters: dict[str, Any] = {"arena": "arena.yaml", "prior_map": "exact", "robots": 2}
    if rng is not None and chance(rng, 0.5):
        key, parameters[key] = _setting("detection", rng)
    parameters |= {"engine": "fast", "frames": 2}

    def frames() -> None:
        with simulate("detection", seed=1, **parameters) as simulated:
            for _ in simulated:
                pass

    return function(f"simulate(detection, seed=1, {parameters})", frames)


def ros_map(rng: Random | None, folder: Path) -> Case:
    """map_server's pairs: the YAML file or the image mutated."""
    name = pick(rng, sorted(originals.images()))
    text, image = originals.map_yaml(name), originals.images()[name]
    if chance(rng, 0.5):
        text = text_file(text, rng, True)
    elif rng is not None:
        is_png = name.endswith("png") and rng.random() < 0.7
        image = mutations.png(image, rng) if is_png else text_file(image, rng)
    (folder / "map.yaml").write_bytes(text)
    (folder / name).write_bytes(image)
    return command("detection", "--robots", "1", "--map", "map.yaml", "-n")


def scan_log(rng: Random | None, folder: Path) -> Case:
    """Recorded logs, plain or gzipped, mapped."""
    data = text_file(pick(rng, list(originals.scan_logs().values())), rng)
    path = folder / "run.log"
    if rng is not None and chance(rng, 0.2):
        data = gzip.compress(data)
        data = mutations.file_bytes(data, rng) if chance(rng, 0.5) else data
    path.write_bytes(data)
    if rng is None or rng.random() < DRAWN:
        line = ("map", "--from-log", path.name, "--particles", "2", "--no-clip", "-o", "out")
        return command(*line, writes=("out",))

    particles = pick(rng, (2, None))  # GMapping or graph SLAM

    def map_it() -> None:
        log = read_scan_log(Path(path.name))
        with held_in_memory(log):
            made = map_scans(log, particles, seed=1)
        write_trajectory(made, log.path, Path("out", "trajectory.tum"))

    return function(f"map_scans({path.name})", map_it, writes=("out",))


def trajectory(rng: Random | None, folder: Path) -> Case:
    """Trajectories and relations that a benchmark compares maps with."""
    kind = pick(rng, sorted(originals.relations()))
    path = folder / f"{kind}.txt"
    path.write_bytes(text_file(originals.relations()[kind], rng))
    read = read_dense_odometry if kind == "odometry" else read_relations
    return function(f"{read.__name__}({path.name})", lambda: read(Path(path.name)))


def store(rng: Random | None, folder: Path) -> Case:
    """Stores with their bytes, rows or tables of a trial mutated."""
    name = pick(rng, ("labyrinth", "detection"))
    shutil.copytree(campaigns_folder(folder) / name, folder / name)
    path = folder / name / "campaign.sqlite"
    if rng is not None and rng.random() < 0.4:
        path.write_bytes(mutations.file_bytes(path.read_bytes(), rng))
    elif rng is not None:
        _mutate_rows(path, rng)
    return _reported(rng, folder, name)


def tables(rng: Random | None, folder: Path) -> Case:
    """Exported tables, without their store."""
    name = pick(rng, ("labyrinth-tables", "detection-tables"))
    shutil.copytree(campaigns_folder(folder) / name, folder / name)
    files = sorted(path for path in (folder / name).iterdir())
    if rng is not None:
        path = rng.choice(files)
        path.write_bytes(text_file(path.read_bytes(), rng, path.suffix == ".json"))
    return _reported(rng, folder, name)


def experiment(rng: Random | None, folder: Path) -> Case:
    """Files with an experiment of one's own."""
    (folder / "walk.py").write_bytes(text_file(originals.EXPERIMENT, rng))
    (folder / "walking.yaml").write_bytes(originals.WALKING)
    return command("run", "walking.yaml", "-n")


def option(rng: Random | None, folder: Path) -> Case:
    """Every option and argument of every command."""
    shutil.copytree(campaigns_folder(folder), folder / "results")
    (folder / "run.log").write_bytes(originals.scan_logs()["table"])
    (folder / "arena.yaml").write_bytes(originals.arenas()[0])
    (folder / "campaign.yaml").write_bytes(originals.campaigns()["smoke-labyrinth"])
    (folder / "map.yaml").write_bytes(originals.map_yaml("map.pgm"))
    (folder / "map.pgm").write_bytes(originals.images()["map.pgm"])
    line = list(pick(rng, _EXAMPLES))
    if rng is not None:
        for _ in range(rng.choice((1, 1, 2, 3))):
            _mutate_line(line, rng)
    bounded = [*line, *_BOUNDED.get(line[0], ())]
    return replace(command(*bounded, writes=(".",), good_codes=(0, 3, 4)), names=bounded)


def _replayed(make: Callable[[Random | None, Path, Path], tuple[str, ...]]) -> Make:
    """A recording listed, replayed or checked."""

    def case(rng: Random | None, folder: Path) -> Case:
        line = make(rng, campaigns_folder(folder) / "recordings", folder)
        return command("replay", *line, "-o", "out", "-q", writes=("out",))

    return case


READERS: dict[str, Make] = {
    "campaign file": campaign,
    "arena file": arena,
    "trial": trial,
    "map": ros_map,
    "scan log": scan_log,
    "trajectory": trajectory,
    "store": store,
    "exported tables": tables,
    "experiment file": experiment,
    "command line": option,
    **{name: _replayed(make) for name, make in recordings.RECORDINGS.items()},
}


def campaigns_folder(folder: Path) -> Path:
    """Where ``originals.write_campaigns`` wrote to: beside the cases' folders."""
    return folder.parent / "originals"


def _setting(name: str, rng: Random) -> tuple[str, Any]:
    """A parameter of an experiment, and a value for it: at a limit, about the default, or any."""
    key, leaf = rng.choice(sorted(leaves(parameters_model(name)).items()))
    limits = [limit for name, limit in leaf.limits.items() if name != "multiple_of"]
    kind = rng.random()
    if kind < 0.3 and (allowed := [*limits, *leaf.choices]):
        return key, rng.choice(allowed)
    if kind < 0.7 and isinstance(leaf.default, int | float):
        return key, mutations.near(leaf.default, rng)
    return key, mutations.value(rng)


def _reported(rng: Random | None, folder: Path, name: str) -> Case:
    """A command on the campaign in the folder ``name``."""
    original = shutil.copytree(campaigns_folder(folder) / name.removesuffix("-tables"), folder / "original")
    writes = (name, original.name, "out")
    kind = 1.0 if rng is None else rng.random()
    if kind > 0.7:
        return function(f"write_report({name})", lambda: write_report(name, sys.maxsize), writes)
    lines: list[tuple[str, ...]] = [
        ("verify", name),
        ("compare", name, original.name),
        ("compare", name, "--by", "robots"),
        ("verify", name, "--difference", "5", "--robots", "1,2"),
    ]
    drawn = [("report", name), ("report", name, "-o", "out"), ("compare", name, original.name, "-o", "out")]
    return command(*pick(rng, drawn if kind < DRAWN else lines), writes=writes, good_codes=(0, 3, 4))


def _mutate_rows(path: Path, rng: Random) -> None:
    """One value of the database, or what a trial's packed tables say, with a checksum that fits."""
    connection = sqlite3.connect(path)
    if rng.random() < 0.5:
        found = connection.execute(
            f"SELECT rowid, {rows.COLUMNS} FROM trials WHERE result IS NOT NULL"
        ).fetchall()
        row_id, *values, _ = rng.choice(found)
        row = rows.TrialRow(*values)
        text = text_file(zlib.decompress(row.result), rng, True)
        if rng.random() < 0.5:
            text = _as_json(text)
        connection.execute("DELETE FROM trials WHERE rowid = ?", (row_id,))
        row = row._replace(result=zlib.compress(text))
        connection.execute(rows.INSERT, (*row, row.checksum))
    else:
        table = rng.choice(("campaign", "runs", "cells", "trials"))
        columns = [column[1] for column in connection.execute(f"PRAGMA table_info({table})")]
        column = rng.choice(columns)
        row_id, old = rng.choice(connection.execute(f"SELECT rowid, {column} FROM {table}").fetchall())
        new: Any = mutations.value(rng)
        if isinstance(old, str) and old.startswith("{") and rng.random() < 0.7:
            new = _as_json(mutations.tree(old.encode(), rng)).decode()
        if not isinstance(new, str | int | float | None):
            new = str(new)
        try:
            connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (new, row_id))
        except (sqlite3.Error, OverflowError, UnicodeEncodeError):
            connection.execute(f"DELETE FROM {table} WHERE rowid = ?", (row_id,))
    connection.commit()
    connection.close()


def _as_json(text: bytes) -> bytes:
    """What a YAML text says, as JSON; the text itself if it says nothing that JSON can."""
    try:
        return json.dumps(yaml.safe_load(text)).encode()
    except (yaml.YAMLError, TypeError, ValueError, RecursionError):
        return text


# an option that lacks its value takes the first of two
_BOUNDED = {name: ("-n", "-n") for name in ("detection", "labyrinth", "run")} | {
    "map": ("--exact", "--exact"),
    "render": ("--frames", "2", "--robots", "1", "--no-clip", "--engine", "fast"),
}
"""what ends a command line, so that its trials are few or none"""

_EXAMPLES = [
    ("detection", "--seeds", "20", "--robots", "1,5", "--frames", "20", "--arena", "map2", "-o", "out"),
    ("labyrinth", "--trials", "5", "--robots", "1,3", "--intruders", "2", "-o", "out"),
    ("run", "campaign.yaml", "--set", "engine=fast", "--trials", "2", "--jobs", "1"),
    ("run", "readings", "--backend", "loky", "--seed", "3"),
    ("map", "arena.yaml", "-o", "out"),
    ("report", "results/labyrinth/campaign.sqlite"),
    ("report", "results/detection/campaign.sqlite", "-o", "figures"),
    ("verify", "results/labyrinth"),
    ("verify", "results/labyrinth", "--difference", "5", "--robots", "1,2"),
    ("compare", "results/labyrinth", "--by", "robots"),
    ("compare", "results/detection", "results/detection-tables"),
    ("parameters", "detection"),
    ("run", "--json"),
]


def _options(name: str) -> list[Any]:
    group: Any = get_command(app)
    found = group.commands.get(name)
    return [] if found is None else [one for one in found.params if one.param_type_name == "option"]


def _mutate_line(line: list[str], rng: Random) -> None:
    """Exchange, remove or repeat a word of the line, or add an option of its command."""
    known = _options(line[0])
    kind = rng.random()
    if kind < 0.5 and known:
        chosen = rng.choice(known)
        line.append(rng.choice([*chosen.opts, *chosen.secondary_opts]))
        if not chosen.is_flag:
            line += [_option_value(chosen.name or "", rng) for _ in range(chosen.nargs)]
    elif kind < 0.8:
        line[rng.randrange(len(line))] = mutations.scalar(rng)
    elif kind < 0.9 and len(line) > 1:
        del line[rng.randrange(1, len(line))]
    else:
        line.insert(rng.randrange(len(line) + 1), mutations.scalar(rng))


def _option_value(name: str, rng: Random) -> str:
    if name == "settings":
        return "=".join(map(str, _setting(rng.choice(("detection", "labyrinth")), rng)))
    return mutations.scalar(rng)
