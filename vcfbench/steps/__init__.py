"""The steps that come with the project, a page for each instrument."""

from vcfbench.steps.chamber import AwaitTemperature, SetTemperature, StopFlow, TemperatureReading, set_air_by_hand
from vcfbench.steps.drive_again import MeasureDriveAgain
from vcfbench.steps.each import DeviceEnded, EachOf, EachResult
from vcfbench.steps.meter import (
    Acquire,
    AcquireClipped,
    AcquireGapless,
    ConfigureMeter,
    LookAtOutput,
    OutputSeen,
    VerifyZero,
    Window,
    ZeroWindow,
)
from vcfbench.steps.operator import AskOperator, OperatorAnswer, move_leads
from vcfbench.steps.resistance import MeasureResistance, ResistanceSeen
from vcfbench.steps.sampling import ModulatedRecord, SampleModulated, SampleSine, SineResponse
from vcfbench.steps.scope import (
    Amplitudes,
    CaptureMeanSines,
    CaptureRotations,
    CaptureSines,
    ConfigureScope,
    DriveAmplitudes,
    DriveFrequency,
    DriveReading,
    FindAmplitudes,
    FindDrive,
    MeasureDrive,
    RotationRecord,
    Rotations,
    ScopeReady,
    SineRecord,
    SineRecords,
    downloaded,
)
from vcfbench.steps.source import (
    ConfigureGenerator,
    DisableVibration,
    DisableVvc,
    EnableVibration,
    EnableVvc,
    SetSine,
    SetVibration,
    SetVvc,
    VvcSetting,
)
from vcfbench.steps.step import Done, Effect, Plan, Reading, Step, StepResult
from vcfbench.steps.stream import LookAtStream, StreamSeen
from vcfbench.steps.stream_latency import LatencySeen, MeasureLatency
from vcfbench.steps.supply import CheckRails, ConfigureRail, DisableSupply, EnableSupply, RailReading, RailsReading
from vcfbench.steps.table import AwaitRate, DisableTable, EnableTable, RateReading, SetRate
from vcfbench.steps.v_vc import (
    AcquireClippedWithVvc,
    AcquireWithVvc,
    ConfigureVvcMeter,
    MeasureVvc,
    PairedReading,
    VvcMeasured,
    VvcWindow,
)
from vcfbench.steps.wait import NotChecked, Note, Settle
