"""Benches in a file: nodes by name, loads, faults, and what is refused."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import pyvisa
from simrack.bench_file import plan_in, planned
from simrack.clock import VirtualClock
from simrack.models import RACK
from simrack.rack import Rack, served
from simrack.serve import BenchServer, ServedClock, ServerSettings

if TYPE_CHECKING:
    from collections.abc import Callable

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    def written(text: str) -> Path:
        (tmp_path / "bench.toml").write_text(text)
        return tmp_path / "bench.toml"

    return written


def asked(rack: Rack, name: str, message: str, seconds: float = 5.0) -> str:
    rack.devices[name].write(message.encode() + b"\n")
    rack.world.clock.sleep_until(rack.world.clock.now() + seconds)
    return rack.devices[name].read(1000)[0].decode().strip()


def test_the_page_shows_the_example() -> None:
    page = (EXAMPLES.parent / "docs" / "bench.md").read_text(encoding="utf-8")
    _, _, shown = (EXAMPLES / "bench.toml").read_text(encoding="utf-8").partition("\n\n")
    assert f"```toml\n{shown}```" in page


@pytest.mark.parametrize("name", [name for name, model in RACK.items() if model.outputs])
def test_every_output_of_every_model_feeds_its_node(written: Callable[[str], Path], name: str) -> None:
    """The first meter looks at each output in turn: E3631A's third is negative, all others are not."""
    outputs = RACK[name].outputs
    nodes = "".join(f'{each} = "n{each[-1]}"\n' for each in outputs)
    rack = Rack.build(
        VirtualClock(),
        plan_in(written(f'[instruments.a]\nmodel = "{name}"\n{nodes}[instruments.m]\nmodel = "34461A"\n')),
    )
    usual = (
        "OUTP{0}:LOAD INF;:SOUR{0}:APPL:DC DEF,DEF,{0}" if len(outputs) > 1 else "OUTP:LOAD INF;:APPL:DC DEF,DEF,{0}"
    )
    supplies = {
        "E3631A": "APPL P6V,{0};:APPL P25V,{0};:APPL N25V,-{0};:OUTP ON",
        "E36312A": "VOLT {0},(@1,2,3);:OUTP ON,(@1,2,3)",
    }
    words = supplies.get(name, usual)
    for number, output in enumerate(outputs, start=1):
        asked(rack, "a", words.format(number))
        node = next(each for each in (f"n{number}", f"rail_n{number}") if each in rack.world.nodes)
        rack.world.leads["m"].connect("input", node)
        sign = -1 if (name, output) == ("E3631A", "output_3") else 1
        assert float(asked(rack, "m", "MEAS:VOLT:DC?")) == pytest.approx(sign * number, abs=1e-3), output


@pytest.mark.parametrize(("name", "terminal"), [(name, each) for name, model in RACK.items() for each in model.inputs])
def test_every_input_of_every_model_sees_its_node(written: Callable[[str], Path], name: str, terminal: str) -> None:
    bench = f'[instruments.a]\nmodel = "{name}"\n{terminal} = "-x"\n[instruments.g]\nmodel = "33511B"\noutput_1 = "x"\n'
    rack = Rack.build(VirtualClock(), plan_in(written(bench)))
    asked(rack, "g", "OUTP:LOAD INF;:APPL:DC DEF,DEF,1.5")
    if RACK[name].kind == "oscilloscope":
        channel = terminal[-1]
        asked(rack, "a", f"*RST;:CHAN{channel}:DISP ON;:CHAN{channel}:SCAL 1;:DIG CHAN{channel}")
        asked(rack, "a", ":TRIG:FORC")
        shown = asked(rack, "a", f":MEAS:VAV? CHAN{channel}")
    else:
        shown = asked(rack, "a", "MEAS:VOLT:DC?")
    assert float(shown) == pytest.approx(-1.5, abs=0.05)


