"""Commands in processes of their own that need not load anything: they are forked from one that has it loaded.

A fresh interpreter spends most of a second on imports, and the tests start hundreds. What is under test is the same:
``main`` in a process with its own working directory, environment, standard streams and exit code. Tests of what
happens to standard streams, or of what is imported when, start an interpreter.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import pkgutil
import runpy
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from functools import cache
from subprocess import CompletedProcess
from typing import IO, TYPE_CHECKING, Any

import vcfbench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from multiprocessing.process import BaseProcess
    from pathlib import Path

FORKS = hasattr(os, "fork")
"""Windows does not fork: there every command is a fresh interpreter."""
THIRD_PARTIES = (
    *("matplotlib.figure", "matplotlib.backends.backend_svg", "numpy.random", "pydantic", "pytest", "pyvisa"),
    *("rich.live", "scipy.linalg", "scipy.special", "serial"),
)


@cache
def _context() -> Any:
    context: Any = multiprocessing.get_context("forkserver")
    ours = (module.name for module in pkgutil.walk_packages(vcfbench.__path__, "vcfbench."))
    context.set_forkserver_preload([__name__, *THIRD_PARTIES, *(name for name in ours if "__main__" not in name)])
    return context


def _become(words: Sequence[str], folder: str, environment: Mapping[str, str], streams: tuple[Any, Any]) -> None:
    """Be ``vcfbench`` or ``python FILE`` in a new process."""
    gc.freeze()  # what was loaded before need not be looked at again and again
    for number, stream in enumerate(streams, start=1):
        os.dup2(stream.detach(), number)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = list(words)
    if words[0] == "python":
        sys.argv = sys.argv[1:]
        sys.path.insert(0, folder)
        runpy.run_path(words[1], run_name="__main__")
        return
    from vcfbench.cli.main import main  # noqa: PLC0415  # as a fresh process would

    main()


def _process(words: Sequence[str], folder: Path, streams: tuple[int, int]) -> BaseProcess:
    described = {**os.environ, "PYTHONUTF8": "1"}
    process: BaseProcess = _context().Process(
        target=_become, args=(words, str(folder), described, tuple(_Sent(stream) for stream in streams))
    )
    process.start()
    return process


class _Sent:
    """A file number that reaches the new process."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __reduce__(self) -> tuple[Any, ...]:
        from multiprocessing.reduction import DupFd  # noqa: PLC0415  # Windows has none

        return (_received, (DupFd(self.number),))


def _received(sent: Any) -> Any:
    return sent


def run(words: Sequence[str], folder: Path, timeout_s: float = 120.0) -> CompletedProcess[str]:
    """Run ``vcfbench ...`` or ``python FILE`` in `folder` to its end."""
    if not FORKS:
        command, environment = _fresh(words)
        return subprocess.run(  # noqa: S603 - our own commands
            command, cwd=folder, env=environment, capture_output=True, encoding="utf-8", timeout=timeout_s, check=False
        )
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = _process(words, folder, (out.fileno(), err.fileno()))
        process.join(timeout_s)
        if process.exitcode is None:
            process.kill()
            process.join()
        out.seek(0)
        err.seek(0)
        return CompletedProcess(list(words), process.exitcode or 0, out.read().decode(), err.read().decode())


@contextmanager
def running(words: Sequence[str], folder: Path) -> Iterator[tuple[Callable[[float], int | None], IO[str]]]:
    """Start ``vcfbench ...`` in `folder`: what waits for its exit code, and what it prints. It is ended when left."""
    if not FORKS:
        with _fresh_running(words, folder) as given:
            yield given
        return
    reading, writing = os.pipe()
    with open(reading, encoding="utf-8") as printed:  # noqa: PTH123  # a pipe has no path
        process = _process(words, folder, (writing, 2))
        os.close(writing)

        def wait(timeout_s: float) -> int | None:
            process.join(timeout_s)
            return process.exitcode

        try:
            yield wait, printed
        finally:
            process.terminate()
            if wait(10.0) is None:
                process.kill()
                process.join()


def _fresh(words: Sequence[str]) -> tuple[list[str], Mapping[str, str]]:
    program = {"vcfbench": [sys.executable, "-m", "vcfbench"], "python": [sys.executable]}[words[0]]
    return [*program, *words[1:]], {**os.environ, "PYTHONUTF8": "1"}


@contextmanager
def _fresh_running(words: Sequence[str], folder: Path) -> Iterator[tuple[Callable[[float], int | None], IO[str]]]:
    command, environment = _fresh(words)
    with subprocess.Popen(  # noqa: S603 - our own commands
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, encoding="utf-8"
    ) as process:
        assert process.stdout is not None
        try:
            yield process.wait, process.stdout
        finally:
            process.kill()
