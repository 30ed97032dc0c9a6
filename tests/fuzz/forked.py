"""A command in a forked copy of this process, with bounds on its time, its memory and where it writes."""

import io
import os
import re
import resource
import select
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import midnet_bench

CPU_S = 5
MEMORY_BYTES = 800 << 20
"""resident, on top of what the forked process has already: 1 GB with this package and its libraries"""
WALL_S = 600  # after which a command hangs that needs no processor time
FILE_BYTES = 500_000_000
LONGEST = 300  # letters of the line that refuses an input
VERBOSE = f"midnet-bench {midnet_bench.__version__}: "  # what ``--verbose`` says first: the command
ESCAPED = 70  # exit code of a command that an exception has escaped from
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_FIRST_PATH = ("os.mkdir", "os.remove", "os.rmdir", "os.chmod", "shutil.rmtree", "sqlite3.connect")
_BOTH_PATHS = ("os.rename", "os.link", "os.symlink")


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int  # of the exit; negative: the signal that killed it
    stderr: str
    outside: str  # the first path that it tried to write to and should not, or nothing
    peak_bytes: int  # resident
    inherited_bytes: int  # of these, what the forked process had resident
    cpu_s: float

    def find(self, good_codes: Sequence[int] = (0,)) -> str:
        """What is wrong with that: one of a few kinds, or nothing."""
        if self.outside:
            return f"writes {self.outside}"
        if self.code == -signal.SIGXCPU:
            return f"takes more than {CPU_S} s of processor time"
        if self.code == -signal.SIGKILL:
            return f"hangs for {WALL_S} s"
        if self.code < 0:
            return f"dies of {signal.Signals(-self.code).name}"
        if self.code == ESCAPED or "Traceback (most recent call last)" in self.stderr:
            return "traceback"
        if self.peak_bytes - self.inherited_bytes > MEMORY_BYTES:
            return f"takes {self.peak_bytes / 2**20:.0f} MB"
        # what Python says of a user's own file, with the line that it is about, is his to hear
        lines = re.sub(r".*SyntaxWarning: .*\n(  .*\n)?", "", self.stderr).splitlines()
        if any("Warning: " in line for line in lines):
            return "a warning of Python's"
        if self.code in good_codes:
            return ""
        if self.code != 2:
            return f"exit code {self.code}"
        # a note of what is taken in place of what, before the refusal
        lines = [line for line in lines if not line.startswith((VERBOSE, "note: "))]
        if len(lines) != 1:
            return f"{len(lines)} lines of refusal"
        if len(lines[0]) > LONGEST or not lines[0].isprintable():
            return "a refusal too long or not printable"
        return ""


def run(
    call: Callable[[], None], folder: Path, may_write: Sequence[Path], named: Sequence[Path] = ()
) -> Ended:
    """``call`` in a forked process, as the bounds of this module have it.

    Args:
        call: ends by returning, or by SystemExit as a command does.
        folder: the working folder.
        may_write: files and folders that ``call`` may write to; it is kept from all others.
        named: those that the user asked it to write to: it is kept from them too, but may try.
    """
    error_file, outside_file = (os.memfd_create(name) for name in ("stderr", "outside"))
    sys.stdout.flush()
    sys.stderr.flush()
    inherited_bytes = _resident_bytes()
    pid = os.fork()
    if pid == 0:
        _in_the_fork(call, folder, may_write, named, error_file, outside_file)
    watched = os.pidfd_open(pid)
    if not select.select([watched], [], [], WALL_S)[0]:
        os.kill(pid, signal.SIGKILL)
    os.close(watched)
    _, status, used = os.wait4(pid, 0)
    said, outside = (_content(file) for file in (error_file, outside_file))
    return Ended(
        os.waitstatus_to_exitcode(status),
        said,
        outside.partition("\n")[0],
        used.ru_maxrss * 1024,
        inherited_bytes,
        used.ru_utime + used.ru_stime,
    )


def _resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def _content(file: int) -> str:
    with os.fdopen(file, "rb") as opened:
        opened.seek(0)
        return opened.read().decode(errors="replace")


def _in_the_fork(
    call: Callable[[], None],
    folder: Path,
    may_write: Sequence[Path],
    named: Sequence[Path],
    error_file: int,
    outside_file: int,
) -> None:
    code = ESCAPED
    try:
        nowhere = os.open(os.devnull, os.O_RDWR)
        os.dup2(nowhere, 0)
        os.dup2(nowhere, 1)
        os.dup2(error_file, 2)
        sys.stdout, sys.stderr = (io.TextIOWrapper(io.FileIO(n, "w"), encoding="utf-8") for n in (1, 2))
        os.chdir(folder)
        _bound()
        _watch(may_write, named, outside_file)
        try:
            call()
            code = 0
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1 if ended.code else 0
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _bound() -> None:
    """Limit this process. Libraries map more memory than they touch: what may come on top is bounded."""
    most = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 1))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_BYTES, FILE_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


_JOBLIB_S_OWN = "/dev/shm/joblib_memmapping_folder_"
"""a campaign of a case that is none of a mutated one runs; it does without this folder"""


def _watch(may_write: Sequence[Path], named: Sequence[Path], outside_file: int) -> None:
    """Keep this process from writing elsewhere; the paths that it tries are noted."""
    allowed = [os.path.realpath(path) for path in may_write]
    asked = [os.path.dirname(os.path.realpath(path)) for path in named]

    def is_below(path: str, places: Sequence[str]) -> bool:
        return any(path == place or path.startswith(f"{place.rstrip(os.sep)}{os.sep}") for place in places)

    def check(name: Any) -> None:
        if isinstance(name, int):
            return
        text = os.fsdecode(name)
        if text.startswith("file:"):
            text = unquote(urlsplit(text).path)
        path = os.path.realpath(text)
        if path in (os.devnull, "/dev/tty", "/dev/full") or text in ("", ":memory:"):
            return
        if not is_below(path, allowed):
            if not is_below(path, asked) and not path.startswith(_JOBLIB_S_OWN):
                os.write(outside_file, f"{path}\n".encode(errors="replace"))
            raise PermissionError(13, "no place to write to", text)

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            if isinstance(arguments[2], int) and arguments[2] & _WRITING:
                check(arguments[0])
        elif event in _FIRST_PATH:
            # a name below an open folder, as shutil.rmtree has it: the folder was checked
            if not (len(arguments) > 1 and isinstance(arguments[-1], int) and arguments[-1] > 0):
                check(arguments[0])
        elif event in _BOTH_PATHS:
            check(arguments[0])
            check(arguments[1])

    sys.dont_write_bytecode = True
    sys.addaudithook(hook)
