"""A magnet supply of one's own: its current ramps, its field follows, it trips when it is told to ramp too far."""

from __future__ import annotations

from simrack.own import OwnInstrument, Setting, command, query
from simrack.scpi import ScpiError


class Magnet(OwnInstrument):
    """Ramps to a current when it is told to."""

    idn = "ACME,MAGNET,1,1.0"
    target_a = Setting("CURRent", 0.0, unit="A", low=-100.0, high=100.0)
    ramp_a_s = Setting("CURRent:RATE", 1.0, low=0.01, high=10.0)
    on = Setting("OUTPut[:STATe]", False)
    mode = Setting("MODE", "HOLD", words=("HOLD", "RAMP"))
    begun_s, from_a = 0.0, 0.0

    @command("RAMP")
    def ramp(self) -> None:
        """Begin to ramp to the target from where the current is."""
        if not self.on:
            raise ScpiError(-221)  # settings conflict
        self.from_a, self.begun_s, self.mode = self.current_a(), self.clock.now(), "RAMP"

    @query("MEASure:CURRent", takes_s=0.1)
    def current_a(self) -> float:
        """Return the current now."""
        way_a = self.ramp_a_s * (self.clock.now() - self.begun_s) if self.mode == "RAMP" else 0.0
        step_a = self.target_a - self.from_a
        return self.from_a + max(-way_a, min(way_a, step_a))
