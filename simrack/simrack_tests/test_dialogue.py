"""Files of pyvisa-sim: every question that its own files know, and wrong ones, answered as it answers them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import pyvisa
from simrack.clock import VirtualClock
from simrack.dialogue import DialogueFile
from simrack.plan import plan_of
from simrack.wired import WiredWorld

from simrack_tests.test_rack import serving

pytest.importorskip("yaml")
OWN = """\
spec: "1.1"
devices:
  psu:
    eom:
      TCPIP SOCKET: {q: "\\n", r: "\\n"}
    error: {error_queue: [{q: "ERR?", default: "0", command_error: "1, what"}]}
    dialogues:
      - {q: "*IDN?", r: "ACME,PSU"}
    properties:
      level:
        default: 1.0
        getter: {q: "V?", r: "{:.2f}"}
        setter: {q: "V {:.2f}", r: "OK"}
        specs: {type: float, min: 0, max: 5}
resources:
  GPIB::3::INSTR: {device: psu}
  TCPIP::somewhere::5025::SOCKET: {device: psu}
"""


@pytest.fixture
def own(tmp_path: Path) -> Path:
    (tmp_path / "psu.yaml").write_text(OWN)
    return tmp_path / "psu.yaml"


def shipped() -> list[Path]:
    try:
        import pyvisa_sim  # noqa: PLC0415  (a library of the tests alone)
    except ImportError:
        return []
    return sorted(Path(pyvisa_sim.__file__).parent.rglob("*.yaml"))


def questions(said: dict[str, Any]) -> list[str]:
    """Return each dialogue and getter, each setter with values of every kind, registers, queues, and what is none."""
    channels = list(said.get("channels", {}).values())
    asked = ["NOSUCH", "?", "*IDN?;*IDN?"]
    for part in (said, *channels):
        ids = part.get("ids", [""])
        texts = [each["q"] for each in part.get("dialogues", ())]
        for each in part.get("properties", {}).values():
            texts += [each["getter"]["q"]] if "getter" in each else []
            form = each.get("setter", {}).get("q", "")
            values = ("1", "1.0", "2.50", "0", "1e3", "-3.0", "99999.0", "P25V", "2", "abc")
            for value in values if form else ():
                texts += [re.sub(r"\{(?!ch_id)[^}]*\}", value, form), each.get("getter", {}).get("q", "?")]
        asked += [text.replace("{ch_id}", str(number)) for number in (*ids, "9") for text in texts]
    error = said.get("error", {})
    kinds = () if isinstance(error, str) else ("status_register", "error_queue")
    also = [each["q"] for kind in kinds for each in error.get(kind, ())]
    return [*asked, *also, *also, *asked, *also]


@pytest.mark.skipif(not shipped(), reason="pyvisa-sim is not installed")
@pytest.mark.parametrize("file", shipped() or [Path()], ids=lambda file: file.stem)
def test_queries_of_files_are_answered_like_pyvisa_sim(file: Path) -> None:
    from pyvisa_sim.parser import get_devices  # noqa: PLC0415  (a library of the tests alone)

    theirs, ours = get_devices(str(file), bundled=False), DialogueFile(file)
    compared = 0
    for name, said in ours.said["devices"].items():
        for resource, make in ours.by_resource(re.sub(r"\W+", "_", name)).items():
            device, other = make(WiredWorld(VirtualClock())), theirs[resource]
            end = other._query_eom
            for question in questions(said):
                device.write(question.encode() + end)
                answer = device.read(10_000)[0]
                while more := device.read(10_000)[0]:
                    answer += more
                try:
                    other.write(question.encode() + end)
                except Exception:  # noqa: BLE001, S112  (its own mistakes: formats that do not fit, RANDOM that is none)
                    continue
                known = b""
                while part := other.read()[0]:
                    known += part
                if "RANDOM" in str(said) and re.fullmatch(rb"[-\d., ]+\n", known):
                    assert re.sub(rb"[\d.-]+", b"#", answer) == re.sub(rb"[\d.-]+", b"#", known)
                else:
                    assert answer == known, (resource, question)
                compared += 1
    assert compared > 100


def test_a_file_is_a_bench_with_its_own_names(own: Path) -> None:
    manager = pyvisa.ResourceManager(f"{own}?speed=max@simrack")
    assert manager.list_resources("?*") == ("GPIB0::3::INSTR", "TCPIP0::somewhere::5025::SOCKET")
    supply: Any = manager.open_resource("GPIB0::3::INSTR")
    supply.read_termination = supply.write_termination = "\n"
    assert supply.query("*IDN?") == "ACME,PSU"
    assert supply.query("V 2.50") == "OK"
    assert supply.query("V?") == "2.50"
    supply.write("V 7.50")
    assert [supply.query("ERR?"), supply.query("ERR?")] == ["1, what", "0"]
    other: Any = manager.open_resource("TCPIP0::somewhere::5025::SOCKET", read_termination="\n", write_termination="\n")
    assert other.query("V?") == "1.00"
    manager.close()


def test_a_file_is_served(own: Path) -> None:
    manager = pyvisa.ResourceManager("@py")
    with serving(str(own), "34461A:tcp") as server:
        supply: Any = manager.open_resource(str(server.wires["psu"].tcp), read_termination="\n", write_termination="\n")
        assert supply.query("*IDN?") == "ACME,PSU"
        supply.close()
    manager.close()


@pytest.mark.parametrize(("text", "said"), [("a: 1", 'with spec: "1.1"'), ("- 1", 'with spec: "1.1"')])
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "none.yaml").write_text(text)
    with pytest.raises(ValueError, match=re.escape(said)):
        plan_of([str(tmp_path / "none.yaml")])
