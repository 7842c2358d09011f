"""The driver of the ACME M1, after its manual (page numbers are those of a manual that does not exist)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from vcfbench.drivers.scpi_instrument import ScpiInstrument, decimal, require_within, safely

if TYPE_CHECKING:
    from vcfbench.clock import Deadline
    from vcfbench.interfaces import SafeReport

__all__ = ["M1"]


class M1(ScpiInstrument):
    """A voltmeter with one setting, its range, which integrates for 200 ms (p. 7)."""

    model: ClassVar[str] = "M1"
    makers: ClassVar[tuple[str, ...]] = ("ACME",)

    @property
    def reading_time_s(self) -> float:
        """How long one reading takes, s."""
        return 0.25

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Select the range; the integration time is fixed, `nplc` may ask for less (p. 9)."""
        require_within(self, "range", range_v, (0.0, 100.0), "V")
        require_within(self, "integration time in power-line cycles", nplc, (0.0, 10.0), "periods")
        self._session.write(f"RANGE {decimal(range_v)}")

    def read_voltage_v(self) -> float:
        """Read the voltage, V; raises MeasurementError on overload (p. 11)."""
        return self._session.query_reading("MEASURE?")

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Show that it answers; it drives nothing."""
        return safely(self, self._prove_idle, deadline)

    def _prove_idle(self, deadline: Deadline) -> str:
        self._session.revive(deadline)
        self._session.query_int("*OPC?", deadline)
        return "idle"
