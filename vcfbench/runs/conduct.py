"""Conducts a run: from the bench file through the open bench to the record, which is closed however the run ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any, Final

from msgspec.structs import replace

from vcfbench.archive.run import Run
from vcfbench.bench.bench import open_bench
from vcfbench.clock import today
from vcfbench.drivers.together import Outputs
from vcfbench.errors import Aborted, BenchError, ConfigError, NotSafe
from vcfbench.files import shown
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.interfaces import Operator
from vcfbench.procedures.layers import asked_in_python
from vcfbench.records.metadata import RunMetadata, metadata_of
from vcfbench.reports.shielded import Shielded
from vcfbench.runs.needs import roles_of
from vcfbench.runs.request import Prepared, Preparing, Request
from vcfbench.runs.several import device_runs
from vcfbench.runs.under_way import UnderWay
from vcfbench.safety.control import RunControl
from vcfbench.safety.roles import needed_roles
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.trust import Trust, require_library
from vcfbench.station.description import BenchDescription
from vcfbench.station.equipment import equipment_on, overdue_words
from vcfbench.steps.events import Observer

_PREPARING: Final = Lock()
"""Lock of the first loading of numpy and msgspec's types, which fails where two threads do it at once."""


def run(
    procedure: str | Path | AnyProcedure,
    bench: BenchDescription | Path | str | None = None,
    *,
    seed: int | None = None,
    settings: Mapping[str, Any] | None = None,
    observers: Sequence[Observer] = (),
    runs: str | Path | None = "runs",
    speed: str | float | None = None,
    operator: Operator | None = None,
    metadata: Mapping[str, Any] | RunMetadata | None = None,
    control: RunControl | None = None,
    trust: Trust = False,
) -> Run:
    """Run `procedure` on `bench`, record it, make the bench safe, and return its outcome.

    SIGINT and SIGTERM stop the run as they do the command: the first at its next wait, the second at once.

    Args:
        procedure: its name, the file that defines it (``"./hysteresis.py"``), or the procedure itself.
        bench: a bench file, the name of an embedded bench, or a description; None is the simulated paper bench.
        seed: of a simulated bench; None is that of the bench file. The same seed gives the same results.
        settings: of the procedure, in place of those of the bench file and checked as they are there:
            ``{"samples": 20, "drive": {"start_up_s": 8.0}}``.
        observers: get every event (``handle(event)``). One that raises is left out from then on; the run goes
            on, and :attr:`Run.observers_lost` says so.
        runs: directory of the records; this run gets one of its own in it. None keeps no record, on a simulated bench.
        speed: of a simulated bench, times real time, or ``"max"``, the default.
        operator: is called with what only hands can do (a ``Request``: words, seconds) and returns when it is done,
            with words for the record. On a simulated bench None does it to the simulated world.
        metadata: what the record says of the run beside what is measured, each key of :class:`RunMetadata`:
            ``{"dut": "G-0042", "operator": "A. Person", "tags": {"batch": "7"}}``. A procedure that goes by what is
            known of a device goes by what is known of this one.
        control: what stops the run from another thread, has it pause and lets it go on; :func:`vcfbench.start` runs
            in a thread and returns one.
        trust: whether a program that the bench file names may run (`visa_library`, where it is a file); or who is
            asked, with its path and SHA-256 in words. The environment variable ``VCFBENCH_TRUST`` allows single ones.

    Raises:
        BenchError: the run did not come to its end. The error's `run` holds what was measured, which is recorded too.
        NotSafe: something could not be made safe; whatever else went wrong is in its words.

    >>> quick = {"rates_deg_s": [10, 0, -10], "samples": 3}
    >>> run = vcfbench.run("turntable", seed=3, settings=quick, metadata={"dut": "G-0042"})
    >>> print(run.status, run.values["scale_factor"])
    complete -12.5630(29) mV/(deg/s)
    """
    if runs is not None and not str(runs).strip():
        raise ConfigError("runs: expected a directory, got an empty name")
    with _PREPARING:
        asked_settings = asked_in_python(settings or {})
        said = metadata_of(metadata)
    words = shown(bench) if isinstance(bench, Path | str) else bench and str(getattr(bench, "name", bench))
    kept = None if runs is None else shown(runs)
    request = Request(
        *(procedure, bench, seed, asked_settings, None if runs is None else Path(runs), speed, observers),
        operator=operator,
        options={"bench": words, "seed": seed, "runs": kept, "speed": speed, "settings": dict(settings or {})},
        metadata=said,
        control=control,
        trust=trust,
    )
    with StopSignals() as signals:
        return conduct(request, signals)


