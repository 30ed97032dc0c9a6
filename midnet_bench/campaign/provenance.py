"""Where numbers come from, and which code that results name may run.

Provenance is code, libraries, machine, command and time; never a path of the machine.

Results can name a user's file or module, which a command that reads them would execute. A run writes down, in
the user's own folder, which code it ran for which store; what came from elsewhere is not written there. So a
copied folder brings no trust along, and neither does a file that has changed since.
"""

import functools
import hashlib
import json
import math
import os
import platform
import re
import stat
import subprocess
import sys
import zlib
from array import array
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from importlib import metadata
from importlib.machinery import PathFinder
from pathlib import Path

import midnet_bench
from midnet_bench.campaign.definition import FILE_NAME, SEVERAL, Definition
from midnet_bench.errors import InputError
from midnet_bench.io.files import read_bounded
from midnet_bench.plugins import VALUE, several

LIBRARIES = (
    "numpy",
    "opencv-python-headless",
    "pybullet",
    "mujoco-core",
    "numba",
    "scipy",
    "pydantic",
    "joblib",
)

MOST_BYTES = 50_000_000
_CODE = re.compile(r"(?P<place>.+\.py(?=:)|[\w.]+(?=:\s*[^\W\d]\w*\s*$)).*", re.DOTALL)
"""a reference to code: anything of a file, and a name of a module"""
all_code = False  # whether code runs that is not known; ``--trust`` sets it for one command

Provenance = dict[str, str | int | bool | dict[str, str] | None]


def collect(seed: int, command: Sequence[str] | None = None) -> Provenance:
    """What is known about this run, ready for JSON: names to text, numbers, or ``libraries`` by name.

    ``seed``: the base seed; ``command``: this process's own unless given.
    """
    commit, dirty = _commit()
    return {
        "midnet_bench": midnet_bench.__version__,
        "commit": commit,
        "uncommitted_changes": dirty,
        "libraries": {name: version for name in LIBRARIES if (version := _version(name))},
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "system": f"{platform.system()} {platform.release()}",
        "libc": " ".join(platform.libc_ver()).strip() or None,
        "libm": libm_digest(),
        "machine": platform.machine(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "command": " ".join(_without_paths(sys.argv if command is None else command)),
        "seed": seed,
        "started_utc": now_utc(),
    }


def libm_digest() -> str:
    """8 hexadecimal digits of what the C library's functions give, to the last bit.

    One library has several versions of them and takes what the processor can do (FMA, AVX2). They differ in
    the last bit, and so do results.
    """
    functions = (math.sin, math.cos, math.tan, math.atan, math.exp, math.log, math.sqrt, math.cbrt)
    values = array("d")
    for step in range(1, 400):
        number = 0.0173 * step
        values.extend(function(number) for function in functions)
        values.extend((math.atan2(number, 1.7), math.hypot(number, 0.3), math.pow(number, 0.7)))
    return f"{zlib.crc32(values.tobytes()):08x}"


def now_utc() -> str:
    """The present in UTC, ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions_note(runs: Iterable[Provenance]) -> list[str]:
    """What the reader of numbers should know that come from these runs: nothing, or what changed."""
    runs = [*runs]
    notes = []
    for made_by, name in ((_code, "versions of the code"), (_interpreter, "interpreters")):
        different = list(dict.fromkeys(filter(None, map(made_by, runs))))
        if len(different) > 1:
            notes.append(f"these trials were run by {len(different)} {name}: {'; '.join(different)}")
    return notes


def _interpreter(run: Provenance) -> str:
    """Python's minor version and NumPy's, whose last digits may differ from others'; empty if unknown."""
    libraries = run.get("libraries")
    numpy = libraries.get("numpy", "") if isinstance(libraries, dict) else ""
    python, numpy = (".".join(one.split(".")[:2]) for one in map(str, (run.get("python", ""), numpy)))
    return f"{python} with NumPy {numpy}" if python and numpy else ""


def code_of(runs: Iterable[Provenance]) -> str:
    """The version and commit that made these runs; several where the code changed in between."""
    return " and ".join(dict.fromkeys(_code(run) for run in runs)) or "unknown code"


def _code(run: Provenance) -> str:
    code = f"{run.get('midnet_bench', 'unknown')} {str(run.get('commit') or 'installed')[:12]}"
    digest = run.get("experiment_sha256")
    return f"{code}, experiment {str(digest)[:12]}" if digest else code


@functools.cache  # a file of the library is read for it, a tenth of a second for all
def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> tuple[str | None, bool | None]:
    """The commit of the checkout that this package runs from, and whether files were changed since."""
    checkout = Path(midnet_bench.__file__).parent.parent
    if not (checkout / ".git").exists():  # installed: a repository around site-packages is another project's
        return None, None
    try:
        commit = _git(checkout, "rev-parse", "HEAD")
        return commit, bool(_git(checkout, "status", "--porcelain", "--untracked-files=no"))
    except (OSError, subprocess.SubprocessError):
        return None, None


def _git(checkout: Path, *arguments: str) -> str:
    command = ["git", "-C", str(checkout), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()


def _processor() -> str:
    """The processor's name; Linux tells it in /proc alone."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor()


def _without_paths(command: Sequence[str]) -> list[str]:
    """The command with the program's bare name, and absolute paths cut to where they differ from here."""
    here = Path.cwd()
    shown = ["midnet-bench"]
    for argument in command[1:]:
        option, equals, value = argument.rpartition("=")
        path = Path(value)
        if path.is_absolute():
            value = str(path.relative_to(here)) if path.is_relative_to(here) else path.name
        shown.append(f"{option}{equals}{value}")
    return shown


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


def refuse_untrusted(definition: Definition, directory: Path) -> None:
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
            yield text, "" if (parts["pin"] or "").startswith("#") else _digest(found["place"])


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
