"""External input, calibration, files, setups: replies in the shape of the siblings' guides."""

from __future__ import annotations

import pytest

from simrack_tests.instruments.dso7104b.bench import Bench

REPLIES = {
    ":EXT?": ":EXT:BWL 0;RANG +8E+00;UNIT VOLT;PROB +1.000E+00",  # 2000 X guide p. 271, after *RST
    ":EXT:UNIT AMP;UNITs?;PROB 10;PROB?": "AMP;+1.00000000E+001",
    ":CAL:DATE?;TIME?": "+1,+1,+2026;+12,+0,+0",
    ":CAL:LAB 'bench 1';LAB?": '"bench 1"',
    ":CAL:STAT?": '+0,"Calibrated"',
    ":CAL:SWIT?;TEMP?": "UNPR;+0.00000000E+000",
    ":SAVE?": ':SAVE:FIL "";PWD ""',
    ":SAVE:FIL 'run';FIL?;:SAVE:WAV:FORM CSV;FORM?;LENG?": '"run";CSV;+1000',
    ":RECall?": ':REC:FIL "";PWD ""',
    ":DISP:SOUR?;SOUR PMEM3;SOUR?": "PMEM0;PMEM3",
    ":DISP?": ":DISP:LAB 0;CONN 1;PERS MIN;SOUR PMEM0",
    ":SYST?": ":SYST:LOCK 0;PROT:LOCK 0",
    ":MEAS:DEF? THR;DEF? DEL": "THR,PERC,+9.00000000E+001,+5.00000000E+001,+1.00000000E+001;DEL,+1,+1",
    ":MEAS:DEF THR,ABS,3,2,1;DEF? THR": "THR,ABS,+3.00000000E+000,+2.00000000E+000,+1.00000000E+000",
}


@pytest.mark.parametrize(("asked", "reply"), REPLIES.items())
def test_replies_to_the_character(asked: str, reply: str) -> None:
    bench = Bench()
    assert bench.ask(asked) == reply
    assert bench.errors() == []


@pytest.mark.parametrize("command", [":SAVE:WAV 'run'", ":SAVE:IMAG", ":SAVE:SET:STAR", ":REC:SET 'run'"])
def test_there_is_no_usb_stick(command: str) -> None:
    bench = Bench()
    bench.send(command)
    assert bench.ask(":SYST:ERR?") == '-252,"Missing media"'


@pytest.mark.parametrize("word", [":SAVE:SET", ":SAVE:SETup:STARt", "*SAV"])
def test_a_setup_is_kept_in_a_place_by_either_word(word: str) -> None:
    bench = Bench()
    bench.send(f":CHAN1:OFFS 1;{word} 3;:CHAN1:OFFS 2;:REC:SET 3")
    assert float(bench.ask(":CHAN1:OFFS?")) == 1.0
    bench.send(":CHAN1:OFFS 2;*RCL 3")
    assert float(bench.ask(":CHAN1:OFFS?")) == 1.0
    assert bench.errors() == []
    bench.send(f"{word} 10")
    assert bench.ask(":SYST:ERR?").startswith("-222")


@pytest.mark.parametrize("subsystem", ["EXTernal", "SAVE", "RECall", "DISPlay", "SYSTem"])
def test_what_a_subsystem_tells_of_itself_can_be_sent_back(subsystem: str) -> None:
    bench = Bench()
    answer = bench.ask(f":{subsystem}?")
    bench.send(answer)
    assert bench.errors() == []
    assert bench.ask(f":{subsystem}?") == answer


def test_the_setup_is_an_opaque_block_of_characters() -> None:
    bench = Bench()
    bench.send(":CHAN2:LAB 'SENSE';:TIM:RANG 2E-3;:EXT:PROB 5")
    setup = bench.raw(":SYST:SET?")[:-1]
    assert setup[:2] == b"#8"
    assert int(setup[2:10]) == len(setup) - 10
    # PyMeasure reads it as a line of text and sends it back as one
    assert setup.isascii()
    assert b"\n" not in setup
    assert b"TIM" not in setup
    bench.send("*RST")
    bench.scope.write(b":SYST:SET " + setup + b"\n")
    assert bench.raw(":SYST:SET?")[:-1] == setup
    assert bench.ask(":CHAN2:LAB?;:EXT:PROB?") == '"SENSE";+5.00000000E+000'
    bench.scope.write(b":SYST:SET #15hello\n")
    assert bench.errors() == [-161]
    learned = bench.raw("*LRN?")[:-1]
    assert learned == b":SYST:SET " + setup
    bench.scope.write(learned + b"\n")
    assert bench.errors() == []
