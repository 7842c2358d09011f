"""Bench files that commands write: all of one or nothing, and never over another."""

from pathlib import Path
from tempfile import TemporaryFile

from vcfbench.errors import ConfigError
from vcfbench.files import failing_as


def require_free(path: Path) -> None:
    """Raise ConfigError where a file cannot be written anew."""
    if path.exists():
        raise ConfigError(f"{path} is there already, and is not written over")
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"{path}: there is no directory {path.resolve().parent}")
    with failing_as(ConfigError, f"{path}: cannot be written"), TemporaryFile(dir=path.resolve().parent):
        pass


def written_anew(path: Path, text: str) -> None:
    """Write a file, all of it or nothing, and only where none is.

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
