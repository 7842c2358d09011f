"""The steps that come with the project, a page for each instrument."""

from vcfbench.procedures.step import Effect, Outcome, Plan, Reading, Step, StepResult
from vcfbench.procedures.steps.chamber import (
    AwaitTemperature,
    SetTemperature,
    StopFlow,
    TemperatureReading,
    set_air_by_hand,
)
from vcfbench.procedures.steps.gapless import AcquireGapless
from vcfbench.procedures.steps.meter import Acquire, ConfigureMeter, VerifyZero, Window, ZeroWindow
from vcfbench.procedures.steps.operator import AskOperator, OperatorAnswer, move_leads
from vcfbench.procedures.steps.sampling import ModulatedRecord, SampleModulated, SampleSine, SineResponse
from vcfbench.procedures.steps.scope import (
    CaptureSines,
    ConfigureScope,
    DriveAmplitudes,
    DriveReading,
    FindDrive,
    MeasureDrive,
    ScopeReady,
    SineRecord,
    SineRecords,
)
from vcfbench.procedures.steps.source import ConfigureGenerator, DisableVvc, EnableVvc, SetSine, SetVvc, VvcSetting
from vcfbench.procedures.steps.supply import (
    CheckRails,
    ConfigureRail,
    DisableSupply,
    EnableSupply,
    RailReading,
    RailsReading,
)
from vcfbench.procedures.steps.table import AwaitRate, DisableTable, EnableTable, RateReading, SetRate
from vcfbench.procedures.steps.v_vc import (
    AcquireWithVvc,
    ConfigureVvcMeter,
    MeasureVvc,
    PairedReading,
    VvcMeasured,
    VvcWindow,
)
from vcfbench.procedures.steps.wait import Done, NotChecked, Note, Settle

__all__ = [
    "Acquire",
    "AcquireGapless",
    "AcquireWithVvc",
    "AskOperator",
    "AwaitRate",
    "AwaitTemperature",
    "CaptureSines",
    "CheckRails",
    "ConfigureGenerator",
    "ConfigureMeter",
    "ConfigureRail",
    "ConfigureScope",
    "ConfigureVvcMeter",
    "DisableSupply",
    "DisableTable",
    "DisableVvc",
    "Done",
    "DriveAmplitudes",
    "DriveReading",
    "Effect",
    "EnableSupply",
    "EnableTable",
    "EnableVvc",
    "FindDrive",
    "MeasureDrive",
    "MeasureVvc",
    "ModulatedRecord",
    "NotChecked",
    "Note",
    "OperatorAnswer",
    "Outcome",
    "PairedReading",
    "Plan",
    "RailReading",
    "RailsReading",
    "RateReading",
    "Reading",
    "SampleModulated",
    "SampleSine",
    "ScopeReady",
    "SetRate",
    "SetSine",
    "SetTemperature",
    "SetVvc",
    "Settle",
    "SineRecord",
    "SineRecords",
    "SineResponse",
    "Step",
    "StepResult",
    "StopFlow",
    "TemperatureReading",
    "VerifyZero",
    "VvcMeasured",
    "VvcSetting",
    "VvcWindow",
    "Window",
    "ZeroWindow",
    "move_leads",
    "set_air_by_hand",
]
