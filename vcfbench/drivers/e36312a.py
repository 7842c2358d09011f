"""Keysight E36312A triple DC supply, after the E36300 Series Programming Guide (E36311-90008).

Of the guide only the list of contents was at hand; words, ranges and bits are those of users' drivers of the model,
which follow it. Its three outputs are all positive and float: output 3, which is the E3631A's N25V, gives a negative
rail because its plus terminal is wired to ground. Voltages of N25V are said and told here with the sign of the rail.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.e3631a import E3631A, Output
from vcfbench.drivers.scpi_instrument import Left
from vcfbench.errors import FramingError, InstrumentError


class E36312A(E3631A):
    """Every output has a switch of its own; outputs that are not configured stay off."""

    model: ClassVar[str] = "E36312A"
    makers: ClassVar[tuple[str, ...]] = ("KEYSIGHT",)
    reading_form: ClassVar[replies.NumberForm] = replies.ANY_NUMBER  # no record of a reply was at hand
    safe_words: ClassVar[tuple[str, ...]] = ("OUTP OFF,(@1,2,3)",)
    serial_pause_s: ClassVar[float] = 0.0  # it has no RS-232
    switch_question: ClassVar[str] = "OUTP? (@1,2,3)"
    questions: ClassVar[tuple[tuple[str, replies.NumberForm], ...]] = tuple(
        (question, replies.ANY_NUMBER)
        for question in ("VOLT? (@2)", "MEAS:VOLT? (@2)", "MEAS:CURR? (@3)", "STAT:QUES:INST:ISUM2:COND?")
    )
    left: ClassVar[tuple[Left, ...]] = (
        Left("OUTP:PAIR", "OFF", "OUTPut subsystem: never two outputs as one"),
        Left("OUTP:TRAC", "OFF", "OUTPut subsystem"),
        Left("OUTP:COUP:CHAN", "NONE", "OUTPut subsystem: coupled outputs are switched together"),
        Left("OUTP:DEL:RISE", "0,(@1,2,3)", "OUTPut subsystem: until then it is on without output"),
        Left("OUTP:DEL:FALL", "0,(@1,2,3)", "OUTPut subsystem"),
        Left("VOLT:SENS", "INT,(@1,2,3)", "SOURce subsystem: not at open sense terminals"),
        # The current limit that is set regulates; levels above a protection's would trip it
        Left("CURR:PROT:STAT", "OFF,(@1,2,3)", "SOURce subsystem"),
        Left("VOLT:PROT", "MAX,(@1,2,3)", "SOURce subsystem"),
        Left("OUTP:PROT:CLE", "(@1,2,3)", "OUTPut subsystem: what has tripped stays off"),
    )
    setting_words: ClassVar[str] = "CURR {amps},(@{number});:VOLT {volts},(@{number})"  # the limit first
    setting_question: ClassVar[str] = "{header}? (@{number})"
    reading_question: ClassVar[str] = "MEAS:{header}? (@{number})"
    look: ClassVar[Mapping[str, str]] = MappingProxyType(
        {"P6V": "MEAS:VOLT? (@1)", "P25V": "MEAS:VOLT? (@2)", "N25V": "MEAS:VOLT? (@3)"}
    )
    outputs: ClassVar[Mapping[str, Output]] = MappingProxyType(
        {
            # Programming ranges and steps of users' drivers, unverified.
            "P6V": Output(1, 0.0, 6.18, 5.15, 1.0e-3, 1.0e-3),
            "P25V": Output(2, 0.0, 25.75, 1.03, 3.0e-3, 4.0e-4),
            "N25V": Output(3, -25.75, 0.0, 1.03, 3.0e-3, 4.0e-4),
        }
    )

    def _signed(self, output: str, voltage_v: float) -> float:
        return (-voltage_v if output == "N25V" else voltage_v) + 0.0

    def _switch_on(self) -> None:
        numbers = sorted(self._ratings(output).number for output in self._configured)
        self._session.write(f"OUTP ON,(@{','.join(map(str, numbers))})")
        others = [output for output, on in self._states(None).items() if on and output not in self._configured]
        if others:
            what = f"{' and '.join(others)} came on without a command"
            raise self._error(InstrumentError, what, command=self.switch_question)

    def _verify_switch(self, wanted: str) -> None:
        try:
            super()._verify_switch(wanted)
        except InstrumentError as error:
            for what, header in (("over-voltage", "VOLT"), ("over-current", "CURR")):
                states = self._session.query_as(f"{header}:PROT:TRIP? (@1,2,3)", _three_states)
                tripped = [output for output, state in zip(self.outputs, states, strict=True) if state]
                if tripped:
                    error.what += f": the {what} protection of {', '.join(tripped)} has tripped"
                    error.hint = "remove the cause, then clear it at the front panel or by OUTP:PROT:CLE (@1,2,3)"
            raise

    def outputs_enabled(self) -> bool:
        """Return True if all configured outputs are on; before any is configured, if one is on."""
        states = self._states(None)
        wanted = [states[output] for output in self._configured]
        return all(wanted) if wanted else any(states.values())

    def _switched_on(self, deadline: Deadline | None) -> bool:
        """Return True if any output is on."""
        return any(self._states(deadline).values())

    def _states(self, deadline: Deadline | None) -> dict[str, bool]:
        answers = self._session.query_as(self.switch_question, _three_states, deadline)
        states = {output: bool(answer) for output, answer in zip(self.outputs, answers, strict=True)}
        on = [output for output, state in states.items() if state]
        self._session.note_read(f"{', '.join(on)} on" if on else "outputs off")
        return states


def _three_states(reply: str) -> tuple[float, ...]:
    states = replies.numbers(reply)
    if len(states) != 3 or any(state not in {0.0, 1.0} for state in states):
        raise FramingError(f"expected three states, got {reply!r}")
    return states
