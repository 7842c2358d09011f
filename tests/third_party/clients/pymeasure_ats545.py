"""Drives PyMeasure's ATS545 as its documentation does; prints what it saw, as JSON.

Run by an interpreter that has PyMeasure and PyVISA-py; the word is the VISA resource. `set_temperature` of PyMeasure
0.16 is not called: it reads `mode`, which raises IndexError for the 10 that its own table has. What it does then is
done by its other properties.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from pymeasure.adapters import VISAAdapter
from pymeasure.instruments.temptronic import ATS545


def seen(resource: str) -> dict[str, Any]:
    stream = ATS545(VISAAdapter(resource, visa_library="@py", read_termination="\n", write_termination="\n"))
    read: dict[str, Any] = {"id": stream.id, "errors": int(stream.error_code)}
    stream.configure(dut_type=None, soak_time=3, temp_window=0.5, temp_limit_air_low=-50, temp_limit_air_high=120)
    read["limits"] = [stream.temperature_limit_air_low, stream.temperature_limit_air_high]
    read["window"] = [stream.temperature_setpoint_window, stream.temperature_soak_time]
    stream.ramp_rate = 600
    read["before"] = [stream.air_temperature, int(stream.auxiliary_condition_code)]
    stream.start()
    stream.set_point_number, stream.temperature_setpoint = 0, 60
    read["not yet"] = [stream.at_temperature(), stream.not_at_temperature()]
    stream.wait_for_settling(60)
    read["there"] = [stream.at_temperature(), stream.air_temperature, stream.temperature, stream.temperature_setpoint]
    read["flow"] = [int(stream.auxiliary_condition_code) & 32, stream.main_air_flow_rate > 0.0]
    stream.set_point_number, stream.temperature_setpoint = 2, -30
    read["cold"] = [stream.set_point_number, stream.temperature_setpoint]
    stream.shutdown()
    read["after"] = [int(stream.auxiliary_condition_code) & 32, int(stream.error_code)]
    return read


sys.stdout.write(json.dumps(seen(sys.argv[1])) + "\n")
