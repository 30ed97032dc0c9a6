"""Stores as earlier versions wrote them."""

import json
import random
import sqlite3
from pathlib import Path

from midnet_bench.campaign.store import open_store

SCHEMA_1 = (
    "CREATE TABLE campaign (definition TEXT NOT NULL)",
    """CREATE TABLE runs (
        run_id INTEGER PRIMARY KEY,
        provenance TEXT NOT NULL,
        ended_utc TEXT
    )""",
    """CREATE TABLE trials (
        trial_id TEXT PRIMARY KEY,
        run_id INTEGER NOT NULL REFERENCES runs,
        seed INTEGER NOT NULL,
        parameters TEXT NOT NULL,
        status TEXT NOT NULL CHECK (status IN ('finished', 'failed')),
        simulated_s REAL,
        wall_s REAL NOT NULL,
        traceback TEXT CHECK ((traceback IS NOT NULL) = (status = 'failed')),
        finished_utc TEXT NOT NULL,
        result BLOB CHECK ((result IS NOT NULL) = (status = 'finished'))
    )""",
    "PRAGMA application_id = 0x4D49444E",
    "PRAGMA user_version = 1",
)
"""what version 0.1.0 wrote; not to be changed"""


def as_schema_1(new: Path, old: Path) -> Path:
    """A store of 0.1.0 with the trials of ``new``, in an order of its own."""
    connection = sqlite3.connect(old)
    for statement in SCHEMA_1:
        connection.execute(statement)
    with open_store(new) as store:
        connection.execute("INSERT INTO campaign VALUES (?)", (store.definition.to_json(),))
        run = store.runs()[0]
        ended_utc = run.pop("ended_utc")
        connection.execute("INSERT INTO runs VALUES (1, ?, ?)", (json.dumps(run), ended_utc))
        trials = list(store.trials())
    random.Random(1).shuffle(trials)
    for one in trials:
        connection.execute(
            "INSERT INTO trials VALUES (?, 1, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                one.trial_id,
                one.seed,
                json.dumps(dict(one.parameters)),
                one.status,
                one.simulated_s,
                one.wall_s,
                one.traceback,
                one.finished_utc,
                one.payload,
            ),
        )
    connection.commit()
    connection.close()
    return old
