"""``njit`` for the compiled loops, and the folder that keeps what numba makes of them.

numba compiles a function anew when the file of that function changes, but not when a file changes that it
calls into or takes a number from. So the folder's name holds a digest of the libraries and of the processor,
and each module's folder in it a digest of that module and of all that it imports: an edit compiles what
depends on it and nothing else. numba also reads options from a file in the working folder; here it does not,
since a file put there could make it load code.
"""

import atexit
import contextlib
import gc
import hashlib
import importlib
import logging
import os
import re
import shutil
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterable
from functools import cache, wraps
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

_LOG = logging.getLogger("midnet_bench")
PACKAGE = Path(__file__).parent
VARIABLE = "NUMBA_CACHE_DIR"
"""the environment variable, numba's own, that names the folder for compiled loops"""
IMPORT = re.compile(rb"^[ \t]*from (midnet_bench[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
"""an import of a module of this package; no other form stands in it"""
after_compiling: list[Callable[[], None]] = []
"""what is called each time that this process has compiled a loop for one signature"""


def njit(function: F) -> F:
    """Numba's ``njit``, without Python's lock while it runs.

    Its machine code is kept where it is not found under other sources. Where no folder can be written every
    process compiles for itself; the numbers are the same.
    """
    library = numba()
    if library.config.DISABLE_JIT:
        return _interpreted(function)
    is_kept = folder() is not None
    before = library.config.CACHE_LOCATOR_CLASSES  # of a user's own loops
    library.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{Locator.__name__}"
    dispatcher: F = library.njit(cache=is_kept, nogil=True)(function)
    library.config.CACHE_LOCATOR_CLASSES = before
    if is_kept:
        _forgive(dispatcher._cache)  # type: ignore[attr-defined]
    return dispatcher


_running = threading.local()  # ``inside``: whether Python runs a loop of this thread already


def _interpreted(function: F) -> F:
    """``function`` run by Python (``NUMBA_DISABLE_JIT=1``) with the same bits as compiled.

    A float given to it is a NumPy one inside, which single precision does not swallow; unsigned numbers wrap
    without a word; and plain numbers come back.
    """

    @wraps(function)
    def run(*arguments: Any, **named: Any) -> Any:
        if getattr(_running, "inside", False):
            return function(*arguments, **named)
        import numpy as np

        _running.inside = True
        try:
            with np.errstate(all="ignore"):
                return _converted(function(*_converted(arguments, True), **named), False)
        finally:
            _running.inside = False

    return cast(F, run)


def _converted(value: Any, is_given: bool) -> Any:
    """A float that is given as NumPy's, a number that comes back as Python's; those in tuples too."""
    import numpy as np

    if isinstance(value, tuple):
        each = (_converted(one, is_given) for one in value)
        return type(value)._make(each) if hasattr(value, "_make") else tuple(each)
    if is_given:
        return np.float64(value) if type(value) is float else value
    return value.item() if isinstance(value, np.generic) else value


def _forgive(loops: Any) -> None:
    """What is kept only saves time: where it is damaged, or a disk is full, numba compiles.

    ``after_compiling`` is called each time that numba has compiled.
    """
    load, save = loops.load_overload, loops.save_overload

    def load_overload(*arguments: Any) -> Any:
        try:
            return load(*arguments)
        except Exception:  # whatever unpickling a damaged file raises
            with contextlib.suppress(OSError):
                loops.flush()  # else the damaged index would be read before the next one is saved
            return None

    def save_overload(*arguments: Any) -> None:
        with contextlib.suppress(OSError):
            save(*arguments)
        for call in after_compiling:
            call()

    loops.load_overload, loops.save_overload = load_overload, save_overload


class Locator:
    """Where numba keeps the machine code of one function; numba calls these methods by name."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self._py_file = file  # numba's warnings name it
        module = function.__module__
        self._path = Path(cast(Path, folder()), f"{module}-{digest_of_sources([module])}")
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> "Locator":
        """The place of ``function``."""
        return cls(function, file)

    def ensure_cache_path(self) -> None:
        """Make the folder. Raises OSError if it cannot be made."""
        self._path.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._path)

    def get_source_stamp(self) -> str:
        """Machine code with another stamp is not taken; here the folders' names say all."""
        return ""

    def get_disambiguator(self) -> str:
        """Two functions of one name and module may stand on different lines."""
        return str(self._line)


@cache
def folder() -> Path | None:
    """Where this process keeps its machine code: ``<root>/<digest>``; None if nowhere, or it makes none.

    The root is what ``NUMBA_CACHE_DIR`` names, else one in the user's cache (``XDG_CACHE_HOME``,
    ``~/.cache``). Where that cannot be written, or others can write it, it is a temporary one, which goes
    with this process; processes that this one starts find it.
    """
    named = os.environ.get(VARIABLE)
    if named == os.devnull or numba().config.DISABLE_JIT:
        return None
    home = os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~"), ".cache")
    root = Path(named or Path(home, "midnet-bench"))
    if _is_private(root) and _is_private(root / digest()):
        return root / digest()
    try:
        root = Path(tempfile.mkdtemp(prefix="midnet-bench-compiled-"))
    except OSError:
        _LOG.warning(
            "compiled loops are not kept, since no folder can be written: each process compiles for a minute."
            " %s can name a folder",
            VARIABLE,
        )
        os.environ[VARIABLE] = os.devnull  # processes that this one starts need not say it again
        return None
    os.environ[VARIABLE] = str(root)
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return root / digest()


def _is_private(path: Path) -> bool:
    """Whether files can be written to ``path``, made if need be, and by no other user: they are run."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
        is_own = not hasattr(os, "geteuid") or path.stat().st_uid == os.geteuid()
        is_open = os.name == "posix" and path.stat().st_mode & 0o022
    except (OSError, ValueError, RuntimeError):
        return False
    if not is_own or is_open:
        _LOG.warning("%s: another user could have put machine code there: not used; delete it", path)
    return is_own and not is_open


@cache
def digest() -> str:
    """What all machine code depends on: libraries, processor, numba's options; 16 hexadecimal digits."""
    import llvmlite.binding as llvm

    named = {key: value for key, value in os.environ.items() if key.startswith("NUMBA_")}
    options = sorted((key, named[key]) for key in named.keys() - {VARIABLE, "NUMBA_NUM_THREADS"})
    libraries = [version(library) for library in ("numba", "llvmlite", "numpy")]
    processor = (llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    text = repr((sys.version, libraries, processor, options))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def digest_of_sources(modules: Iterable[str]) -> str:
    """What the machine code of ``modules`` depends on: their sources and those of all that they import.

    Returns:
        16 hexadecimal digits.
    """
    digested = hashlib.sha256()
    for name in sorted(import_closure(modules)):
        source = _source(name)
        digested.update(f"{name} {len(source)}\n".encode() + source)
    return digested.hexdigest()[:16]


def import_closure(modules: Iterable[str]) -> set[str]:
    """``modules`` of this package and all modules of it that they import, also by way of others."""
    reached: set[str] = set()
    waiting = set(modules)
    while waiting:
        reached |= waiting
        waiting = {name for module in waiting for name in _imports(module)} - reached
    return reached


@cache
def with_loops() -> list[str]:
    """The modules of this package that have a compiled loop."""
    paths = sorted(PACKAGE.rglob("*.py"))
    names = (".".join(("midnet_bench", *path.relative_to(PACKAGE).with_suffix("").parts)) for path in paths)
    return [name for name in names if b"\n@njit\n" in _source(name)]


@cache
def _source(module: str) -> bytes:
    """The source of a module of this package; empty for a package without one, and for what is no module."""
    if module.split(".")[0] != "midnet_bench":
        return b""
    path = PACKAGE.joinpath(*module.split(".")[1:])
    for candidate in (path.with_suffix(".py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate.read_bytes()
    return b""


@cache
def _imports(module: str) -> list[str]:
    """The modules of this package that a module imports; names that may be modules too."""
    found: list[str] = []
    if module == "midnet_bench":  # its public names are imported when they are used, by no loop
        return found
    for home, names in IMPORT.findall(_source(module)):
        found += [home.decode(), *(f"{home.decode()}.{name.decode()}" for name in re.findall(rb"\w+", names))]
    return [name for name in found if _source(name)]


@cache
def numba() -> ModuleType:
    """numba, without what a ``.numba_config.yaml`` in the working folder would tell it."""
    if "numba" not in sys.modules:
        yaml = sys.modules.get("yaml")
        sys.modules["yaml"] = None  # type: ignore[assignment] # cannot be imported meanwhile
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it cannot read such a file without yaml
            importlib.import_module("numba")
        del sys.modules["yaml"]
        if yaml is not None:
            sys.modules["yaml"] = yaml
        sys.modules["numba.core.config"]._config_fname = os.devnull  # type: ignore[attr-defined]
    return importlib.import_module("numba")


def collect_garbage_rarely() -> None:
    """Let this process search cyclic garbage each 100 000 objects: imports make many, and few are garbage."""
    gc.set_threshold(100_000, 50, 50)


def collect_garbage_of_trial() -> None:
    """Free what a trial has left in cycles, as a detector of a user's may.

    What is alive after the first trial is not looked at again: imports, compiled loops, maps.
    """
    gc.collect()
    _freeze()


@cache
def _freeze() -> None:
    gc.freeze()
