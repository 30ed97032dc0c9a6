"""Which code that results name may run: this package's, that of entry points, and what the user has run.

Results can name a user's file or module, which a command that reads them would execute. A run writes down, in
the user's own folder, which code it ran for which store; what came from elsewhere is not written there. So a
copied folder brings no trust along, and neither does a file that has changed since.
"""

import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path

from midnet_bench.campaign.definition import SEVERAL, Definition
from midnet_bench.campaign.store import FILE_NAME
from midnet_bench.errors import InputError
from midnet_bench.io.files import read_bounded
from midnet_bench.plugins import VALUE, several

MOST_BYTES = 50_000_000
_CODE = re.compile(r"(?P<place>.+\.py(?=:)|[\w.]+(?=:\s*[^\W\d]\w*\s*$)).*", re.DOTALL)
"""a reference to code: anything of a file, and a name of a module"""
all_code = False  # whether code runs that is not known; ``--trust`` sets it for one command


def remember(store: Path, definition: Definition) -> None:
    """Notes that the user has run the code of a store's campaign; nothing where the home is not writable."""
    keys = {_key(store, code) for code in _code_of(definition, store.parent)} - _known()
    try:
        if keys:
            file = _file()
            file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            opened = os.open(
                file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0), 0o600
            )
            with open(opened, "w", encoding="ascii") as lines:
                lines.writelines(f"{key}\n" for key in sorted(keys))
    except (OSError, RuntimeError):
        pass


def check(definition: Definition, directory: Path) -> None:
    """Raises InputError if results in ``directory`` name code that the user has not run for them."""
    if all_code:
        return
    known = None
    for code in _code_of(definition, directory):
        known = _known() if known is None else known
        if _key(directory / FILE_NAME, code) not in known:
            raise InputError(
                f"{directory}: names code that is not midnet-bench's and that you have not run for these "
                f"results: {code[0][:100]}; if you know what it does, the same command with --trust runs it"
            )


def _code_of(definition: Definition, directory: Path) -> Iterator[tuple[str, str]]:
    """Each reference to code of neither this package nor an entry point, and the digest of its file."""
    reference = definition.reference(directory)
    if ":" in reference and not _is_own(reference.rpartition(":")[0]):
        yield definition.experiment, _digest(reference.rpartition(":")[0])
    changed = [value for changes in definition.variants.values() for value in changes.values()]
    values = [
        *definition.parameters.values(),
        *changed,
        *(one for many in definition.grid.values() for one in many),
    ]
    texts = dict.fromkeys(
        part
        for value in values
        if isinstance(value, str) and ":" in value
        for one in value.split(SEVERAL)
        for part in several(one)
    )
    for text in texts:
        parts = VALUE.fullmatch(text.strip())
        found = _CODE.fullmatch(parts["place"].strip()) if parts else None
        if parts and found and not _is_own(found["place"]):
            yield text, "" if parts["mark"] == "#" else _digest(found["place"])


def _is_own(place: str) -> bool:
    return place.partition(".")[0] == "midnet_bench" and not place.endswith(".py")


def _digest(place: str) -> str:
    """Of the file of a path or a module, which is not imported; empty if there is none."""
    file: str | None = place
    if not place.endswith(".py"):
        parts, path, file = place.split("."), None, None
        for count in range(1, len(parts) + 1):
            spec = PathFinder.find_spec(".".join(parts[:count]), path)
            if spec is None:
                return ""
            path, file = spec.submodule_search_locations, spec.origin
    try:
        return hashlib.sha256(read_bounded(Path(file or ""), MOST_BYTES)).hexdigest()
    except (OSError, EOFError, ValueError):
        return ""


def _key(store: Path, code: tuple[str, str]) -> str:
    """What a store and its code are noted by: the file itself, wherever it is moved to, and no copy of it."""
    try:
        found = store.stat()
    except OSError:
        return ""
    return hashlib.sha256(json.dumps([found.st_dev, found.st_ino, *code]).encode()).hexdigest()


def _file() -> Path:
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home, "midnet-bench", "trusted")


def _known() -> set[str]:
    """The keys that were noted; none if another user could have written them."""
    try:
        file = _file()
        for place in (file.parent, file):
            found = place.lstat()
            is_own = not hasattr(os, "geteuid") or (
                found.st_uid == os.geteuid() and not found.st_mode & 0o077
            )
            if stat.S_ISLNK(found.st_mode) or not is_own:
                return set()
        return {*read_bounded(file, MOST_BYTES).decode("ascii").split()}
    except (OSError, RuntimeError, ValueError):
        return set()