def test_loads_are_felt_and_shown(written: Callable[[str], Path]) -> None:
    bench = written(
        '[instruments.g]\nmodel = "33511B"\noutput_1 = "x"\n[instruments.s]\nmodel = "E36312A"\noutput_1 = "y"\n'
        "[loads]\nx = 50.0\ny = 10.0\n"
    )
    rack = Rack.build(VirtualClock(), plan_in(bench))
    asked(rack, "g", "OUTP:LOAD INF;:APPL:DC DEF,DEF,2")
    assert rack.world.value_v("x") == pytest.approx(1.0)
    asked(rack, "s", "VOLT 5,(@1);:OUTP ON,(@1)")
    assert float(asked(rack, "s", "MEAS:CURR? (@1)")) == pytest.approx(0.5, abs=1e-3)
    with BenchServer(served(ServedClock(math.inf), plan_in(bench)), ServedClock(math.inf), ServerSettings()) as server:
        assert server.get("node.x.load_ohm") == 50.0
        assert server.get("rail.y.load_ohm") == 10.0
        assert server.set("node.x.load_ohm", None) is None


def test_faults_and_the_seed_are_those_of_the_file(written: Callable[[str], Path]) -> None:
    file = written(
        'seed = 3\n[instruments.m]\nmodel = "34401A"\n'
        '[[fault]]\ninstrument = "m"\nkind = "identity"\nidentity = "A,B,C,D"\n'
    )
    manager = pyvisa.ResourceManager(f"{file}?speed=max@simrack")
    assert manager.open_resource("GPIB0::1::INSTR").query("*IDN?").strip() == "A,B,C,D"  # type: ignore[attr-defined]
    manager.close()
    assert served(ServedClock(math.inf), plan_in(file)).seed == 3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[instrument.a]", "the file: expected seed, instruments, circuits, loads, fault, got instrument"),
        ('[instruments.a]\nmodel = "34402A"', "instruments.a: unknown model '34402A'"),
        ("[instruments.a]", "instruments.a: instruments.a.model: expected a text, got None"),
        (
            '[instruments.a]\nmodel = "33522B"\noutput_3 = "x"',
            "instruments.a: expected model, wires, file, output_1, output_2, got output_3",
        ),
        ('[instruments.a]\nmodel = "34461A"\nwires = ["gpib"]', "instruments.a: 34461A can be on tcp"),
        ("[loads]\nx = -1.0", "loads.x: expected ohms above 0, got -1.0"),
        ('[[fault]]\ninstrument = "a"\nkind = "nothing"', "fault 1: a fault is one of"),
        ('[circuits.a]\noutput = "x"', "circuits.a.input: expected a text, got None"),
        ("seed = ", "Invalid value"),
        ('seed = "x"', "seed: expected a whole number from 0 on, got 'x'"),
        ('[instruments."a b"]\nmodel = "34461A"', "instruments.a b: expected a name of letters"),
        ('[instruments.a]\nmodel = "E36312A"\noutput_1 = "-"', "a.output_1: expected the name of a node, got '-'"),
        ('[instruments.a]\nmodel = "33511B"\noutput_1 = "-x"', "a.output_1: expected the name of a node, got '-x'"),
    ],
)
def test_what_no_bench_has_is_refused_with_its_place(written: Callable[[str], Path], text: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        plan_in(written(text))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '[instruments.a]\nmodel = "33511B"\noutput_1 = "x"\n[instruments.b]\nmodel = "33511B"\noutput_1 = "x"',
            "a.output_1 and b.output_1 both feed 'x'",
        ),
        ('[instruments.a]\nmodel = "34461A"\ninput = "x"', "a.input: expected a node with a source, "),
        (
            '[instruments.a]\nmodel = "33511B"\noutput_1 = "x"\n[circuits.b]\ninput = "y"\noutput = "x"',
            "'x' is the output of a circuit, and something else feeds it",
        ),
        ('[circuits.a]\ninput = "x"\noutput = "y"\n[circuits.b]\ninput = "y"\noutput = "z"', "begins at 'y'"),
        (
            '[instruments.a]\nmodel = "E36312A"\noutput_1 = "x"\n[circuits.b]\ninput = "x"\noutput = "y"',
            "a supply feeds 'x', and a circuit or a generator too",
        ),
    ],
)
def test_wires_that_cannot_be_are_refused(written: Callable[[str], Path], text: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        Rack.build(VirtualClock(), plan_in(written(text)))


def test_a_bench_file_stands_alone() -> None:
    with pytest.raises(ValueError, match="describes the whole bench"):
        planned(["bench.toml", "34461A"])
