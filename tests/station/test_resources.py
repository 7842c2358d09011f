from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.characters import CHARACTERS
from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.bench.make_safe import safe_bench
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.file import template
from vcfbench.station.resources import resource_key

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vcfbench.station.description import BenchDescription


@pytest.mark.parametrize(
    "names",
    [
        ["GPIB0::22::INSTR", "GPIB::22::INSTR", "gpib0::22::instr", "GPIB::22", " GPIB0::022::INSTR"],
        ["GPIB1::22::2::INSTR", "gpib1::22::2"],
        ["PRLGX-TCPIP0::127.0.0.1::1234::INTFC", "prlgx-tcpip::localhost::INTFC", "TCPIP::LOCALHOST::1234::SOCKET"],
        ["PRLGX-ASRL0::COM3::INTFC", "PRLGX-ASRL::com3::INTFC", "ASRLCOM3::INSTR"],
        ["TCPIP::127.0.0.1::5025::SOCKET", "TCPIP0::LOCALHOST::5025::SOCKET", "socket://localhost:5025"],
        ["TCPIP0::192.0.2.7::inst0::INSTR", "TCPIP::192.0.2.7::INSTR", "TCPIP::192.0.2.7", "tcpip0::192.0.2.7::INST0"],
        ["TCPIP0::192.0.2.7::hislip0::INSTR", "TCPIP::192.0.2.7::hislip0,4880::INSTR"],
        ["USB0::0x0957::0x0407::MY44021876::INSTR", "USB::2391::1031::MY44021876::0::INSTR"],
        ["COM3", "com3", r"\\.\COM3"],
        ["socket://[::1]:5000", "rfc2217://127.0.0.1:5000", "socket://localhost:5000?logging=debug"],
    ],
)
def test_names_of_one_resource_have_one_key(names: list[str]) -> None:
    assert len({resource_key(name) for name in names}) == 1


def test_names_of_different_resources_have_different_keys() -> None:
    names = [
        *("GPIB0::22::INSTR", "GPIB1::22::INSTR", "GPIB0::22::1::INSTR", "GPIB0::5::INSTR"),
        *("TCPIP::192.0.2.7::5025::SOCKET", "TCPIP::192.0.2.7::5024::SOCKET", "TCPIP::192.0.2.8::5025::SOCKET"),
        *("TCPIP::192.0.2.7::inst0::INSTR", "TCPIP::192.0.2.7::gpib0,5::INSTR", "TCPIP::192.0.2.7::hislip0::INSTR"),
        *("USB::0x0957::0x0407::MY1::INSTR", "USB::0x0957::0x0407::MY2::INSTR", "COM3", "COM4", "ASRL1::INSTR"),
    ]
    assert len({resource_key(name) for name in names}) == len(names)


@pytest.mark.skipif(sys.platform == "win32", reason="ports have names, not files, there")
def test_a_port_is_its_device_whatever_links_lead_there(tmp_path: Path) -> None:
    device, link = tmp_path / "ttyUSB0", tmp_path / "by-id"
    device.write_text("")
    link.symlink_to(device)
    names = [str(device), str(link), f"ASRL{link}::INSTR", f"spy://{device}?file=/dev/null"]
    assert len({resource_key(name) for name in names}) == 1


@given(st.text(CHARACTERS, max_size=40))
def test_every_text_has_a_key(text: str) -> None:
    assert resource_key(text.replace("TCPIP", "").replace("socket", "").replace("rfc", "")) is not None


def _with_one_meter_twice() -> BenchDescription:
    second = '[v_vc_meter]\nmodel = "34401A"\nresource = "gpib::22"\n\n[wiring]'
    return parse_bench(template().replace("[wiring]", second, 1), "lab.toml")


@pytest.mark.parametrize("open_", [open_bench, check_bench])
def test_one_instrument_cannot_have_two_roles_under_two_names(open_: Callable[[BenchDescription], object]) -> None:
    words = r"v_vc_meter at gpib::22: the same instrument as multimeter at GPIB0::22::INSTR"
    with pytest.raises(ConfigError, match=words):
        open_(_with_one_meter_twice())


def test_actuators_are_kept_safe_under_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))
    made = safe_bench(_with_one_meter_twice())
    assert {each.role for each in made.instruments} >= {"power", "rate_source", "rate_table"}
