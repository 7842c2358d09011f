"""Instruments of one's own: what they have by themselves, on every wire, and on nodes."""

from __future__ import annotations

import re
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from simrack.clock import VirtualClock
from simrack.own import OwnInstrument, Setting, command, query
from simrack.plan import plan_of
from simrack.rack import Rack
from simrack.scpi import Number
from simrack.wired import WiredWorld

from simrack_tests.test_rack import WIRES, serving

if TYPE_CHECKING:
    from collections.abc import Callable

RACK = Path(__file__).parents[1]
MAGNET = str(RACK / "examples" / "magnet.py")


class Box(OwnInstrument):
    """One setting of each kind, four channels, an input and an output."""

    inputs = ("sense",)
    outputs = ("drive",)
    level_v = Setting("LEVel", 1.0, unit="V", low=0.0, high=10.0, then=lambda box: box.put("drive", box.level_v))
    count = Setting("COUNt", 3, low=1, high=9)
    on = Setting("OUTPut[:STATe]", default=False)
    shape = Setting("SHAPe", "SINusoid", words=("SINusoid", "SQUare"))
    label = Setting("LABel", "none")
    gain = Setting("CHANnel<1-4>:GAIN", 1.0, low=0.1, high=10.0)

    @query("SENSe")
    def sensed_v(self) -> float:
        return self.volts("sense")

    @command("WAIT", Number(unit="S"), takes_s=0.5)
    def wait(self, seconds: float) -> None:
        self.level_v = seconds


@pytest.fixture
def asked() -> Callable[[str], str]:
    world = WiredWorld(VirtualClock())
    box = Box(world)

    def asked(message: str) -> str:
        box.write(message.encode() + b"\n")
        world.clock.sleep_until(world.clock.now() + 1.0)
        return box.read(1000)[0].decode().strip()

    return asked


@pytest.mark.parametrize(
    ("setting", "default", "other", "refused"),
    [
        ("LEV", "+1.00000000E+00", ("2500 MV", "+2.50000000E+00"), ("11", -222)),
        ("COUN", "3", ("4", "4"), ("10", -222)),
        ("OUTP", "0", ("ON", "1"), ("PERHAPS", -224)),
        ("SHAP", "SIN", ("SQUARE", "SQU"), ("ROUND", -224)),
        ("LAB", '"none"', ('"a ""b"""', '"a ""b"""'), ("3", -128)),
        ("CHAN3:GAIN", "+1.00000000E+00", ("2", "+2.00000000E+00"), ("MORE", -224)),
    ],
)
def test_a_setting_has_a_default_a_memory_and_limits(
    asked: Callable[[str], str], setting: str, default: str, other: tuple[str, str], refused: tuple[str, int]
) -> None:
    assert asked(f"{setting}?") == default
    assert asked(f"{setting} {other[0]};*SAV 3;:{setting}?") == other[1]
    assert asked(f"{setting} {refused[0]}") == ""
    assert asked("SYST:ERR:NEXT?").startswith(f"{refused[1]},")
    assert asked(f"*RST;:{setting}?") == default
    assert asked(f"*RCL 3;:{setting}?") == other[1]


def test_channels_are_apart(asked: Callable[[str], str]) -> None:
    assert asked("CHAN2:GAIN 2;:CHAN1:GAIN?;:CHAN2:GAIN?") == "+1.00000000E+00;+2.00000000E+00"
    assert asked("CHAN5:GAIN?") == ""
    assert asked("SYST:ERR?").startswith("-114")


def test_an_empty_memory_is_refused_and_the_status_has_it(asked: Callable[[str], str]) -> None:
    assert asked("*ESE 16;*SRE 32;*CLS;*RCL 7;*STB?") == "+96"
    assert asked("SYST:ERR?").startswith("-221")
    assert asked("WAIT 2 S;LEV?") == "+2.00000000E+00"


class Wrong(OwnInstrument):
    """What its author has done wrong."""

    level = Setting("LEVel", 0.0, then=lambda box: box.divided())

    @query("DIVide")
    def divided(self) -> float:
        return 1.0 / self.level

    @query("NONE")
    def nothing(self) -> None:
        """Answer nothing."""

    @query("LIST")
    def several(self) -> list[object]:
        return [1.0, 2, True, "x"]


@pytest.mark.parametrize("message", ["DIV?", "NONE?", "LEV 0"])
def test_author_mistake_is_an_error_and_the_rest_goes_on(message: str, capsys: pytest.CaptureFixture[str]) -> None:
    box = Wrong(WiredWorld(VirtualClock()))
    box.write(message.encode() + b"\n")
    assert box.read(100)[0] == b""
    box.write(b"SYST:ERR?;:LIST?\n")
    error, listed = box.read(1000)[0].decode().strip().rsplit(";", 1)
    assert re.match('-310,"System error; Wrong.*(division by zero|returned None)', error)
    assert listed == "+1.00000000E+00,2,1,x"
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("limits", [{"low": 0.0}, {"high": 1.0}, {"low": 3.0, "high": 4.0}])
def test_limits_that_are_none_are_refused_at_once(limits: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="LEV: expected low and high with the default between"):
        Setting("LEV", 1.0, **limits)  # type: ignore[arg-type]


