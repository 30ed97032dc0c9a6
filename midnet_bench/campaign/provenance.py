"""Where numbers come from: code, libraries, machine, command and time; never a path of the machine."""

import math
import os
import platform
import subprocess
import sys
import zlib
from array import array
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import midnet_bench

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

Provenance = dict[str, str | int | bool | dict[str, str] | None]


def collect(seed: int, command: Sequence[str] | None = None) -> Provenance:
    """What is known about this run, ready for JSON: names to text, numbers, or ``libraries`` by name.

    Args:
        seed: the base seed that everything random is derived from.
        command: the command line, this process's own unless given.
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
