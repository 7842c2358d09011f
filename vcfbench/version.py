"""Versions of this package and of those that a record names."""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any, Final

EVALUATION: Final = 13
"""Version of the evaluation: raised when the same readings give other values or uncertainties.

Records name it, so that they are held to their own. The tools that keep results for the tests ask for it.
"""


def installed_version(package: str = "vcfbench") -> str:
    """Return the version of a package, ``0+unknown`` of a source tree that was only put on the path."""
    from importlib.metadata import PackageNotFoundError, distribution  # noqa: PLC0415  # longer than all the rest

    try:
        found = distribution(package)
    except PackageNotFoundError:
        return "0+unknown"
    # `found.version` reads what stands behind as well: 10 ms for the licences of numpy or SciPy
    stated = re.search(r"^Version: (.+)$", found.read_text("METADATA") or "", re.MULTILINE)
    return stated[1] if stated else found.version


def other_versions(header: Mapping[str, Any]) -> str:
    """Say which versions of a record are not those that are installed here, empty where all are."""
    then, now = header.get("versions", {}), installed_versions()
    known = {**now, "evaluation": "of before", **(then if isinstance(then, dict) else {})}
    return ", ".join(f"{name} {known[name]}, here {now[name]}" for name in now if known[name] != now[name])


@cache  # what is installed stays as it is, and asking opens a file of each package
def installed_versions() -> Mapping[str, str]:
    """Return the versions of Python, this package, its evaluation, simrack, and the libraries of results."""
    import platform  # noqa: PLC0415

    packages = ("vcfbench", "simrack", "numpy", "scipy", "pyvisa", "pyvisa-py", "pyserial")
    versions = {package: installed_version(package) for package in packages}
    return {"python": platform.python_version(), "evaluation": str(EVALUATION), **versions}
