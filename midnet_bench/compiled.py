"""``njit`` for the compiled loops, and the folder that keeps what numba makes of them.

numba compiles a function anew when the file of that function changes, but not when a file changes that it
calls into or takes a number from. So the folder's name holds a digest of all of these files, of the libraries
and of the processor: other code is other machine code, whatever was compiled before. numba also reads options
from a file in the working folder; here it does not, since a file put there could make it load code.
"""

import atexit
import contextlib
import gc
import hashlib
import importlib
import logging
import os
import platform
import re
import shutil
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from functools import cache, partial, wraps
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast, overload

F = TypeVar("F", bound=Callable[..., Any])

_LOG = logging.getLogger("midnet_bench")
PACKAGE = Path(__file__).parent
VARIABLE = "NUMBA_CACHE_DIR"
"""the environment variable, numba's own, that names the folder for compiled loops"""
LIBRARIES = ("numba", "llvmlite", "numpy")
KEPT_S = 30 * 24 * 3600.0  # after so long without anything new, the machine code of other sources is deleted
_IMPORTS = re.compile(
    rb"^\s*(?:from|import) (midnet_bench[\w.]*)(?: import (\([^)]*\)|[^\n]*))?", re.MULTILINE
)
_WITHOUT_EFFECT = (VARIABLE, "NUMBA_NUM_THREADS")
before_first_loop: list[Callable[[], object]] = []
"""what is called once, before this process loads or compiles its first loop"""
after_compiling: list[Callable[[], None]] = []
"""what is called each time that this process has compiled a loop for one signature"""


@overload
def njit(function: F, /) -> F: ...


@overload
def njit(*, inline: str = "never", nogil: bool = False) -> Callable[[F], F]: ...


def njit(function: F | None = None, /, **options: Any) -> F | Callable[[F], F]:
    """Numba's ``njit``, which keeps its machine code where it is not found under other sources.

    Where no folder can be written every process compiles for itself; the numbers are the same.
    """
    if function is None:
        return partial(_compiled, options)
    return _compiled({}, function)


def _compiled(options: dict[str, Any], function: F) -> F:
    """``function`` for numba to compile at its first call, with numba's ``options``."""
    library = numba()
    if library.config.DISABLE_JIT:
        return _interpreted(function)
    if folder() is None:
        dispatcher: F = library.njit(**options)(function)
        return dispatcher
    before = library.config.CACHE_LOCATOR_CLASSES
    library.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{Locator.__name__}"
    try:
        dispatcher = library.njit(cache=True, **options)(function)
    finally:
        library.config.CACHE_LOCATOR_CLASSES = before
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
        _load_array_functions()
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

    def __init__(self, function: Callable[..., Any], file: str, path: Path) -> None:
        self._py_file = file  # numba's warnings name it
        self._path = path / str(function.__module__)
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> "Locator | None":
        """Numba looks for another place if this is None."""
        path = folder()
        return None if path is None else cls(function, file, path)

    def ensure_cache_path(self) -> None:
        """Make the folder. Raises OSError if it cannot be made."""
        self._path.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._path)

    def get_source_stamp(self) -> str:
        """Machine code with another stamp is not taken."""
        return digest()

    def get_disambiguator(self) -> str:
        """Two functions of one name and module may stand on different lines."""
        return str(self._line)


def prepare_folder() -> Path | None:
    """The folder that holds one folder of machine code for each state of the sources; None if there is none.

    It is what ``NUMBA_CACHE_DIR`` names, else one in the user's cache (``XDG_CACHE_HOME``, ``~/.cache``).
    Where that cannot be written, or others can write it, it is a temporary one, which goes with this process;
    processes that this one starts find it.
    """
    named = os.environ.get(VARIABLE)
    if named == os.devnull:
        return None
    home = os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~"), ".cache")
    return _private(Path(named or Path(home, "midnet-bench"))) or _temporary()


@cache
def folder() -> Path | None:
    """Where this process keeps its machine code: ``<folder>/<digest>``; None if nowhere, or it makes none."""
    root = None if numba().config.DISABLE_JIT else prepare_folder()
    if root is None:
        return None
    if not (root / digest()).exists():
        _forget_old(root)
    if (path := _private(root / digest())) or (root := _temporary()) is None:
        return path
    return _private(root / digest())


def is_compiled(name: str) -> bool:
    """Whether :func:`note_compiled` was called with ``name`` for these sources, by any process."""
    path = folder()
    return path is not None and (path / f"{name}.compiled").exists()


