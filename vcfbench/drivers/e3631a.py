"""Keysight (Agilent, HP) E3631A triple DC supply, after its user's guide E3631-90002."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar, Final

from msgspec import Struct

from vcfbench.clock import Deadline, sleep
from vcfbench.drivers import replies
from vcfbench.drivers.scpi_instrument import Left, ScpiInstrument, decimal, require_within, safely
from vcfbench.errors import InstrumentError, LimitError, MeasurementError, PlanError
from vcfbench.interfaces import Regulation, SafeReport


class Output(Struct, frozen=True):
    """One of the three outputs: its number, programmable ranges (guide p. 91) and resolution (p. 186), V and A."""

    number: int
    low_v: float
    high_v: float
    high_a: float
    step_v: float
    step_a: float


OUTPUTS: Final[Mapping[str, Output]] = MappingProxyType(
    {
        "P6V": Output(1, 0.0, 6.18, 5.15, 0.5e-3, 0.5e-3),
        "P25V": Output(2, 0.0, 25.75, 1.03, 1.5e-3, 0.1e-3),
        "N25V": Output(3, -25.75, 0.0, 1.03, 1.5e-3, 0.1e-3),
    }
)

_FORWARD_V = 0.2
"""Below this an output that is off has discharged (chosen: no part of a PCB works on it)."""
_REVERSE_V = 0.7
"""Off, without load, an output has less than 0.6 V of opposite polarity (guide p. 96; 0.481 V was measured on one), and
its voltmeter an error of 10 mV (p. 186); the rest is for a diode in the cold, -2 mV/K. E36312A: unverified."""

_OFF_S = 10.0
"""Longest time in which outputs that are found on are to be off, s."""
_POLL_S = 0.1
_REGULATION = MappingProxyType(
    # ISUM<n>:COND? (guide p. 118): 0 is "output off", which the switch decides, or "unregulated".
    {0: Regulation.FAULT, 1: Regulation.CONSTANT_CURRENT, 2: Regulation.CONSTANT_VOLTAGE, 3: Regulation.FAULT}
)


class E3631A(ScpiInstrument):
    """The three outputs ``P6V``, ``P25V``, ``N25V`` share one switch; N25V takes negative voltages."""

    model: ClassVar[str] = "E3631A"
    reading_form: ClassVar[replies.NumberForm] = replies.nr3()  # how many digits is unverified
    safe_words: ClassVar[tuple[str, ...]] = ("OUTP OFF",)
    outputs: ClassVar[Mapping[str, Output]] = OUTPUTS
    switch_question: ClassVar[str] = "OUTP?"
    questions: ClassVar[tuple[tuple[str, replies.NumberForm], ...]] = (
        ("OUTP?", replies.ANY_NUMBER),
        ("VOLT?", replies.ANY_NUMBER),
        ("MEAS:VOLT? P25V", reading_form),
        ("MEAS:CURR? N25V", reading_form),
        ("STAT:QUES:INST:ISUM2:COND?", replies.ANY_NUMBER),
    )
    look: ClassVar[Mapping[str, str]] = MappingProxyType({output: f"MEAS:VOLT? {output}" for output in OUTPUTS})
    """Questions to a supply that may be on, before it is switched off."""
    serial_pause_s: ClassVar[float] = 0.5  # what comes within 0.3 to 0.5 s of a change of state is lost (seen by users)
    left: ClassVar[tuple[Left, ...]] = ()  # it has no protection, delay or sense to be set
    setting_words: ClassVar[str] = "OUTP:TRAC OFF;:INST:SEL {output};:CURR {amps};:VOLT {volts}"
    """Words that set an output: one message, for the selected output persists, and nothing must come in between."""
    setting_question: ClassVar[str] = "{header}?"
    """Question for a setting of the selected output."""
    reading_question: ClassVar[str] = "MEAS:{header}? {output}"

    _configured: frozenset[str] = frozenset()
    _found_off = False

    def _take_remote(self, deadline: Deadline) -> None:
        if self._session.interface == "asrl":
            self._session.send("SYST:REM", deadline=deadline)

    def _safe_words_here(self) -> tuple[str, ...]:
        """Return the safe words; in local, as after a power failure, RS-232 must make the supply remote first."""
        return (
            (*self.safe_words, "SYST:REM", *self.safe_words) if self._session.interface == "asrl" else self.safe_words
        )

    def configure_output(self, output: str, voltage_v: float, current_limit_a: float) -> None:
        """Set level and current limit of `output`; the limit first, and both are read back."""
        ratings = self._ratings(output)
        require_within(self, f"voltage of {output}", voltage_v, (ratings.low_v, ratings.high_v), "V")
        require_within(self, f"current limit of {output}", current_limit_a, (0.0, ratings.high_a), "A")
        self._take_over_off()
        volts, amps = decimal(self._signed(output, voltage_v)), decimal(current_limit_a)
        self._session.write(self._said(self.setting_words, output, volts=volts, amps=amps))
        self._read_back(self._said(self.setting_question, output, header="VOLT"), volts, ratings.step_v, "V")
        self._read_back(self._said(self.setting_question, output, header="CURR"), amps, ratings.step_a, "A")
        self._configured |= {output}

    def _take_over_off(self) -> None:
        """Before the first setting, switch off a supply that is found on: its rails would change one at a time."""
        if self._found_off:
            return
        if self._switched_on(None):
            self._prove_off(self._session.deadline(_OFF_S))
        self._take_over(self.left)
        self._found_off = True

    def _said(self, words: str, output: str, **values: str) -> str:
        return words.format(output=output, number=self._ratings(output).number, **values)

    def _signed(self, output: str, voltage_v: float) -> float:
        """Return a voltage at the terminal that the output's wire is on, from the supply's reading."""
        return voltage_v

    def _ratings(self, output: str) -> Output:
        try:
            return self.outputs[output]
        except (KeyError, TypeError):
            raise self._error(LimitError, f"there is no output {output!r}, only {', '.join(self.outputs)}") from None

    def enable_outputs(self) -> None:
        """Switch all outputs on; those that were not configured are first set to 0 V."""
        if not self._configured:
            raise self._error(PlanError, "no output has a voltage and a current limit yet, nothing was switched on")
        self._switch_on()
        self._verify_switch("on")

    def _switch_on(self) -> None:
        for output in self.outputs:
            if output not in self._configured:
                self._session.write(f"INST:SEL {output};:VOLT 0")
        self._session.write("OUTP ON")

    def disable_outputs(self) -> None:
        """Switch all outputs off."""
        self._session.write(*self.safe_words)
        self._verify_switch("off")

    def _verify_switch(self, wanted: str) -> None:
        on = self.outputs_enabled() if wanted == "on" else self._switched_on(None)
        if on is not (wanted == "on"):
            raise self._error(
                InstrumentError,
                f"the outputs were switched {wanted} but do not read back so",
                command=self.switch_question,
            )

    def outputs_enabled(self) -> bool:
        """Return True if the outputs are on."""
        return self._switched_on(None)

    def _switched_on(self, deadline: Deadline | None) -> bool:
        on = self._session.query_bool(self.switch_question, deadline)
        self._session.note_read(f"outputs {'on' if on else 'off'}")
        return on

    def measure_voltage_v(self, output: str) -> float:
        """Read back the voltage at the terminals, V."""
        asked = self._said(self.reading_question, output, header="VOLT")
        voltage_v = self._signed(output, self._session.query_reading(asked, form=self.reading_form))
        self._session.note_read(f"{output} at {voltage_v:.3g} V")
        return voltage_v

    def measure_current_a(self, output: str) -> float:
        """Read back the current, A."""
        asked = self._said(self.reading_question, output, header="CURR")
        return self._session.query_reading(asked, form=self.reading_form)

    def regulation(self, output: str) -> Regulation:
        """Return the regulation of `output`."""
        condition = self._session.query_int(f"STAT:QUES:INST:ISUM{self._ratings(output).number}:COND?") & 3
        return Regulation.OFF if condition == 0 and not self.outputs_enabled() else _REGULATION[condition]

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Switch the outputs off and wait until each has discharged."""
        return safely(self, self._prove_off, deadline)

    def _prove_off(self, deadline: Deadline) -> str:
        self._session.revive(deadline)
        self._tell_safe(*self.safe_words, deadline=deadline)
        if self._switched_on(deadline):
            raise self._error(InstrumentError, "the outputs stay on", command=self.switch_question)
        return f"outputs off, {self._wait_for_discharge(deadline)} at the terminals"

    def _wait_for_discharge(self, deadline: Deadline) -> str:
        """Return the voltages in words once they are those of outputs that are off; they go on being switched off."""
        while True:
            began_s, said, wrong = self.clock.now(), list[str](), list[str]()
            for output, ratings in self.outputs.items():
                asked = self._said(self.reading_question, output, header="VOLT")
                voltage_v = self._signed(output, self._session.query_reading(asked, deadline))
                forward_v = voltage_v if ratings.high_v > 0.0 else -voltage_v
                said.append(f"{output} {voltage_v:+.3g} V")
                if forward_v >= _FORWARD_V:
                    wrong.append(f"{said[-1]}: not discharged yet, or fed from elsewhere")
                elif forward_v <= -_REVERSE_V:
                    wrong.append(
                        f"{said[-1]}: more reverse than the {_REVERSE_V:g} V of an open output, something feeds it"
                    )
            if not wrong:
                return ", ".join(said)
            if deadline.remaining() <= 3.0 * (self.clock.now() - began_s) + _POLL_S:  # before the next is cut off
                raise self._error(MeasurementError, f"outputs are off, but {'; '.join(wrong)}")
            sleep(self.clock, _POLL_S)
