"""Optional libraries of an extra, imported at first use."""

from importlib import import_module
from typing import Any

from vcfbench.errors import ConfigError


def need(module: str, extra: str, what: str) -> Any:
    """Return the imported `module` of the extra `extra`; `what` names its use: ``an export to Parquet``.

    Raises:
        ConfigError: it is not installed; the hint says what to type.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        why = "which is not installed" if error.name == package else f"which cannot be imported: {error}"
        wanted = " ".join(f'"{each}"' for each in _libraries(extra)) or package
        raise ConfigError(f"{what} needs {package}, {why}", hint=f"pip install {wanted}") from error


def _libraries(extra: str) -> list[str]:
    """Return the libraries of an extra, as pip takes them; none of a source tree that was only put on the path.

    By its own name an extra would bring simrack along anew, from the clone that vcfbench was installed from.
    """
    from importlib.metadata import distributions  # noqa: PLC0415  # 80 ms with the next, where nothing may be missing

    from packaging.requirements import Requirement  # noqa: PLC0415

    found = next(iter(distributions(name="vcfbench")), None)
    return [
        f"{each.name}{each.specifier}"
        for each in map(Requirement, (found and found.requires) or ())
        if (marker := each.marker) and marker.evaluate({"extra": extra}) and not marker.evaluate({"extra": ""})
    ]
