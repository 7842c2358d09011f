"""Options and arguments of several commands, declared once."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import wraps
from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated, Any

import typer

from vcfbench.drivers.trace import traced
from vcfbench.errors import ConfigError
from vcfbench.files import is_utf8


def run_names(ctx: Any, incomplete: str) -> list[str]:
    """Return the names of the runs in the directory of records that the command line names so far, the latest first.

    For a shell that completes: it never fails and says nothing, and where it cannot tell it offers nothing.
    """
    with suppress(Exception):
        values = (ctx.params.get(name) for name in ("directory", "runs"))  # of compare, `runs` are names
        directory = next((each for each in values if isinstance(each, Path)), Path("runs"))
        found = sorted((each.name for each in directory.iterdir() if (each / "journal.jsonl").is_file()), reverse=True)
        return [name for name in ["last", *found] if name.startswith(incomplete)]
    return []


def option(metavar: str | None, words: str, *names: str, **more: Any) -> Any:
    """Return an option with `words` as its help; without `names` it is called as its parameter is."""
    return typer.Option(*names, metavar=metavar, help=words, **more)


def flag(words: str, *names: str) -> Any:
    """Return an option that takes no value, with `words` as its help."""
    return typer.Option(*names, help=words)


def argument(metavar: str | None, words: str, **more: Any) -> Any:
    """Return an argument with `words` as its help."""
    return typer.Argument(metavar=metavar, help=words, **more)


def seed_option(words: str) -> Any:
    """Return the option ``--seed`` with `words` as its help."""
    return option(None, words, "--seed", min=0, max=2**63 - 1)


def output_option(words: str) -> Any:
    """Return the option ``--output`` with `words` as its help."""
    return option("FILE", words, "--output", "-o")


Bench_ = Annotated[Path | None, option("FILE", "Bench file; without it the embedded simulated paper bench.", "--bench")]
NewFile_ = Annotated[Path, argument("FILE", "Where the bench file goes. A file there is not overwritten.")]
Json_ = Annotated[bool, flag("Print one JSON object on stdout and nothing else there.", "--json")]
Run_ = Annotated[
    str, argument("RUN", "Name of the run, its beginning or end, 'last', or its directory.", autocompletion=run_names)
]
Runs_ = Annotated[Path, option("DIR", "Directory of the records.", "--runs")]
Devices_ = Annotated[Path, option("DIR", "Directory of the device history.", "--devices")]
DevicesOfPlan_ = Annotated[
    Path | None, option("DIR", "Directory of the device history; default: as in the settings.", "--devices")
]
Seed_ = Annotated[int | None, seed_option("Seed of a simulated bench; the same seed gives the same results.")]
Speed_ = Annotated[
    str | None, option("X|max", "Simulated benches only: multiple of real time, or max, the default.", "--speed")
]
Quiet_ = Annotated[bool, flag("Show no progress.", "--quiet")]
Verbose_ = Annotated[bool, flag("Print the whole report, not one screen.", "--verbose", "-v")]
Plain_ = Annotated[bool, flag("Show progress as plain lines, as in logs, on a terminal too.", "--plain")]
Page_ = Annotated[
    bool, flag("Show the run in a browser on this machine, where it can be stopped too (extra page).", "--page")
]
Port_ = Annotated[
    int, option(None, "Port of the page on this machine; 0 for any that is free.", "--port", min=0, max=65535)
]
Yes_ = Annotated[
    bool,
    flag(
        "No questions: manual work on a real bench counts as done, programs named by bench file or record may run.",
        "--yes",
    ),
]
Trace_ = Annotated[Path | None, option("FILE", "Write every byte to and from the instruments to FILE.", "--trace")]
Library_ = Annotated[str, option(None, "PyVISA library; @vcfbench is simulated.", "--library")]
Tries_ = Annotated[
    list[str] | None, option("RESOURCE", "Query this one too: a VISA resource, a port, socket://host:port.", "--try")
]
AnswerTime_ = Annotated[float, option("S", "Longest wait for each answer.", "--timeout", min=0.01, max=60.0)]
ProbeSerial_ = Annotated[
    bool,
    flag("Query serial ports too. Check first what is on them: bytes can move an unknown device.", "--probe-serial"),
]


def with_options(command: Callable[..., None], added: Mapping[str, Any], place: int | None = None) -> Any:
    """Return `command` with further options in place of its ``**`` parameter, None where they are not given.

    Args:
        command: the function of a command.
        added: annotations by name.
        place: number of own parameters before them; None is all.
    """
    signature = inspect.signature(command, eval_str=True)
    *own, _ = signature.parameters.values()
    kind = inspect.Parameter.KEYWORD_ONLY
    more = [inspect.Parameter(name, kind, default=None, annotation=each) for name, each in added.items()]
    parameters = [*own[:place], *more, *(() if place is None else own[place:])]

    @wraps(command)
    def bound(*arguments: Any, **named: Any) -> None:
        command(*arguments, **named)

    bound.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]  # typer asks for it
    bound.__annotations__ = {each.name: each.annotation for each in parameters}
    return bound


def tracing(path: Path | None) -> AbstractContextManager[None]:
    """Return the context in which opened connections are traced to `path`; without a path there is no trace."""
    return nullcontext() if path is None else traced(path)


def key_and_value(option: str, text: str, example: str) -> tuple[str, str]:
    """Return the sides of the first ``=`` of `text`, stripped; ConfigError without a key, or for no UTF-8."""
    key, equals, value = text.partition("=")
    if not (equals and key.strip() and is_utf8(text)):
        raise ConfigError(f"{option} {ascii(text)[1:-1]}: expected KEY=VALUE, as in {option} {example}")
    return key.strip(), value.strip()


def keys_and_values(option: str, given: Iterable[str], example: str) -> dict[str, str]:
    """Return the values of an option by their keys; ConfigError as `key_and_value`, or a key is given twice."""
    values: dict[str, str] = {}
    for each in given:
        key, value = key_and_value(option, each, example)
        if key in values:
            raise ConfigError(f"{option} {each}: {key} is given twice")
        values[key] = value
    return values


def tags_of(given: Iterable[str]) -> dict[str, str]:
    """Return the values of each ``--tag``; ConfigError: one has no key or no value, or a key is given twice."""
    tags = keys_and_values("--tag", given, "batch=7")
    if without := [key for key, value in tags.items() if not value]:
        raise ConfigError(f"--tag {without[0]}=: expected KEY=VALUE, as in --tag batch=7")
    return tags
