"""Options and arguments that several commands have, declared once."""

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext, suppress
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


def seed_option(words: str) -> Any:
    """Return the option ``--seed`` with `words` as its help."""
    return typer.Option("--seed", min=0, max=2**63 - 1, help=words)


def output_option(words: str) -> Any:
    """Return the option ``--output`` with `words` as its help."""
    return typer.Option("--output", "-o", metavar="FILE", help=words)


Bench_ = Annotated[
    Path | None,
    typer.Option("--bench", metavar="FILE", help="Bench file; without it the embedded simulated paper bench."),
]
Json_ = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
Run_ = Annotated[
    str,
    typer.Argument(
        metavar="RUN", autocompletion=run_names, help="Name of the run, its beginning or end, 'last', or its directory."
    ),
]
Runs_ = Annotated[Path, typer.Option("--runs", metavar="DIR", help="Where the records are.")]
Devices_ = Annotated[Path, typer.Option("--devices", metavar="DIR", help="Where the devices are.")]
Seed_ = Annotated[int | None, seed_option("Seed of a simulated bench; the same seed gives the same results.")]
Speed_ = Annotated[
    str | None,
    typer.Option("--speed", metavar="X|max", help="Simulated benches only: times real time, or max, the default."),
]
Quiet_ = Annotated[bool, typer.Option("--quiet", help="Show no progress.")]
Plain_ = Annotated[bool, typer.Option("--plain", help="Show progress as plain lines, as in logs, on a terminal too.")]
Page_ = Annotated[
    bool,
    typer.Option("--page", help="Show the run in a browser on this machine, where it can be stopped too (extra page)."),
]
Port_ = Annotated[
    int, typer.Option("--port", min=0, max=65535, help="Port of the page on this machine; 0 for any that is free.")
]
Yes_ = Annotated[
    bool,
    typer.Option(
        "--yes",
        help="Ask nothing: manual work on a real bench is done, programs that bench file or record name may run.",
    ),
]
Trace_ = Annotated[
    Path | None, typer.Option("--trace", metavar="FILE", help="Write every byte to and from the instruments to FILE.")
]
Library_ = Annotated[str, typer.Option("--library", help="PyVISA library; @vcfbench is simulated.")]
Tries_ = Annotated[
    list[str] | None,
    typer.Option("--try", metavar="RESOURCE", help="Ask this one too: a VISA resource, a port, socket://host:port."),
]
AnswerTime_ = Annotated[
    float, typer.Option("--timeout", metavar="S", min=0.01, max=60.0, help="Longest wait for each answer.")
]
ProbeSerial_ = Annotated[
    bool,
    typer.Option(
        "--probe-serial", help="Ask serial ports too. Check first what is on them: bytes can move an unknown device."
    ),
]


def tracing(path: Path | None) -> AbstractContextManager[None]:
    """Return the context in which opened connections are traced to `path`; None traces nothing."""
    return nullcontext() if path is None else traced(path)


def key_and_value(option: str, text: str, example: str) -> tuple[str, str]:
    """Return the sides of the first ``=`` of `text`, stripped; ConfigError without a key, or for no UTF-8."""
    key, equals, value = text.partition("=")
    if not (equals and key.strip() and is_utf8(text)):
        raise ConfigError(f"{option} {ascii(text)[1:-1]}: expected KEY=VALUE, as in {option} {example}")
    return key.strip(), value.strip()


def tags_of(given: Iterable[str]) -> dict[str, str]:
    """Return the values of each ``--tag``.

    Raises:
        ConfigError: one has no key or no value, or a key is given twice.
    """
    tags: dict[str, str] = {}
    for each in given:
        key, equals, value = (part.strip() for part in each.partition("="))
        if not (key and equals and value):
            raise ConfigError(f"--tag {each}: expected KEY=VALUE, as in --tag batch=7")
        if key in tags:
            raise ConfigError(f"--tag {each}: {key} is given twice")
        tags[key] = value
    return tags
