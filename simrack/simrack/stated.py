"""The version of an installed package, printed before other modules are loaded."""

import os
import sys


def stated_version(package: str) -> str | None:
    """Return the version that the folder ``PACKAGE-VERSION.dist-info`` names; None where none is on the path.

    `importlib.metadata` says the same and takes longer than a command that only tells it.
    """
    for place in sys.path:
        try:
            names = os.listdir(place or ".")  # noqa: PTH208  (pathlib is not loaded yet)
        except OSError:  # a path may name what is not there, or an archive
            continue
        for name in names:
            if name.startswith(f"{package}-") and name.endswith(".dist-info"):
                return name.removesuffix(".dist-info").partition("-")[2]
    return None
