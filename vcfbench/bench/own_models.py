"""Instruments that other installed packages bring: whether they fit a role, and their simulated twins.

A package registers a driver (:mod:`vcfbench.drivers.installed`) and, for simulated benches, a twin::

    [project.entry-points."vcfbench.simulated"]
    M1 = "acme.twin:SimulatedM1"

The twin is the class of a device, called with the world as it sees it, ``errors=`` and what every instrument of its
role is told. Its attribute `errors_class` is the dataclass of its imperfections, with `none()` and `drawn(rng)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

from vcfbench.errors import ConfigError

__all__ = ["OwnTwin", "own_twin", "unfit"]

_GROUP = "vcfbench.simulated"


def unfit(model: str, protocol: type) -> str | None:
    """Return why `model` cannot fill a role that wants `protocol`, as the end of "expected ..."; None when it can.

    Raises:
        ConfigError: a package registers it and cannot be loaded.
    """
    from vcfbench.drivers.installed import installed_models  # noqa: PLC0415
    from vcfbench.drivers.registry import Registry  # noqa: PLC0415

    models = installed_models()
    if model not in models:
        return "".join(f" or {name!r}" for name in models)
    driver_class = Registry().find(model).driver_class
    missing = [name for name in _members(protocol) if not hasattr(driver_class, name)]
    return f", or a driver that has {', '.join(missing)}" if missing else None


def _members(protocol: type) -> list[str]:
    return sorted({name for base in protocol.__mro__ for name in vars(base) if not name.startswith("_")})


@dataclass(frozen=True, slots=True)
class OwnTwin:
    """The simulated instrument of another package."""

    twin: Any

    def device_class(self) -> Any:
        """Return the instrument's class."""
        return self.twin

    def errors_class(self) -> Any:
        """Return the dataclass of its errors."""
        return self.twin.errors_class


def own_twin(model: str) -> OwnTwin:
    """Return the twin that an installed package registers for `model`.

    Raises:
        ConfigError: none does, or it cannot be loaded.
    """
    for entry in entry_points(group=_GROUP, name=model):
        try:
            return OwnTwin(entry.load())
        except Exception as error:  # another package is anyone's code
            raise ConfigError(f"the simulated {model} ({entry.value}) cannot be loaded: {error}") from error
    raise ConfigError(
        f"there is no simulated {model}",
        hint=f"its package registers one as an entry point of the group {_GROUP}; a real bench needs none",
    )
