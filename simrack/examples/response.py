"""Frequency response of what is between the generator and the multimeter of `simrack serve --port 5900`."""

from time import sleep

from pymeasure.instruments.agilent import Agilent33220A
from pymeasure.instruments.hp import HP34401A

generator = Agilent33220A("TCPIP0::127.0.0.1,5903::inst0::INSTR")
meter = HP34401A("TCPIP0::127.0.0.1::5904::SOCKET", read_termination="\n", write_termination="\n", timeout=20_000)
generator.write("OUTP:LOAD INF")  # amplitudes are those of the open output, which the meter sees
generator.shape, generator.amplitude, generator.offset, generator.output = "SIN", 2.0, 0.0, True
meter.function_ = "ACV"
for frequency_hz in (100.0, 1e3, 10e3):
    generator.frequency = frequency_hz
    sleep(1.0)  # the meter's ac filter settles
    print(f"{frequency_hz:8.0f} Hz  {meter.reading / (2.0 / 8.0**0.5):.3f}")  # over the rms value of 2 Vpp
