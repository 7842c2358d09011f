"""``--trace``: of every command that opens instruments."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path  # typer reads the annotations when it runs
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

Trace_ = Annotated[
    Path | None,
    typer.Option("--trace", metavar="FILE", help="Write every byte to and from the instruments to FILE."),
]


def tracing(path: Path | None) -> AbstractContextManager[None]:
    """Return the context in which opened connections are traced to `path`; None traces nothing."""
    if path is None:
        return nullcontext()
    from vcfbench.drivers.trace import traced  # noqa: PLC0415  # keeps ``vcfbench --help`` quick

    return traced(path)
