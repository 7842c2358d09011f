"""Loads custom procedures from files; reports errors in their code with file and line."""

import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from vcfbench.errors import BenchError, ConfigError, PlanError
from vcfbench.files import read_text, shown
from vcfbench.instructions.procedure import AnyProcedure, Procedure

_OURS = str(Path(__file__).parents[1])
_ARGUMENTS = str(Path(__file__).parents[1] / "arguments.py")
"""An error that is raised there is one of the code that calls."""


def procedure_in(path: Path | str, origin: Callable[[str], str]) -> AnyProcedure:
    """Return the procedure that the file at `path` defines: the one `Procedure` among its names, imported ones apart.

    `origin` says where the procedure of a name comes from, "" where none is known by it. ConfigError: the file cannot
    be read or run, or defines none, more than one, or one of a name that is known.
    """
    source = read_text(path, "a procedure's file")
    name = str(Path(path).resolve())
    module = ModuleType(name)
    module.__file__ = name
    sys.modules[name] = module  # classes look up in their module what their annotations mean
    try:
        exec(compile(source, name, "exec"), vars(module))  # noqa: S102  # the user's own file, which is to be run
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise ConfigError(f"{shown(path)} cannot be run: {mistake_in(error)}") from error
    found: list[AnyProcedure] = []
    for each in vars(module).values():
        if isinstance(each, Procedure) and each not in found:
            found.append(each)
    own = [each for each in found if not origin(each.name)]
    if len(own) == 1:
        return own[0]
    if found and not own:
        known = found[0].name
        raise ConfigError(f"{shown(path)}: its procedure is called {known!r}, a name taken by {origin(known)}")
    came = f"{len(own)}: {', '.join(each.name for each in own)}" if own else "none"
    raise ConfigError(f"{shown(path)}: expected a file with one Procedure, got {came}")


def file_of(procedure: AnyProcedure) -> dict[str, str] | None:
    """Return the file of a procedure's plan and its SHA-256; None if it is not in a file."""
    from hashlib import sha256  # noqa: PLC0415  # few procedures are custom ones

    code = getattr(procedure.plan, "__code__", None)
    path = None if code is None else Path(code.co_filename)
    if path is None or not path.is_file():
        return None
    return {"path": str(path), "sha256": sha256(path.read_bytes()).hexdigest()}


def is_own(procedure: AnyProcedure) -> bool:
    """Return True if the code of a procedure is somebody's own."""
    code = getattr(procedure.plan, "__code__", None)
    return code is not None and not code.co_filename.startswith(_OURS)


def mistake_in(error: BaseException) -> str:
    """Describe `error`, of code that is not ours, with the innermost file and line of such code."""
    if isinstance(error, SyntaxError) and error.filename is not None:
        return f"{shown(error.filename)}, line {error.lineno}: {_words(error)}"
    places = [(file, line) for file, line in _places(error) if not file.startswith((_OURS, "<"))]
    return f"{shown(places[-1][0])}, line {places[-1][1]}: {_words(error)}" if places else _words(error)


def mistake_of(procedure: AnyProcedure, error: BaseException) -> PlanError | None:
    """Return `error` as a PlanError if it is a mistake in the code of `procedure`; None for any other."""
    parts = (procedure.plan, procedure.results, *vars(procedure.settings).values())
    files = {code.co_filename for part in parts if (code := getattr(part, "__code__", None)) is not None}
    through = _places(error)
    places = [(file, line) for file, line in through if file in files and not file.startswith(_OURS)]
    of_bench = isinstance(error, BenchError) and not through[-1][0].startswith(_ARGUMENTS)
    if of_bench or not isinstance(error, Exception) or not places:
        return None
    file, line = places[-1]
    return PlanError(f"the procedure {procedure.name!r} has a mistake: {shown(file)}, line {line}: {_words(error)}")


def _places(error: BaseException) -> list[tuple[str, int]]:
    """Return file and line of every frame that `error` came through, the innermost last."""
    return [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)]


def _words(error: BaseException) -> str:
    text = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