def conduct(request: Request, signals: StopSignals, preparing: Preparing = Prepared) -> Run:
    """Perform `request`, made ready by `preparing`, while `signals` are watched; see :func:`run`."""
    under_way = UnderWay(preparing(request))
    control = nullcontext() if request.control is None else request.control.of_run(signals)
    try:
        with control:
            _perform(under_way, signals)
    except BenchError as error:
        under_way.take_error(_as_bench_error(error))
    except BaseException as error:
        under_way.notify()
        if isinstance(under_way.error, NotSafe):  # nothing comes before it: not a disk, not a mistake of ours
            raise under_way.error from error
        raise
    under_way.notify()
    done = under_way.as_run()
    if under_way.prepared.devices:
        done = replace(done, devices=device_runs(under_way))
    if under_way.error is not None:
        under_way.error.run = done
        raise under_way.error
    return done


def _perform(under_way: UnderWay, signals: StopSignals) -> None:
    """Open the bench, perform the plan, make all safe, and only then close the record."""
    prepared, request = under_way.prepared, under_way.prepared.request
    with _PREPARING:
        prepared.make_ready()
        description = prepared.description
        require_library(description, request.trust)
        prepared.require_operator()
        if description.simulated:  # parts that numpy loads at their first use, which fails in two threads at once
            for part in ("fft", "ma", "polynomial", "random"):
                import_module(f"numpy.{part}")
    needs = roles_of(prepared.procedure, description)
    opened_roles = [each.name for each in needed_roles(description, needs)]
    for words in prepared.left_out():
        request.warn(words)
    for words in overdue_words(equipment_on(today(), description, opened_roles, {})):
        request.warn(words)
    under_way.observers = {
        f"{number} ({type(each).__name__})": Shielded(partial[AbstractContextManager[Observer]](nullcontext, each))
        for number, each in enumerate(request.observers, start=1)
    }
    under_way.begin_record()
    display = Shielded(partial(request.display, prepared))
    try:
        with ExitStack() as watching:
            watchers = [watching.enter_context(each) for each in (display, *under_way.observers.values())]
            opened = open_bench(
                description,
                seed=prepared.seed,
                speed=request.speed,
                signals=signals,
                build=request.build,
                needs=needs,
                now_s=prepared.now_s(),
                trust=True,  # it was asked for
                operator=request.operator or request.person,
            )
            bench = watching.enter_context(opened)
            for each in sorted(set(bench.left_by.values())):
                request.warn(f"{each} died with this bench, which stayed live; its table stands now")
            if isinstance(outputs := bench.instruments.get("multimeter"), Outputs):
                for name, error in outputs.missing.items():
                    words = f"{name} cannot be read: its measurement ends, the others go on"
                    request.warn(f"{words}: {error}")
            under_way.perform(bench, watchers, signals)
    except BaseException as error:
        under_way.take_error(_as_bench_error(error))
        if not isinstance(error, BenchError | KeyboardInterrupt | OSError | ImportError):
            raise  # a mistake of ours; the record is closed all the same
    finally:
        signals.close()
        under_way.close(display.lost)


def _as_bench_error(error: BaseException) -> BenchError:
    """Return `error` as a BenchError for the record."""
    match error:
        case BenchError():
            return Aborted.behind(error) or error
        case KeyboardInterrupt():
            return Aborted("stopped by the operator")
        case OSError() | ImportError():  # files, memory, a package that was changed meanwhile
            failed = BenchError(f"this computer ended the run: {type(error).__name__}: {error}")
            failed.__cause__ = error
            return failed
    return BenchError(f"the program has a mistake: {type(error).__name__}: {error}")
