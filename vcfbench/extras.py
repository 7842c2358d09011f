"""Libraries that come with an extra, imported when something is asked for that needs them."""

from importlib import import_module
from typing import Any

from vcfbench.errors import ConfigError


def need(module: str, extra: str, what: str) -> Any:
    """Return the imported `module` of the extra `extra`, which is needed for `what`: ``an export to Parquet``.

    Raises:
        ConfigError: it is not installed; the hint says what to type.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        why = "which is not installed" if error.name == package else f"which cannot be imported: {error}"
        raise ConfigError(f"{what} needs {package}, {why}", hint=f"pip install 'vcfbench[{extra}]'") from error
