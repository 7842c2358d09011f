"""Everything about the generator of V_Vc."""

from typing import ClassVar

from msgspec import Struct

from vcfbench.bench.bench import Bench
from vcfbench.interfaces import FunctionGenerator
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Done, Effect, Step, StepResult, does, problem


class VvcSetting(StepResult, Struct, frozen=True):
    """The DC level that the generator says it has set, V."""

    v_vc_v: float

    def describe(self) -> str:
        return f"reads {self.v_vc_v:+.6g} V"


@does(Effect.SETS, "V_Vc", overhead_s=0.05)
class SetVvc(Step, Struct, frozen=True):
    """Set V_Vc; the result is the level read back."""

    v_vc_v: float

    def describe(self) -> str:
        return f"V_Vc = {self.v_vc_v:+.6g} V"

    def within(self, limits: LimitChecks) -> None:
        limits.v_vc(self.v_vc_v)

    def perform(self, context: Context) -> VvcSetting:
        source = context.bench.rate_source
        return VvcSetting(context.believable(lambda: source.set_dc(self.v_vc_v)))

    def predict(self, gyro: LinearGyro) -> VvcSetting:
        """Predict that the level is accepted."""
        gyro.v_vc_v = self.v_vc_v
        return VvcSetting(self.v_vc_v)


@does(Effect.SETS, "V_Vc", overhead_s=0.1, also=("generator",))
class ConfigureGenerator(SetVvc, frozen=True):
    """Select DC at `v_vc_v` into the high impedance of the PCB; the output switch is unchanged."""

    def describe(self) -> str:
        return f"generator: DC {self.v_vc_v:g} V into high impedance"

    def perform(self, context: Context) -> VvcSetting:
        source = context.bench.rate_source
        return VvcSetting(context.believable(lambda: source.configure_dc(self.v_vc_v)))


@does(Effect.SETS, "V_Vc", overhead_s=0.1)
class SetSine(Step, Struct, frozen=True):
    """Set V_Vc to a sine about 0 V, which the generator reads back; its output switch is unchanged.

    `amplitude_v` is its peak.
    """

    frequency_hz: float
    amplitude_v: float

    def describe(self) -> str:
        return f"{self.subject} = sine of {self.frequency_hz:.6g} Hz, {self.amplitude_v:g} V peak"

    def within(self, limits: LimitChecks) -> None:
        limits.sine(self.frequency_hz, self.amplitude_v)

    def command(self, bench: Bench) -> None:
        bench.rate_source.configure_sine(self.frequency_hz, 2.0 * self.amplitude_v)

    def predict(self, gyro: LinearGyro) -> Done:
        gyro.v_vc_v = 0.0
        return Done()


class SetVibration(SetSine, frozen=True):
    """Set the second generator, which is added to V_Vc, to a sine about 0 V; its output switch is unchanged."""

    subject: ClassVar[str] = "virtual vibration"

    def command(self, bench: Bench) -> None:
        bench.vibration_source.configure_sine(self.frequency_hz, 2.0 * self.amplitude_v)


@does(Effect.SETS, "generator output", "generator output on", overhead_s=0.05)
class EnableVvc(Step, Struct, frozen=True):
    """Switch the generator's output on."""

    def command(self, bench: Bench) -> None:
        _switch(bench.rate_source, on=True)

    def predict(self, gyro: LinearGyro) -> Done:
        gyro.v_vc_on = True
        return Done()


@does(Effect.SETS, "generator output", "generator output off, the PCB holds V_Vc at 0 V", overhead_s=0.05)
class DisableVvc(Step, Struct, frozen=True):
    """Switch the generator's output off: the PCB pulls the V_Vc node to 0 V."""

    def command(self, bench: Bench) -> None:
        _switch(bench.rate_source, on=False)

    def predict(self, gyro: LinearGyro) -> Done:
        """Predict that V_Vc acts no more."""
        gyro.v_vc_on = False
        return Done()


@does(Effect.SETS, "vibration output", "output of the vibration generator on", overhead_s=0.05)
class EnableVibration(Step, Struct, frozen=True):
    """Switch the second generator's output on."""

    needs: ClassVar[str] = SetVibration.subject

    def command(self, bench: Bench) -> None:
        _switch(bench.vibration_source, on=True)


@does(Effect.SETS, "vibration output", "output of the vibration generator off", overhead_s=0.05)
class DisableVibration(Step, Struct, frozen=True):
    """Switch the second generator's output off."""

    def command(self, bench: Bench) -> None:
        _switch(bench.vibration_source, on=False)


def _switch(source: FunctionGenerator, *, on: bool) -> None:
    """Switch an output; MeasurementError when it does not read back so."""
    (source.enable_output if on else source.disable_output)()
    if source.output_enabled() is not on:
        words = ("on", "off") if on else ("off", "on")
        raise problem(source, "the output was switched {} but reads back {}".format(*words))
