from __future__ import annotations

import socket
import sys
import tomllib
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.characters import CHARACTERS
from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.bench.make_safe import safe_bench
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import checked_bench, parse_bench
from vcfbench.station import file
from vcfbench.station.file import embedded_text, template
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
        ["TCPIP0::127.0.0.1,4880::inst0::INSTR", "TCPIP::localhost,4880", "tcpip0::LOCALHOST,4880::INST0"],
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


_TWO_WRITINGS = st.one_of(
    st.integers(1, 30).map(
        lambda at: [f"GPIB0::{at}::INSTR", f"GPIB::{at}", f"gpib0::{at:02}", f"Gpib::{at}::instr", f" GPIB0::{at}"]
    ),
    st.integers(1, 99).map(lambda at: [f"COM{at}", f"com{at}", rf"\\.\COM{at}", f"ASRLCOM{at}::INSTR"]),
    st.integers(1, 9).map(lambda at: [f"ASRL{at}::INSTR", f"asrl{at}::instr", f"ASRL{at}"]),
    st.integers(1, 254).map(
        lambda at: [f"TCPIP0::192.0.2.{at}::inst0::INSTR", f"TCPIP::192.0.2.{at}", f"tcpip0::192.0.2.{at}::instr"]
    ),
    st.integers(1024, 65535).map(
        lambda at: [f"TCPIP0::127.0.0.1::{at}::SOCKET", f"tcpip::localhost::{at}::socket", f"socket://[::1]:{at}"]
    ),
    st.integers(1, 9999).map(
        lambda at: [f"USB0::0x0957::0x0407::MY{at}::INSTR", f"USB::2391::1031::MY{at}", f"usb0::0x957::0x407::my{at}"]
    ),
).flatmap(lambda names: st.permutations(names).map(lambda drawn: drawn[:2]))


@given(st.permutations(["power", "multimeter", "rate_source", "oscilloscope", "rate_table"]), _TWO_WRITINGS)
@pytest.mark.parametrize("bench", ["lab", "paper", "ideal"])
def test_bench_file_gives_no_instrument_two_roles(bench: str, roles: list[str], names: list[str]) -> None:
    values = tomllib.loads(template() if bench == "lab" else embedded_text(bench))
    for role, resource in zip(roles, names, strict=False):
        values[role]["resource"] = resource
    with pytest.raises(ConfigError, match=r"the same instrument|a resource of its own"):
        checked_bench(values, "lab.toml")


@given(_TWO_WRITINGS)
def test_bench_file_gives_no_meter_two_gyroscopes(names: list[str]) -> None:
    values = tomllib.loads(embedded_text("ideal"))
    values["device"] = [{"name": f"S-{number}", "resource": each} for number, each in enumerate(names)]
    with pytest.raises(ConfigError, match=r"the same instrument|a resource of its own"):
        checked_bench(values, "lab.toml")


def test_checking_a_bench_file_asks_no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def asked(host: str, *_: object, flags: int = 0) -> list[object]:
        assert flags & socket.AI_NUMERICHOST
        raise OSError(host)

    monkeypatch.setattr(socket, "getaddrinfo", asked)
    text = template().replace("GPIB0::22::INSTR", "TCPIP0::meter.lab::INSTR", 1)
    assert parse_bench(text, "lab.toml").output_resource == "TCPIP0::meter.lab::INSTR"


def _with_one_meter_twice() -> BenchDescription:
    second = '[v_vc_meter]\nmodel = "34401A"\nresource = "gpib::22"\n\n[wiring]'
    return file.parse_bench(template().replace("[wiring]", second, 1), "lab.toml")  # as `vcfbench safe` reads it


@pytest.mark.parametrize("open_", [open_bench, check_bench])
def test_one_instrument_cannot_have_two_roles_under_two_names(open_: Callable[[BenchDescription], object]) -> None:
    words = r"v_vc_meter at gpib::22: the same instrument as multimeter at GPIB0::22::INSTR"
    with pytest.raises(ConfigError, match=words):
        open_(_with_one_meter_twice())


def test_actuators_are_kept_safe_under_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))
    made = safe_bench(_with_one_meter_twice())
    assert {each.role for each in made.instruments} >= {"power", "rate_source", "rate_table"}
