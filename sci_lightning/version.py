"""The version of this program."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

NAME = "sci-lightning"


def installed_version() -> str:
    """Return the installed version; ``0+unknown`` in a checkout that was never installed."""
    try:
        return version(NAME)
    except PackageNotFoundError:
        return "0+unknown"
