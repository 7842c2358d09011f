from __future__ import annotations

import subprocess
import sys
from typing import ClassVar

import pytest

from tests.drivers.servers import answering, serving
from vcfbench.clock import WallClock
from vcfbench.drivers.e3631a import E3631A
from vcfbench.drivers.registry import Driver, find_driver, open_instrument
from vcfbench.errors import ConfigError, ConnectFailed, WrongInstrument


def opener(*_: object) -> object:
    raise NotImplementedError


def open_meter(resource: str, **settings: object) -> object:
    return open_instrument(
        "multimeter", "34401A", resource, library="@py", clock=WallClock(), settings={"timeout_s": 0.5, **settings}
    )


def test_a_driver_without_a_safe_action_cannot_be_registered() -> None:
    class Careless:
        def identify(self) -> None: ...
        def check_errors(self) -> None: ...
        def close(self) -> None: ...

    with pytest.raises(TypeError, match=r"Careless has no make_safe\(\) and cannot be registered"):
        Driver("1", Careless, opener)  # type: ignore[arg-type]


def test_a_safe_action_must_be_a_method_of_the_class() -> None:
    class Pretending:
        make_safe = None

    with pytest.raises(TypeError, match="make_safe"):
        Driver("1", Pretending, opener)  # type: ignore[arg-type]


def test_the_scpi_base_class_has_no_default_safe_action() -> None:
    from vcfbench.drivers.scpi_instrument import ScpiInstrument  # noqa: PLC0415

    with pytest.raises(TypeError, match="make_safe"):
        Driver("1", ScpiInstrument, opener)  # type: ignore[arg-type]


def test_what_drives_something_must_have_safe_words() -> None:
    class Silent(E3631A):
        safe_words: ClassVar[tuple[str, ...]] = ()

    with pytest.raises(TypeError, match="Silent drives something and has no safe_words, it cannot be registered"):
        Driver("1", Silent, opener)  # type: ignore[arg-type]
    Driver("1", E3631A, opener)  # type: ignore[arg-type]


def test_object_opened_for_table_resource_is_not_named() -> None:
    with pytest.raises(ConnectFailed, match="rate_table at /dev/ttyUSB7: cannot be opened"):
        open_instrument(
            "rate_table", "acl", "/dev/ttyUSB7", library="", clock=WallClock(), settings={"port": "sim://nowhere"}
        )


def test_model_with_like_keeps_its_own_name() -> None:
    driver = find_driver("34410A", like="34401A")
    assert driver.model == "34410A"
    assert issubclass(driver.driver_class, find_driver("34401A").driver_class)
    assert driver.driver_class.model == "34410A"


def test_unknown_model_error_lists_known_models() -> None:
    with pytest.raises(
        ConfigError,
        match=r"no driver for '34410A'; there are 2000, 33220A, 33509B, .*34401A, .*34461A, 34465A, .*E3631A,",
    ):
        open_instrument("multimeter", "34410A", "GPIB0::1::INSTR", library="@py", clock=WallClock(), settings={})


def test_settings_it_does_not_know_are_named() -> None:
    with pytest.raises(ConfigError, match=r"settings of multimeter do not fit: .*'colour'"):
        open_meter("GPIB0::1::INSTR", colour="red")


def test_an_instrument_is_opened_by_its_resource() -> None:
    with serving(answering(lambda *_: False)) as where:
        meter = open_meter(where)
        assert meter.identify().model == "34401A"  # type: ignore[attr-defined]
        meter.close()  # type: ignore[attr-defined]


def test_the_wrong_instrument_is_closed_again() -> None:
    with serving(answering(lambda *_: False)) as where, pytest.raises(WrongInstrument, match="power at TCPIP0"):
        open_instrument("power", "E3631A", where, library="@py", clock=WallClock(), settings={"timeout_s": 0.5})


def test_a_table_that_is_not_there() -> None:
    with pytest.raises(ConnectFailed, match="rate_table at /no/such/port: cannot be opened"):
        open_instrument("rate_table", "acl", "/no/such/port", library="", clock=WallClock(), settings={})


def test_the_registry_loads_neither_pyvisa_nor_numpy() -> None:
    code = (
        "import sys, vcfbench.drivers.registry; print([m for m in ('pyvisa', 'numpy', 'serial') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603 - our own interpreter and words
    assert done.stdout.strip() == "[]"
