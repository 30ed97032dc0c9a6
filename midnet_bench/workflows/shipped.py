"""Folders that have their home in the repository and travel inside the package when it is installed."""

from pathlib import Path

import midnet_bench

_PACKAGE = Path(midnet_bench.__file__).parent


def installed() -> bool:
    """Whether this is an installed package, not a checkout."""
    return (_PACKAGE / "campaigns").is_dir()


def shipped_folder(name: str, in_repository: str) -> Path:
    """A folder that comes with the package; ``setup.py`` names them all.

    Args:
        name: of the folder inside an installed package, such as ``campaigns``.
        in_repository: its path in a checkout, where it has its home.
    """
    installed = _PACKAGE / name
    return installed if installed.is_dir() else _PACKAGE.parent / in_repository
