"""vcfbench: calibrates MEMS vibratory gyroscopes on a rate table and by a virtual Coriolis force.

``vcfbench.run("virtual-coriolis", "station.toml")`` is ``vcfbench run virtual-coriolis --bench station.toml``. What is
public is in ``__all__``; each name is imported when it is first used, so that ``import vcfbench`` costs nothing.
"""

TYPE_CHECKING = False  # type checkers take it for True; importing it costs as much as all the rest
if TYPE_CHECKING:
    from vcfbench.analysis.allan import AllanPoint, allan_deviation
    from vcfbench.analysis.column import CalibrationColumn, Nonlinearity, Quantity
    from vcfbench.analysis.scale_factor import Comparison, ScaleFactorResult, characterise, compare
    from vcfbench.archive.analyzed import TableAnalysis, analyze
    from vcfbench.archive.compared import RunComparison, compare_runs
    from vcfbench.archive.export import Exported, export_run
    from vcfbench.archive.listing import run_summaries
    from vcfbench.archive.recorded import list_runs, load_run
    from vcfbench.archive.run import RawReading, Run
    from vcfbench.archive.summary import RunSummary
    from vcfbench.archive.written import write_certificate, write_report
    from vcfbench.bench.bench import Bench, open_bench
    from vcfbench.bench.make_safe import MadeSafe, safe_bench
    from vcfbench.clock import Clock, Deadline, PacedClock, ScaledClock, VirtualClock, WallClock, sleep
    from vcfbench.errors import (
        Aborted,
        BenchError,
        ConfigError,
        ConnectFailed,
        DeadlineExceeded,
        FramingError,
        InstrumentError,
        InterlockError,
        LimitError,
        LinkLost,
        MeasurementError,
        NotSafe,
        OutOfSync,
        PlanError,
        SelfTestFailed,
        TransportError,
        WrongInstrument,
    )
    from vcfbench.interfaces import (
        BeginsReadings,
        CapturesWaveforms,
        FunctionGenerator,
        Identity,
        Instrument,
        MeasuresWaveforms,
        Multimeter,
        Oscilloscope,
        PowersRails,
        PowerSupply,
        RateTable,
        ReadsVoltage,
        Regulation,
        Rotates,
        SafeReport,
        SamplesVoltage,
        SetsSine,
        SetsVoltage,
        SwitchesOutput,
        Waveform,
    )
    from vcfbench.procedures.bench_file import load_bench
    from vcfbench.procedures.catalogue import PROCEDURES
    from vcfbench.procedures.procedure import Procedure
    from vcfbench.procedures.shared.routines import energised, go_to_rate, powered, ramp_to, set_v_vc, take, v_vc_on
    from vcfbench.procedures.turntable import TurntableResult
    from vcfbench.procedures.virtual_coriolis.results import VirtualCoriolisResult
    from vcfbench.records.devices import Device, load_device
    from vcfbench.records.metadata import Equipment, RunMetadata
    from vcfbench.records.schema import Point, Status
    from vcfbench.reports.document import Axis, Cell, Column, Figure, Heading, Notice, Report, Series, Table, Text
    from vcfbench.reports.text import text_of
    from vcfbench.runs.asked import DryRun, dry_run
    from vcfbench.runs.conduct import run
    from vcfbench.runs.resumed import resume
    from vcfbench.runs.started import StartedRun, start
    from vcfbench.safety.control import RunControl, RunState
    from vcfbench.station.acceptance import Acceptance, Verdict
    from vcfbench.station.description import BenchDescription
    from vcfbench.station.limits import LimitChecks
    from vcfbench.station.settings import ProcedureSettings
    from vcfbench.steps import Note, Settle
    from vcfbench.steps.dry_run import PlannedStep
    from vcfbench.steps.executor import (
        Event,
        Observer,
        Paused,
        ReadingTaken,
        StepFailed,
        StepFinished,
        StepStarted,
        WentOn,
    )
    from vcfbench.steps.measured import Measured
    from vcfbench.steps.step import Context, Outcome, Plan, Routine, Step, StepResult
    from vcfbench.studies.conduct import study
    from vcfbench.studies.result import StudyResult, load_study

