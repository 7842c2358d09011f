"""Notice of a run's outcome to a program that the bench file names: ``[notify]``."""

import json
import os
import signal
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from vcfbench.archive.run import Run
from vcfbench.errors import Aborted, NotSafe
from vcfbench.station.description import Notify
from vcfbench.typed import typed

_FAILED = 1


def outcome_of(run: Run) -> dict[str, Any]:
    """Return the notice of a run: its outcome in one word, and the error that ended it."""
    error, verdict = run.error, run.verdict
    failed = _FAILED if verdict is not None and not verdict.passed else 0
    return {
        "outcome": outcome_word(error),
        "exit_code": failed if error is None else error.exit_code,
        "error": None if error is None else str(error),
        "verdict": None if verdict is None else verdict.word,
        "run": run.name,
        "directory": None if run.directory is None else str(run.directory.resolve()),
        "procedure": run.procedure,
        "bench": run.bench,
        "simulated": run.simulated,
        "status": run.status.value,
        "dut": run.metadata.dut,
        "bench_seconds": run.bench_seconds,
        "pauses": list(run.pauses),
    }


def outcome_word(error: BaseException | None) -> str:
    """Return the outcome of a run that ended by `error`, or without one."""
    match error:
        case None:
            return "complete"
        case NotSafe():
            return "NOT SAFE"
        case Aborted():
            return "stopped"
    return "failed"


def notify(notice: Notify, outcome: Mapping[str, Any]) -> str | None:
    """Run the program of `notice` without a shell, `outcome` on its input as JSON; return its failure, in words.

    It and what it has started are ended when it takes longer than it may; nothing is raised.
    """
    name = notice.command[0]
    try:
        process = subprocess.Popen(  # noqa: S603  # the bench file names it, and docs say that it is a program
            notice.command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        return f"{name} could not be started: {getattr(error, 'strerror', None) or error}"
    try:
        process.communicate(json.dumps(outcome).encode() + b"\n", timeout=notice.timeout_s)
    except subprocess.TimeoutExpired:
        _end(process)
        return f"{name} took longer than {notice.timeout_s:g} s and was ended"
    except BaseException:
        _end(process)
        raise
    return None if process.returncode == 0 else f"{name} ended with code {process.returncode}"


def notify_in_place_of(directory: Path | None, bench: Mapping[str, Any], error: str, code: int | None) -> None:
    """Notify of the end of a run whose program has died; `bench` is from its header.

    `directory` is that of the record, `code` that of NotSafe where the bench is not safe.
    """
    outcome = {
        "outcome": "NOT SAFE" if code else "failed",
        "exit_code": code,
        "error": error,
        "run": None if directory is None else directory.name,
        "directory": None if directory is None else str(directory),
        "bench": bench.get("name"),
    }
    notify(typed(bench["notify"], Notify), outcome)


def _end(process: subprocess.Popen[bytes]) -> None:
    if hasattr(os, "killpg"):
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()