@pytest.mark.parametrize(("header", "count"), [("A", 0), ("A<1-4>:B", 1), ("A<2-2>:B", 2)])
def test_method_that_contradicts_its_header_is_refused(header: str, count: int) -> None:
    parameters = [Number()] * count
    with pytest.raises(TypeError, match=rf"is called with \d arguments by '{header}'"):
        command(header, *parameters)(lambda _self, _one, _two, _three: None)


@pytest.mark.parametrize("wire", WIRES)
def test_the_example_is_there_on_every_wire(wire: str) -> None:
    manager = pyvisa.ResourceManager("@py")
    with serving(MAGNET, f"Magnet:{wire}", "second=Magnet") as server:
        (place,) = server.wires["Magnet"].places
        magnet: Any = manager.open_resource(place, timeout=30_000)
        magnet.read_termination = magnet.write_termination = "\n"
        magnet.write("RAMP")
        assert magnet.query("SYST:ERR?").strip() == '-221,"Settings conflict"'
        magnet.write("CURR 1;:OUTP ON;:CURR:RATE 10;:RAMP")
        assert 0.0 <= float(magnet.query("MEAS:CURR?")) <= 1.0
        assert magnet.query("*IDN?").strip() == "ACME,MAGNET,1,1.0"
        magnet.close()
    manager.close()


def test_its_terminals_are_on_nodes(tmp_path: Path) -> None:
    text = (RACK / "simrack_tests" / "test_own.py").read_text(encoding="utf-8")
    body = text[text.index("class Box") : text.index("@pytest.fixture")]
    (tmp_path / "box.py").write_text(
        "from simrack.own import OwnInstrument, Setting, command, query\nfrom simrack.scpi import Number\n\n" + body
    )
    rack = Rack.build(VirtualClock(), plan_of([str(tmp_path / "box.py"), "34461A"]))
    box = rack.devices["Box"]
    assert rack.plan.places[1].terminals == {"sense": "output", "drive": "Box.drive"}
    rack.world.leads["Box"].connect("sense", "Box.drive")
    box.write(b"LEV 3;:SENS?\n")
    assert box.read(100)[0] == b"+3.00000000E+00\n"


def test_a_file_without_either_says_what_it_may_define(tmp_path: Path) -> None:
    (tmp_path / "none.py").write_text("")
    with pytest.raises(ValueError, match="expected CIRCUIT"):
        plan_of([str(tmp_path / "none.py")])


def test_the_instrument_of_the_page_is_the_example() -> None:
    page = (RACK / "docs" / "own.md").read_text(encoding="utf-8")
    example = re.sub(r' -> \w+|^ +""".*"""\n+', "", Path(MAGNET).read_text(encoding="utf-8"), flags=re.MULTILINE)
    shown = page[page.index("class Magnet") : page.index("```\n\n```sh")]
    assert example[example.index("class Magnet") :] == shown
    assert len(page[page.index("from simrack.own") : page.index("```\n\n```sh")].splitlines()) <= 30


def frame(*body: int) -> bytes:
    begun = bytes((0xAA, len(body), *body))
    return begun + bytes((sum(begun) & 0xFF,))


BOXES = {
    "balance": [(b"S\r\n", b"S D     120.00 g\r\n"), (b"T\n", b"T S     120.00 g\r\n"), (b"\r\nX\r", b"ES\r\n")],
    "pump": [
        (b"\x00\x11" + frame(2, 1, 44), frame(1, 1, 44)),
        (frame(1)[:-1] + b"\x00" + frame(1), frame(1, 1, 44)),
        (frame(2, 13, 10), frame(1, 13, 10)),
    ],
    "barometer": [(b"", b"P=1013.25 hPa T=23.0 C\r\n"), (b"hello\r\n", b"P=1013.26 hPa T=23.0 C\r\n")],
}


@pytest.mark.parametrize("name", BOXES)
def test_custom_box_replies_for_any_split_of_bytes(name: str) -> None:
    rack = Rack.build(VirtualClock(), plan_of([str(RACK / "examples" / f"{name}.py")]))
    box, clock = rack.devices[name.title()], rack.world.clock
    for said, answer in BOXES[name]:
        for byte in said:
            box.write(bytes((byte,)))
        while not (heard := box.read(100)[0]):
            clock.sleep_until(box.wake_at() or 0.0)
        assert heard == answer


@pytest.mark.parametrize("name", BOXES)
def test_a_box_of_ones_own_is_served_on_a_socket(name: str) -> None:
    with serving(str(RACK / "examples" / f"{name}.py")) as server:
        place = server.wires[name.title()].tcp or ""
        with socket.create_connection(("127.0.0.1", int(place.split("::")[2])), timeout=10) as connection:
            for said, answer in BOXES[name][: 1 if name == "barometer" else None]:
                connection.sendall(said)
                assert connection.recv(100)[-len(answer) :][:2] == answer[:2]


def test_a_box_is_on_byte_streams_alone() -> None:
    with pytest.raises(ValueError, match="Balance can be on tcp, pty, not on 'gpib3'"):
        plan_of([str(RACK / "examples" / "balance.py"), "Balance:gpib3"])