__version__: str
"""Version of the installed package: the tag's, or one after it; ``0+unknown`` where none is installed."""

__all__ = [
    "PROCEDURES",
    "Aborted",
    "Acceptance",
    "AllanPoint",
    "Axis",
    "BeginsReadings",
    "Bench",
    "BenchDescription",
    "BenchError",
    "CalibrationColumn",
    "CapturesWaveforms",
    "Cell",
    "Clock",
    "Column",
    "Comparison",
    "ConfigError",
    "ConnectFailed",
    "Context",
    "Deadline",
    "DeadlineExceeded",
    "Device",
    "DryRun",
    "Equipment",
    "Event",
    "Exported",
    "Figure",
    "FramingError",
    "FunctionGenerator",
    "Heading",
    "Identity",
    "Instrument",
    "InstrumentError",
    "InterlockError",
    "LimitChecks",
    "LimitError",
    "LinkLost",
    "MadeSafe",
    "Measured",
    "MeasurementError",
    "MeasuresWaveforms",
    "Multimeter",
    "Nonlinearity",
    "NotSafe",
    "Note",
    "Notice",
    "Observer",
    "Oscilloscope",
    "OutOfSync",
    "Outcome",
    "PacedClock",
    "Paused",
    "Plan",
    "PlanError",
    "PlannedStep",
    "Point",
    "PowerSupply",
    "PowersRails",
    "Procedure",
    "ProcedureSettings",
    "Quantity",
    "RateTable",
    "RawReading",
    "ReadingTaken",
    "ReadsVoltage",
    "Regulation",
    "Report",
    "Rotates",
    "Routine",
    "Run",
    "RunComparison",
    "RunControl",
    "RunMetadata",
    "RunState",
    "RunSummary",
    "SafeReport",
    "SamplesVoltage",
    "ScaleFactorResult",
    "ScaledClock",
    "SelfTestFailed",
    "Series",
    "SetsSine",
    "SetsVoltage",
    "Settle",
    "StartedRun",
    "Status",
    "Step",
    "StepFailed",
    "StepFinished",
    "StepResult",
    "StepStarted",
    "StudyResult",
    "SwitchesOutput",
    "Table",
    "TableAnalysis",
    "Text",
    "TransportError",
    "TurntableResult",
    "Verdict",
    "VirtualClock",
    "VirtualCoriolisResult",
    "WallClock",
    "Waveform",
    "WentOn",
    "WrongInstrument",
    "__version__",
    "allan_deviation",
    "analyze",
    "characterise",
    "compare",
    "compare_runs",
    "dry_run",
    "energised",
    "export_run",
    "go_to_rate",
    "list_runs",
    "load_bench",
    "load_device",
    "load_run",
    "load_study",
    "open_bench",
    "powered",
    "ramp_to",
    "resume",
    "run",
    "run_summaries",
    "safe_bench",
    "set_v_vc",
    "sleep",
    "start",
    "study",
    "take",
    "text_of",
    "v_vc_on",
    "write_certificate",
    "write_report",
]

