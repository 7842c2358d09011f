"""Questions at the terminal: each with its proposal, each answer checked at once."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import typer
from msgspec import Struct, field

from vcfbench.errors import BenchError, ConfigError

_T = TypeVar("_T")


class Interview(Struct):
    """Puts questions; `given` are answers by key that need no question, `silent` takes the proposals."""

    given: dict[str, str]
    silent: bool
    used: set[str] = field(default_factory=set)

    def ask(self, key: str, words: str, proposed: str, take: Callable[[str], _T]) -> _T:
        """Return the answer as `take` reads it; one that it refuses (BenchError) is asked for again.

        Raises:
            ConfigError: the answer was given beforehand, or proposed with nobody to ask, and is refused.
        """
        if key in self.given or self.silent:
            self.used.add(key)
            return take(self.given.get(key, proposed))
        while True:
            typer.echo(f"{words} [{proposed}]: " if proposed else f"{words}: ", err=True, nl=False)
            line = sys.stdin.readline()
            if not line:
                raise ConfigError(
                    "the answers ended before the questions; nothing was written", hint="--yes takes the proposals"
                )
            try:
                return take(line.strip() or proposed)
            except BenchError as error:
                typer.echo(f"  no: {error}", err=True)

    def free_file(self, path: Path) -> Path:
        """Return `path`, or another one that is asked for where a file is there already."""

        def take(answer: str) -> Path:
            if Path(answer).exists():
                raise ConfigError(f"{answer} is there already, and is not written over")
            if not Path(answer).resolve().parent.is_dir():
                raise ConfigError(f"{answer}: there is no directory {Path(answer).resolve().parent}")
            return Path(answer)

        try:
            return take(str(path))
        except ConfigError as error:
            if self.silent or "file" in self.given:
                raise
            typer.echo(str(error), err=True)
        others = (path.with_stem(f"{path.stem}-{number}") for number in range(2, 10_000))
        return self.ask("file", "Another file", str(next(each for each in others if not each.exists())), take)

    def require_all_used(self) -> None:
        """Raise ConfigError when an answer was given to a question that never came."""
        unused = sorted(set(self.given) - self.used)
        if unused:
            raise ConfigError(f"--set {unused[0]}: nothing is asked by that key on this bench")


def written_anew(path: Path, text: str) -> None:
    """Write a file, all of it or nothing, and only where none is.

    Raises:
        ConfigError: one is there by now, or it cannot be written.
    """
    try:
        out = path.open("x", encoding="utf-8", newline="\n")
    except FileExistsError:
        raise ConfigError(f"{path}: it is there by now, and is not written over") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        with out:
            out.write(text)
    except BaseException as error:
        path.unlink(missing_ok=True)  # it is ours, and not whole
        if isinstance(error, OSError):
            raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None
        raise
