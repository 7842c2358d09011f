"""Completions of a shell besides commands and options: roles of a bench, names of runs and of devices.

A completion never fails and says nothing: where it cannot tell, it offers nothing.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator


def role_names(ctx: Any, incomplete: str) -> list[tuple[str, str]]:
    """Return the roles of the bench that the command line names so far, with their instruments."""
    from vcfbench.procedures.bench_file import load_bench  # noqa: PLC0415
    from vcfbench.safety.roles import filled_roles  # noqa: PLC0415

    with suppress(Exception):
        description = load_bench(ctx.params.get("bench"))
        names = [role.name for role in filled_roles(description)]
        return [(name, getattr(description, name).resource) for name in names if name.startswith(incomplete)]
    return []


def run_names(ctx: Any, incomplete: str) -> list[str]:
    """Return the names of the runs in the directory of records that the command line names so far, the latest first."""
    with suppress(Exception):
        values = (ctx.params.get(name) for name in ("directory", "runs"))  # of compare, `runs` are names
        directory = next((each for each in values if isinstance(each, Path)), Path("runs"))
        found = sorted(_runs_in(directory), reverse=True)
        return [name for name in ["last", *found] if name.startswith(incomplete)]
    return []


def device_names(ctx: Any, incomplete: str) -> list[str]:
    """Return the serial numbers of the devices in the directory that the command line names so far."""
    from vcfbench.records.devices import DeviceStore  # noqa: PLC0415

    with suppress(Exception):
        serials = DeviceStore(Path(ctx.params.get("devices") or "devices")).serials()
        return [serial for serial in serials if serial.startswith(incomplete)]
    return []


def _runs_in(directory: Path) -> Iterator[str]:
    """Yield the names of directories that hold a journal; they are not opened."""
    for each in directory.iterdir():
        if (each / "journal.jsonl").is_file():
            yield each.name
