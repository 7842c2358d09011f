"""Bench files that commands write: complete or not at all, and never over another file."""

from pathlib import Path
from tempfile import TemporaryFile

from vcfbench.errors import ConfigError
from vcfbench.files import failing_as


def require_free(path: Path) -> None:
    """Raise ConfigError if a file exists or cannot be written."""
    if path.exists():
        raise ConfigError(f"{path} is there already, and is not written over")
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"{path}: the directory {path.resolve().parent} does not exist")
    with failing_as(ConfigError, f"{path}: cannot be written"), TemporaryFile(dir=path.resolve().parent):
        pass


def written_anew(path: Path, text: str) -> None:
    """Write a new file, complete or not at all; refuse to replace one.

    Raises:
        ConfigError: one is there by now, or it cannot be written.
    """
    with failing_as(ConfigError, f"{path}: cannot be written"), path.open("x", encoding="utf-8", newline="\n") as out:
        try:
            out.write(text)
            out.flush()
        except BaseException:
            path.unlink(missing_ok=True)  # it is ours, and not whole
            raise
