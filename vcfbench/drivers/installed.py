"""Drivers that other installed packages bring.

A package registers a model in its ``pyproject.toml``::

    [project.entry-points."vcfbench.drivers"]
    M1 = "acme.driver:DRIVER"

``DRIVER`` is what :func:`~vcfbench.drivers.registry.visa_driver` returns, or any
:class:`~vcfbench.drivers.registry.Driver`. Packages are looked through only for models that do not come along.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from vcfbench.errors import ConfigError

__all__ = ["installed_driver", "installed_models"]

_GROUP = "vcfbench.drivers"


def installed_models() -> tuple[str, ...]:
    """Return the models that installed packages register."""
    return tuple(sorted({entry.name for entry in entry_points(group=_GROUP)}))


def installed_driver(model: str) -> Any:
    """Return what an installed package registers for `model`, None when none does.

    Raises:
        ConfigError: it cannot be imported.
    """
    for entry in entry_points(group=_GROUP, name=model):
        try:
            return entry.load()
        except Exception as error:  # another package is anyone's code
            raise ConfigError(f"the driver of {model!r} ({entry.value}) cannot be loaded: {error}") from error
    return None
