"""Arrays of numbers: their type, and the door at which those of others are taken in."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vcfbench.errors import ConfigError

Floats: TypeAlias = NDArray[np.float64]


def plain_numbers(values: Any, what: str, unit: str = "") -> Floats:
    """Return numbers of any kind as plain ones, shape (n,) or (): a column (n, 1) is a row.

    Quantities of astropy and pint are converted to `unit`. What would silently become another number is refused.

    Args:
        values: anything that NumPy takes for an array.
        what: the thing, for messages.
        unit: that in which the numbers count; empty where any will do, as plain numbers.

    Raises:
        ConfigError: masked, complex, truth values, dates or words, of more than one dimension, or in a unit that is no
            such one.
    """
    if hasattr(values, "to") and (hasattr(values, "units") or hasattr(values, "unit")):
        written = str(getattr(values, "units", None) or getattr(values, "unit", ""))
        if not unit:
            raise ConfigError(f"{what}: expected plain numbers in the unit of the result, got {written}")
        try:
            converted = values.to(unit)
        except Exception as error:  # each library has errors of its own
            raise ConfigError(f"{what}: expected a unit such as {unit}, got {written}") from error
        values = converted.magnitude if hasattr(converted, "magnitude") else converted.value
    masked = getattr(values, "mask", False)
    if not callable(masked) and np.any(masked):  # pandas has a method of that name
        raise ConfigError(f"{what}: {int(np.sum(masked))} values are masked; remove them, or the part from them on")
    found = np.asarray(values)
    odd = found.dtype.kind == "O" and any(isinstance(each, complex | bool) for each in found.flat)
    if odd or found.dtype.kind not in "fiuO":
        raise ConfigError(f"{what}: expected real numbers, got {found.dtype}")
    try:
        numbers = np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{what}: expected real numbers: {error}") from error
    if numbers.ndim == 2 and 1 in numbers.shape:
        numbers = numbers.ravel()
    if numbers.ndim > 1:
        raise ConfigError(f"{what}: expected one dimension, got the shape {numbers.shape}")
    return numbers


def plain_uncertainties(values: Any, points: int, unit: str = "") -> Floats:
    """Return the uncertainties of so many points: one for all, or one for each.

    Raises:
        ConfigError: those of :func:`plain_numbers`, another number of them, below 0, or not finite.
    """
    found = plain_numbers(values, "uncertainties", unit)
    if found.size not in {1, points}:
        raise ConfigError(f"expected one uncertainty, or {points}, got {found.size}")
    if (wrong := found[~(np.isfinite(found) & (found >= 0.0))]).size:
        raise ConfigError(f"expected uncertainties of 0 or more, got {wrong[0]:g}")
    return found
