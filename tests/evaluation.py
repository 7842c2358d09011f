"""What the tests keep of results is made anew under a raised version of the evaluation alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.version import EVALUATION

if TYPE_CHECKING:
    from collections.abc import Collection


def require_raised(kept: int, changed: Collection[str]) -> None:
    """End the program where results have changed since those that are `kept` under the same version."""
    if changed and kept >= EVALUATION:
        some = ", ".join(list(changed)[:3])
        message = f"results changed ({some}): raise EVALUATION in vcfbench/version.py to {kept + 1} first"
        raise SystemExit(f"{message}; records name it, and are held to what it gave")