_HOMES = {
    "runs.started": (
        "StartedRun",
        "start",
    ),
    "station.limits": ("LimitChecks",),
    "safety.control": (
        "RunControl",
        "RunState",
    ),
    "analysis.allan": (
        "AllanPoint",
        "allan_deviation",
    ),
    "analysis.column": (
        "CalibrationColumn",
        "Nonlinearity",
        "Quantity",
    ),
    "analysis.scale_factor": (
        "Comparison",
        "ScaleFactorResult",
        "characterise",
        "compare",
    ),
    "bench.bench": (
        "Bench",
        "open_bench",
    ),
    "station.description": ("BenchDescription",),
    "procedures.bench_file": ("load_bench",),
    "bench.make_safe": (
        "MadeSafe",
        "safe_bench",
    ),
    "clock": (
        "Clock",
        "Deadline",
        "PacedClock",
        "ScaledClock",
        "VirtualClock",
        "WallClock",
        "sleep",
    ),
    "errors": (
        "Aborted",
        "BenchError",
        "ConfigError",
        "ConnectFailed",
        "DeadlineExceeded",
        "FramingError",
        "InstrumentError",
        "InterlockError",
        "LimitError",
        "LinkLost",
        "MeasurementError",
        "NotSafe",
        "OutOfSync",
        "PlanError",
        "SelfTestFailed",
        "TransportError",
        "WrongInstrument",
    ),
    "interfaces": (
        "BeginsReadings",
        "CapturesWaveforms",
        "FunctionGenerator",
        "Identity",
        "Instrument",
        "MeasuresWaveforms",
        "Multimeter",
        "Oscilloscope",
        "PowersRails",
        "PowerSupply",
        "RateTable",
        "ReadsVoltage",
        "Regulation",
        "Rotates",
        "SafeReport",
        "SamplesVoltage",
        "SetsSine",
        "SetsVoltage",
        "SwitchesOutput",
        "Waveform",
    ),
    "station.acceptance": (
        "Acceptance",
        "Verdict",
    ),
    "procedures.catalogue": ("PROCEDURES",),
    "steps.dry_run": ("PlannedStep",),
    "steps.executor": (
        "Event",
        "Observer",
        "Paused",
        "ReadingTaken",
        "StepFailed",
        "StepFinished",
        "StepStarted",
        "WentOn",
    ),
    "steps.measured": ("Measured",),
    "procedures.procedure": ("Procedure",),
    "procedures.shared.routines": (
        "energised",
        "go_to_rate",
        "powered",
        "ramp_to",
        "set_v_vc",
        "take",
        "v_vc_on",
    ),
    "procedures.turntable": ("TurntableResult",),
    "procedures.virtual_coriolis.results": ("VirtualCoriolisResult",),
    "station.settings": ("ProcedureSettings",),
    "steps.step": (
        "Context",
        "Outcome",
        "Plan",
        "Routine",
        "Step",
        "StepResult",
    ),
    "steps": (
        "Note",
        "Settle",
    ),
    "records.devices": (
        "Device",
        "load_device",
    ),
    "records.metadata": (
        "Equipment",
        "RunMetadata",
    ),
    "records.schema": (
        "Point",
        "Status",
    ),
    "reports.document": (
        "Axis",
        "Cell",
        "Column",
        "Figure",
        "Heading",
        "Notice",
        "Report",
        "Series",
        "Table",
        "Text",
    ),
    "reports.text": ("text_of",),
    "archive.analyzed": (
        "TableAnalysis",
        "analyze",
    ),
    "runs.asked": (
        "DryRun",
        "dry_run",
    ),
    "archive.compared": (
        "RunComparison",
        "compare_runs",
    ),
    "runs.conduct": ("run",),
    "archive.export": (
        "Exported",
        "export_run",
    ),
    "archive.recorded": (
        "list_runs",
        "load_run",
    ),
    "runs.resumed": ("resume",),
    "archive.run": (
        "RawReading",
        "Run",
    ),
    "archive.listing": ("run_summaries",),
    "archive.summary": ("RunSummary",),
    "archive.written": (
        "write_certificate",
        "write_report",
    ),
    "studies.conduct": ("study",),
    "studies.result": (
        "StudyResult",
        "load_study",
    ),
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562)."""
    from importlib import import_module  # noqa: PLC0415  # a public name of its own at the top

    if name == "__version__":
        return import_module("vcfbench.version").installed_version()
    for home, names in _HOMES.items():
        if name in names:
            value: object = getattr(import_module(f"vcfbench.{home}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module 'vcfbench' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


del TYPE_CHECKING
