"""Checked driver reads a second through simulated instruments in process, beside PyMeasure over PyVISA-sim."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path

from measure import Figure, per_second, report

from vcfbench.bench.bench import open_bench
from vcfbench.procedures.bench_file import load_bench

PEER = """
spec: "1.1"
devices:
  dmm:
    eom:
      TCPIP SOCKET: {q: "\\n", r: "\\n"}
    error: ERROR
    dialogues:
      - {q: "READ?", r: "+1.23456789E+00"}
resources:
  TCPIP0::localhost::5025::SOCKET: {device: dmm}
"""


def figures() -> list[Figure]:
    with open_bench(load_bench(None)) as bench:
        bench.multimeter.configure_dc_voltage(10.0, 1)
        ours = {
            "state of the generator's output": per_second(bench.rate_source.output_enabled),
            "supply voltage, 0.1 s of bench time": per_second(lambda: bench.power.measure_voltage_v("P25V")),
            "multimeter reading, physics included": per_second(bench.multimeter.read_voltage_v),
            "table rate": per_second(bench.rate_table.rate_deg_s),
        }
    found = [
        report(Figure(f"driver read in process: {name}", rate, "1/s", at_least=True)) for name, rate in ours.items()
    ]
    peer = _peer()
    if peer is not None:
        found += [
            report(Figure("PyMeasure over PyVISA-sim", peer, "1/s")),
            report(
                Figure(
                    "driver read against PyMeasure over PyVISA-sim",
                    ours["state of the generator's output"] / peer,
                    "ratio",
                    bar=1,
                    gross=0.5,
                    at_least=True,
                )
            ),
        ]
    return found


def _peer() -> float | None:
    if any(importlib.util.find_spec(name) is None for name in ("pymeasure", "pyvisa_sim")):
        return None
    from pymeasure.instruments import Instrument  # noqa: PLC0415 - a peer that need not be there

    class Meter(Instrument):  # type: ignore[misc]  # it has no types
        voltage = Instrument.measurement("READ?", "Read the voltage.")

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "dmm.yaml"
        file.write_text(PEER)
        end = {"read_termination": "\n", "write_termination": "\n"}
        library = f"{file}@sim"
        meter = Meter("TCPIP0::localhost::5025::SOCKET", "meter", includeSCPI=False, visa_library=library, **end)
        return per_second(lambda: meter.voltage)


if __name__ == "__main__":
    figures()
