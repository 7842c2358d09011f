"""Handlers with the key that they handle: a verb, a header, the number of a procedure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

_Method = TypeVar("_Method", bound="Callable[..., Any]")


class Handlers(dict[Any, str]):
    """Names of a class's methods by key; ``@COMMANDS.of("JOG")`` decorates a method."""

    def of(self, *keys: Any) -> Callable[[_Method], _Method]:
        """Register the method below for `keys`."""

        def keep(method: _Method) -> _Method:
            self.update(dict.fromkeys(keys, method.__name__))
            return method

        return keep

    def bound(self, owner: Any) -> dict[Any, Any]:
        """Return the methods of `owner`."""
        return {key: getattr(owner, name) for key, name in self.items()}
