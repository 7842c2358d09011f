"""The languages of rate tables that need no file of one's own, by name."""

from __future__ import annotations

from typing import Final

__all__ = ["BUILT_IN", "DIALECTS", "SHIPPED"]

BUILT_IN: Final = ("acl", "zaber", "atl", "esp")
"""Written in Python."""
SHIPPED: Final = ("dd16", "mn_as", "ruya", "aaaa")
"""Told by a profile that comes with the package."""
DIALECTS: Final = (*BUILT_IN, *SHIPPED)
"""What a bench file can name without a file of its own."""
