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
from contextlib import contextmanager, suppress
from functools import cache
from subprocess import CompletedProcess, TimeoutExpired
from threading import Timer
from typing import TYPE_CHECKING, Any

import vcfbench

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
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


class Program:
    """A command that goes on in a forked process, for whoever knows :class:`subprocess.Popen`."""

    def __init__(self, process: BaseProcess, out: int, err: int | None) -> None:
        self._process = process
        self.pid = process.pid
        self.stdout = open(out, encoding="utf-8")  # noqa: SIM115  # a pipe has no path
        self.stderr = None if err is None else open(err, encoding="utf-8")  # noqa: PTH123, SIM115
        self.kill, self.terminate = process.kill, process.terminate

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise TimeoutExpired("a forked command", timeout or 0.0)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self.pid is not None and self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def communicate(self, timeout: float = 120.0) -> tuple[str, str]:
        ended = Timer(timeout, self.kill)  # else reading has no bound
        ended.start()
        try:
            said = self.stdout.read(), "" if self.stderr is None else self.stderr.read()
            self.wait()
        finally:
            ended.cancel()
        return said


@contextmanager
def running(words: Sequence[str], folder: Path, *, errors: bool = False) -> Iterator[Any]:
    """Start ``vcfbench ...`` in `folder`, with a pipe for its `errors` if asked; it is ended when left."""
    process: Program | subprocess.Popen[str]
    if FORKS:
        out, its_out = os.pipe()
        err, its_err = os.pipe() if errors else (None, 2)
        process = Program(_process(words, folder, (its_out, its_err)), out, err)
        for number in (its_out, its_err)[: 1 + errors]:
            os.close(number)
    else:
        command, environment = _fresh(words)
        process = subprocess.Popen(  # noqa: S603 - our own commands
            command,
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE if errors else None,
            encoding="utf-8",
        )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except TimeoutExpired:
            process.kill()
            process.wait()
        for stream in filter(None, (process.stdout, process.stderr)):
            stream.close()


def _fresh(words: Sequence[str]) -> tuple[list[str], Mapping[str, str]]:
    program = {"vcfbench": [sys.executable, "-m", "vcfbench"], "python": [sys.executable]}[words[0]]
    return [*program, *words[1:]], {**os.environ, "PYTHONUTF8": "1"}
