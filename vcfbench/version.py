"""The version of this package, as it is installed."""

from __future__ import annotations


def installed_version() -> str:
    """Return the version, ``0+unknown`` of a source tree that was only put on the path."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415  # it takes longer than all the rest

    try:
        return version("vcfbench")
    except PackageNotFoundError:
        return "0+unknown"
