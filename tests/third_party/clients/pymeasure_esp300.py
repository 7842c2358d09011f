"""Calls one method after another of PyMeasure's ESP300 and reads its errors; prints what went wrong, as JSON.

Run by an interpreter that has PyMeasure and PyVISA-py; the last word is the VISA resource.
"""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from pymeasure.adapters import VISAAdapter
from pymeasure.instruments.newport import ESP300

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


def expect(value: Any, wanted: Any, within: float = 0.0) -> None:
    good = value == wanted if not within else abs(value - wanted) <= within
    if not good:
        raise AssertionError(f"expected {wanted}, got {value}")


def calls(controller: ESP300) -> Iterator[tuple[str, Callable[[], Any]]]:
    axis = controller.x

    def put(name: str, value: Any) -> Callable[[], None]:
        return lambda: setattr(axis, name, value)

    yield "id", lambda: controller.id
    yield "axes", lambda: controller.axes
    yield "error", lambda: expect(controller.error, 0)
    yield "clear_errors", controller.clear_errors
    yield "enable", axis.enable
    yield "enabled", lambda: expect(axis.enabled, wanted=True)
    yield "units", lambda: expect(axis.units, "degree")
    yield "units = radian", put("units", "radian")
    yield "position = 0.25 rad", put("position", 0.25)
    yield "wait_for_stop in radian", axis.wait_for_stop
    yield "position in radian", lambda: expect(axis.position, 0.25, 1e-3)
    yield "units = degree", put("units", "degree")
    yield "position in degree", lambda: expect(axis.position, 14.3239, 1e-3)
    yield "left_limit = ", put("left_limit", -100)
    yield "right_limit = ", put("right_limit", 100)
    yield "left_limit", lambda: expect(axis.left_limit, -100.0)
    yield "right_limit", lambda: expect(axis.right_limit, 100.0)
    yield "position = ", put("position", 15)
    yield "wait_for_stop", axis.wait_for_stop
    yield "motion_done", lambda: expect(axis.motion_done, wanted=True)
    yield "position", lambda: expect(axis.position, 15.0, 1e-3)
    yield "position beyond the limit", put("position", 101)
    yield "define_position", lambda: axis.define_position(3)
    yield "position as defined", lambda: expect(axis.position, 3.0, 1e-3)
    yield "zero", axis.zero
    yield "home", lambda: axis.home(1)
    yield "wait_for_stop at home", axis.wait_for_stop
    yield "endless jog", lambda: axis.write("VA10;1MV+")
    yield "stop", lambda: axis.write("ST")
    yield "y.position", lambda: controller.y.position
    yield "enable all", controller.enable
    yield "disable", axis.disable
    yield "disabled", lambda: expect(axis.enabled, wanted=False)
    yield "move while disabled", put("position", 1)
    yield "shutdown", controller.shutdown


def attempt(controller: ESP300, call: Callable[[], Any]) -> str | None:
    words = None
    try:
        call()
    except Exception as error:  # noqa: BLE001  # whatever goes wrong is what is asked for
        words = f"{type(error).__name__}: {error}"
    return words or "; ".join(map(str, controller.errors)) or None


def main() -> None:
    settings = {"baud_rate": 19200} if sys.argv[-1].startswith("ASRL") else {}
    adapter = VISAAdapter(
        sys.argv[-1], visa_library="@py", write_termination="\r", read_termination="\r\n", timeout=3000, **settings
    )
    controller = ESP300(adapter)
    seen = {}
    for name, call in calls(controller):
        seen[name] = attempt(controller, call)
        controller.clear_errors()
    print(json.dumps(seen))  # noqa: T201


if __name__ == "__main__":
    main()
