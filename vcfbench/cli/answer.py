"""How the commands answer ``--json``."""

from __future__ import annotations

from typing import Any

import typer

__all__ = ["print_json"]


def print_json(values: dict[str, Any]) -> None:
    """Print `values` as one JSON object on one line of stdout."""
    import msgspec  # noqa: PLC0415  # keeps ``vcfbench --help`` quick

    typer.echo(msgspec.json.encode(values).decode())
