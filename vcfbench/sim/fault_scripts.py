"""Fault scripts in files that a user names."""

from pathlib import Path

from simrack.faults import FaultScript, script_of

from vcfbench.errors import ConfigError
from vcfbench.files import parse_toml, read_text, shown


def parse_script(text: str, source: str) -> FaultScript:
    """Return the script that the TOML `text` describes; `source` names it in errors (ConfigError)."""
    table = parse_toml(text, source)
    try:
        return script_of(table)
    except ValueError as error:
        raise ConfigError(f"{source}: {error}") from None


def read_script(path: Path) -> FaultScript:
    """Return the script in a file.

    Raises:
        ConfigError: it cannot be read, is not TOML, or an entry is no fault; the words say which.
    """
    return parse_script(read_text(path, "a fault script"), shown(path))