def note_compiled(name: str) -> None:
    """Remember that all the loops that ``name`` stands for are in the folder; it is a file there."""
    path = folder()
    if path is not None:
        with contextlib.suppress(OSError):
            (path / f"{name}.compiled").touch()


@cache
def digest() -> str:
    """What machine code depends on: sources, libraries, processor, numba's options; 16 hexadecimal digits."""
    import llvmlite.binding as llvm

    found = hashlib.sha256()
    for name, source in sorted(_sources().items()):
        found.update(f"{name} {len(source)}\n".encode() + source)
    options = {
        key: value
        for key, value in os.environ.items()
        if key.startswith("NUMBA_") and key not in _WITHOUT_EFFECT
    }
    rest = (
        sys.version,
        platform.machine(),
        [version(library) for library in LIBRARIES],
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
        sorted(options.items()),
    )
    found.update(repr(rest).encode())
    return found.hexdigest()[:16]


def _sources() -> dict[str, bytes]:
    """Module -> source, of each module with a compiled loop and of all that these import of this package."""
    paths = {
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
        for path in PACKAGE.rglob("*.py")
    }
    sources: dict[str, bytes] = {}
    unread = []
    for name, path in paths.items():
        source = path.read_bytes()
        if b"njit" in source:
            sources[name] = source
            unread.append(source)
    while unread:
        for module, parts in _IMPORTS.findall(unread.pop()):
            inside = [module + b"." + part for part in re.findall(rb"\w+", parts)]  # of a package
            for name in map(bytes.decode, [module, *inside]):
                # the package itself only names what it offers
                if name in paths and name not in sources and name != PACKAGE.name:
                    sources[name] = paths[name].read_bytes()
                    unread.append(sources[name])
    return sources


def _private(path: Path) -> Path | None:
    """``path``, made if need be, if files can be written there and no other user could have: they are run."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
        is_own = not hasattr(os, "geteuid") or path.stat().st_uid == os.geteuid()
        is_open = os.name == "posix" and path.stat().st_mode & 0o022
    except (OSError, ValueError, RuntimeError):
        return None
    if is_own and not is_open:
        return path
    _LOG.warning("%s: another user could have put machine code there: not used; delete it", path)
    return None


def _temporary() -> Path | None:
    try:
        path = Path(tempfile.mkdtemp(prefix="midnet-bench-compiled-"))
    except OSError:
        _LOG.warning(
            "compiled loops are not kept, since no folder can be written: each process compiles for a minute."
            " %s can name a folder",
            VARIABLE,
        )
        os.environ[VARIABLE] = os.devnull  # processes that this one starts need not say it again
        return None
    os.environ[VARIABLE] = str(path)
    owner = os.getpid()

    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(path, ignore_errors=True)

    atexit.register(remove)
    return path


def _forget_old(root: Path) -> None:
    """Machine code of sources that have not run for long makes room."""
    with contextlib.suppress(OSError):
        for other in root.iterdir():
            if re.fullmatch("[0-9a-f]{16}", other.name) and time.time() - other.stat().st_mtime > KEPT_S:
                shutil.rmtree(other, ignore_errors=True)


@cache
def numba() -> ModuleType:
    """numba, without what a ``.numba_config.yaml`` in the working folder would tell it."""
    if "numba" not in sys.modules:
        with _without("yaml"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it cannot read such a file without yaml
            importlib.import_module("numba.core.config")
        sys.modules["numba.core.config"]._config_fname = os.devnull  # type: ignore[attr-defined]
    return importlib.import_module("numba")


def collect_garbage_rarely() -> None:
    """Let this process search cyclic garbage each 100 000 objects: imports make many, and few are garbage."""
    gc.set_threshold(100_000, 50, 50)


@cache
def _load_array_functions() -> None:
    """Load numba's array functions without SciPy's linear algebra, which they look for at once (0.15 s).

    Loops that need it still find it.
    """
    with _without("scipy.linalg"):
        module = importlib.import_module("numba.np.arraymath")
    module._HAVE_BLAS = find_spec("scipy") is not None  # type: ignore[attr-defined]
    for call in before_first_loop:
        call()


@contextlib.contextmanager
def _without(name: str) -> Iterator[None]:
    """The module ``name`` cannot be imported meanwhile."""
    before = sys.modules.get(name)
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]
        if before is not None:
            sys.modules[name] = before
