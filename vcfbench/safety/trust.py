"""Programs that data files name: a VISA library, the procedure of a record. They run only after confirmation."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vcfbench.drivers.wire import behind
from vcfbench.errors import ConfigError
from vcfbench.files import shown

if TYPE_CHECKING:
    from vcfbench.station.description import BenchDescription

Trust = bool | Callable[[str], bool]
"""Whether programs that data files name may run; or who is asked, with the program, its path and SHA-256 in words."""

VARIABLE: Final = "VCFBENCH_TRUST"
"""Environment variable with the SHA-256 sums of programs that may run, with commas between them."""


def require_trust(what: str, path: str | Path, trust: Trust, hint: str = "") -> None:
    """Raise ConfigError unless the program `what`, the file `path`, is confirmed to run."""
    if trust is True:
        return
    digest = _sha256(Path(path))
    if digest in os.environ.get(VARIABLE, "").lower().replace(" ", "").split(","):
        return
    words = f"{what} {shown(path)} (SHA-256 {digest or 'unknown: the system looks for it'})"
    if callable(trust) and trust(words):
        return
    ways = "--yes, trust=True from Python" + (f", or {VARIABLE}={digest} in the environment" if digest else "")
    raise ConfigError(f"{words}: it runs only after you confirm it", hint=f"{hint}{ways}")


def require_library(description: BenchDescription, trust: Trust) -> None:
    """Raise ConfigError if the bench names a VISA library by its file that is not confirmed to run.

    What PyVISA finds by itself ("@py", "@ivi", "@vcfbench") is installed here, whatever a bench file says.
    """
    path, _, backend = behind("", description.visa_library)[1].partition("@")
    if path and backend in {"", "ivi"} and description.simulation is None:
        require_trust("the VISA library", path, trust)


def _sha256(path: Path) -> str | None:
    from hashlib import file_digest  # noqa: PLC0415  # few benches name a program

    try:
        with path.open("rb") as file:
            return file_digest(file, "sha256").hexdigest()
    except OSError:  # a name without a folder, which the system looks for; or there is none, which PyVISA will say
        return None
