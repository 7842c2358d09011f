"""Run in an environment with keyoscacquire and oscope-scpi: what they do with an oscilloscope, method by method."""

# ruff: noqa: FBT003  # expected values are positional

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import keyoscacquire
from oscope_scpi.dso import DSOX
from walking import Walk, no_pauses, same


def acquisitions(walk: Walk, scope: Any) -> None:
    for form, kind in (
        ("BYTE", "NORMal"),
        ("WORD", "NORMal"),
        ("ASCii", "NORMal"),
        ("WORD", "HRESolution"),
        ("WORD", "AVER4"),
    ):
        for mode, points in (("NORM", 1000), *([("RAW", 100_000)] if "AVER" not in kind else [])):
            name = f"set_options_get_trace {form} {kind} {mode}"
            walk.do(
                name,
                lambda form=form, kind=kind, mode=mode, points=points: same(
                    scope.set_options_get_trace(
                        channels=[1, 2], wav_format=form, acq_type=kind, num_points=points, p_mode=mode
                    )[1].shape,
                    (points, 2),
                ),
            )
    for name in ("active_channels", "acq_type", "num_averages", "p_mode", "num_points", "wav_format", "timeout"):
        walk.do(name, lambda name=name: getattr(scope, name))
    walk.do("get_trace of the active channels", scope.get_trace)
    walk.do("is_running", lambda: same(scope.is_running(), True))
    walk.do("stop", lambda: (scope.stop(), same(scope.is_running(), False)))
    walk.do("run", lambda: (scope.run(), same(scope.is_running(), True)))
    walk.do("get_error", lambda: same(scope.get_error(), '+0,"No error"'))
    walk.do("get_full_error_queue", lambda: scope.get_full_error_queue(verbose=False))
    walk.do("print_acq_settings", scope.print_acq_settings)
    walk.do("generate_file_header", scope.generate_file_header)


def keyoscacquire_all(resource: str) -> Walk:
    scope = keyoscacquire.Oscilloscope(address=resource, timeout=5000, verbose=False)
    walk = Walk(lambda question: str(scope._inst.query(question)))  # it has no public one
    acquisitions(walk, scope)
    return walk


MEASUREMENTS = (
    "CounterFrequency", "PosDutyCycle", "FallTime", "RiseTime", "Frequency", "NegPulseWidth", "Overshoot", "Preshoot",
    "PosPulseWidth", "Period", "VoltAmplitude", "VoltAverage", "VoltRMS", "VoltBase", "VoltTop", "VoltMax", "VoltMin",
    "VoltPP",
)  # fmt: skip


def oscope_scpi_all(resource: str) -> Walk:
    scope = DSOX(resource, maxChannel=4)
    scope.open()
    scope._versionLegacy = 9.999  # its own classes of older firmware say so: no {NUM|STR} after SYST:ERR?
    scope.checkInstErrors = lambda _command: False  # it would take the errors off the queue before the walk sees them
    walk = Walk(lambda question: str(scope._inst.query(question)), scope._inst.clear)
    walk.do("idn", lambda: same("DSO7104B" in scope.idn(), True))
    walk.do("reset", scope.reset)
    walk.do("setupAutoscale", lambda: scope.setupAutoscale(scope.chanAllValidList[0]))
    for name in ("modeRun", "modeSingle", "modeStop"):
        walk.do(name, getattr(scope, name))
    for name in ("outputOn", "isOutputOn", "outputOff", "outputOnAll", "outputOffAll"):
        walk.do(name, lambda name=name: getattr(scope, name)("1") if "All" not in name else getattr(scope, name)())
    scope.outputOn("1")
    walk.do("channelLabel", lambda: scope.channelLabel("SENSE", "1"))
    walk.do("channelLabelOff", scope.channelLabelOff)
    walk.do("annotate", lambda: scope.annotate("HELLO", "ch1"))
    walk.do("annotateOff", scope.annotateOff)
    for name in MEASUREMENTS:
        walk.do(f"measure{name}", lambda name=name: float(getattr(scope, f"measure{name}")("1")))
    walk.do("measureFrequency installed", lambda: scope.measureFrequency("1", install=True))
    walk.do("measureStatistics", scope.measureStatistics)
    scope._inst.timeout = 1_000
    for name in ("NegDutyCycle", "BitRate"):
        walk.do(f"measure{name}", lambda name=name: float(getattr(scope, f"measure{name}")("1")))
    walk.do("measureDVMdc", lambda: scope.measureDVMdc("1", timeout=1))
    folder = Path(tempfile.mkdtemp())
    walk.do("waveformData", lambda: same(len(scope.waveformData(scope.chanAllValidList[0], points=1000)[0]), 1000))
    walk.do(
        "waveform into CSV", lambda: scope.waveform(str(folder / "wave.csv"), scope.chanAllValidList[0], points=1000)
    )
    walk.do("hardcopy", lambda: scope.hardcopy(str(folder / "screen.png")))
    walk.do("setupSave", lambda: scope.setupSave(str(folder / "setup.stp")))
    walk.do("setupLoad", lambda: scope.setupLoad(str(folder / "setup.stp")))
    return walk


KINDS = {"keyoscacquire": keyoscacquire_all, "oscope_scpi": oscope_scpi_all}


def main() -> None:
    no_pauses()
    name, resource = sys.argv[1:]
    KINDS[name](resource).tell()


if __name__ == "__main__":
    main()
