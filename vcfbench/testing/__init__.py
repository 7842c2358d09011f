"""Helpers for the tests of drivers and procedures, here and in other projects.

Names are loaded when they are first asked for: pytest imports this package in every project where it is installed.
"""


def __getattr__(name: str) -> object:
    """Load a public name, which the stub beside this file lists."""
    from importlib import import_module  # noqa: PLC0415  # as little as possible in every project's tests

    known = import_module("vcfbench.faces").homes(__file__)
    if name == "__all__":
        return sorted(known)
    if name not in known:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(known[name]), name)
