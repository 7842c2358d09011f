"""Checks of the installation: versions of its requirements, and sums of its installed files."""

from __future__ import annotations

import base64
import hashlib
import json
import platform
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from packaging.requirements import Requirement

from vcfbench.validation.check import Found, check

if TYPE_CHECKING:
    from collections.abc import Iterator

_OURS = ("vcfbench", "simrack")
_BESIDE = ("vcfbench_tables", "pyvisa_vcfbench", "pyvisa_simrack")  # Further packages that both distributions bring


def requirements() -> Iterator[Requirement]:
    """Yield the requirements of both distributions, extras apart."""
    for name in _OURS:
        for line in distribution(name).requires or ():
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                yield requirement


def versions() -> dict[str, str]:
    """Return the versions that the program works with here, by name."""
    needed = sorted({each.name for each in requirements()} | set(_OURS))
    sums = {f"{name}, SHA-256 of its files": fingerprint(name) for name in _OURS + _BESIDE}
    return {"Python": platform.python_version(), **{name: version(name) for name in needed}, **sums}


def fingerprint(name: str) -> str:
    """Return the SHA-256 over the names and contents of a package's files as they are on this machine, but ``.pyc``."""
    spec, total = find_spec(name), hashlib.sha256()
    root = Path(spec.origin).parent if spec is not None and spec.origin else Path()
    for path in sorted(each for each in root.rglob("*") if each.is_file() and each.suffix != ".pyc"):
        total.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return total.hexdigest()


def _from_working_tree(name: str) -> bool:
    """Return True if a distribution is editable: its files and version may have moved on since then (PEP 610)."""
    origin = json.loads(distribution(name).read_text("direct_url.json") or "{}")
    return bool(origin.get("dir_info", {}).get("editable"))


@check(
    "packages",
    "Are the packages that it needs there, none too old, simrack of its own version?",
    "metadata of the package",
)
def _packages() -> Found:
    asked = {str(each): each for each in requirements() if each.name not in _OURS}
    wrong = []
    for words, each in asked.items():
        try:
            there = version(each.name)
        except PackageNotFoundError:
            there = "nothing"
        if there == "nothing" or not each.specifier.contains(there, prereleases=True):
            wrong.append(f"{words}: {there} is installed")
    ours = {name: version(name) for name in _OURS if not _from_working_tree(name)}
    if len(set(ours.values())) > 1:
        both = " beside ".join(f"{name} {there}" for name, there in ours.items())
        wrong.append(f"{both}: one tag makes both, install them together")
    return Found(f"{len(asked)} packages as required", "; ".join(wrong) or f"{len(asked)} as required", not wrong)


@check("files", "Is the program as it was installed?", "RECORD of the wheel (PEP 376)")
def _files() -> Found:
    expected = "each file with the SHA-256 that it was installed with"
    wrong, count = [], 0
    for name in _OURS:
        for file in () if _from_working_tree(name) else distribution(name).files or ():
            # the installer's own: commands, and its name, which conda writes over pip's
            if file.hash is None or file.suffix == ".pyc" or file.parts[0] == ".." or file.name == "INSTALLER":
                continue
            count += 1
            path = Path(str(file.locate()))
            digest = hashlib.new(file.hash.mode, path.read_bytes()).digest() if path.is_file() else b""
            if base64.urlsafe_b64encode(digest).rstrip(b"=").decode() != file.hash.value:
                wrong.append(str(file))
    if not count:
        return Found(expected, "installed from a working tree, which has no sums", passed=None)
    return Found(expected, "changed: " + ", ".join(wrong[:5]) if wrong else f"{count} files unchanged", not wrong)


CHECKS = (_packages, _files)
"""Checks of the installation, in their order."""
