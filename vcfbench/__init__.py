"""vcfbench: calibrates MEMS vibratory gyroscopes on a rate table and by a virtual Coriolis force.

``vcfbench.run("virtual-coriolis", "station.toml")`` is ``vcfbench run virtual-coriolis --bench station.toml``. What is
public is in the stub beside this file; each name is imported when it is first used, so that ``import vcfbench`` costs
nothing.
"""

__version__: str
"""Version of the installed package: the tag's, or one after it; ``0+unknown`` where none is installed."""


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562)."""
    from importlib import import_module  # noqa: PLC0415  # a public name of its own at the top

    homes = import_module("vcfbench.faces").homes(__file__)
    if name == "__all__":
        value: object = sorted([*homes, "__version__"])
    elif name == "__version__":
        return import_module("vcfbench.version").installed_version()
    elif name in homes:
        value = getattr(import_module(homes[name]), name)
        if type(value).__name__ == "function":  # its arguments are held against their annotations
            value = import_module("vcfbench.arguments").checked(value)
    else:
        raise AttributeError(f"module 'vcfbench' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __getattr__("__all__")
