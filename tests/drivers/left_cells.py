"""What a last user can leave in each model: one cell for each other value of each setting."""

from __future__ import annotations

from msgspec import Struct

from tests.drivers.boxes import GENERATORS, METERS, SCOPES


class Left(Struct, frozen=True):
    """What was typed, which of it the refusal names where it is no driver's to set, and whether it changes a number."""

    words: tuple[str, ...]
    named: str = ""
    idle: bool = False
    """Nothing of it is to be seen, even where it stays."""


def left(*words: str, named: str = "", idle: bool = False) -> Left:
    return Left(words, named, idle)


_OF_ALL = (left("REAR", named="terminals"), left("60 HZ", named="mains_hz", idle=True))
_CONFIGURED = (
    *(left(f"CONF:VOLT:DC {volts}", idle=True) for volts in ("0.1", "1000")),
    left("CONF:RES", idle=True),
    left("CONF:VOLT:AC", idle=True),
    left("CONF:FREQ", idle=True),
)
_TRIGGERS = (
    *(left(f"TRIG:SOUR {source}", idle=True) for source in ("BUS", "EXT")),
    *(left(words, idle=True) for words in ("TRIG:DEL 5", "TRIG:COUN 3", "SAMP:COUN 7", "TRIG:DEL:AUTO OFF")),
)
_HP = (
    *_CONFIGURED,
    *_TRIGGERS,
    *(left(f"CALC:FUNC {word};:CALC:STAT ON", idle=True) for word in ("NULL", "DB", "DBM", "AVER", "LIM")),
    left("INP:IMP:AUTO ON", idle=True),
    left("ZERO:AUTO OFF", idle=True),
    left("DET:BAND 3", idle=True),
    left("DISP OFF", idle=True),
    left("VOLT:DC:RANG:AUTO ON", idle=True),
    left('DATA:FEED RDG_STORE,""', idle=True),
)
_TRUEVOLT = (
    *_CONFIGURED,
    *_TRIGGERS,
    left("CALC:SCAL:FUNC SCAL;GAIN 2;OFFS 0;:CALC:SCAL:STAT ON", idle=True),
    left("CALC:SCAL:FUNC SCAL;GAIN 1;OFFS 0.5;:CALC:SCAL:STAT ON", idle=True),
    *(left(f"CALC:SCAL:FUNC {word};REF 1;:CALC:SCAL:STAT ON", idle=True) for word in ("DB", "DBM", "PCT", "NULL")),
    *(left(f"CALC:{each}:STAT ON", idle=True) for each in ("LIM", "AVER")),
    left("CALC:SMO:RESP SLOW;STAT ON", idle=True),
    left("FORM REAL", idle=True),
    left("VOLT:DC:NULL ON;NULL:VAL 1", idle=True),
    left("VOLT:DC:IMP:AUTO ON", idle=True),
    left("VOLT:DC:ZERO:AUTO OFF", idle=True),
    left("VOLT:DC:RANG:AUTO ON", idle=True),
    left("DISP OFF", idle=True),
)
_2000 = (
    *(left(f"CONF:{each}", idle=True) for each in ("RES", "VOLT:AC", "FREQ", "TEMP")),
    *(left(f"TRIG:SOUR {source}", idle=True) for source in ("BUS", "EXT")),
    *(left(words, idle=True) for words in ("TRIG:DEL 5", "TRIG:COUN 3", "SAMP:COUN 7", "TRIG:DEL:AUTO OFF")),
    left("INIT:CONT ON", idle=True),
    left("CALC:FORM MXB;KMAT:MMF 2;MBF 0;:CALC:STAT ON", idle=True),
    left("CALC:FORM MXB;KMAT:MMF 1;MBF 0.5;:CALC:STAT ON", idle=True),
    left("CALC:FORM PERC;KMAT:PERC 1;:CALC:STAT ON", idle=True),
    left("UNIT:VOLT:DC DB"),
    left("UNIT:VOLT:DC DBM"),
    left("HOLD:STAT ON"),
    left("VOLT:REF 1;REF:STAT ON", idle=True),
    left("VOLT:AVER:TCON MOV;COUN 100;STAT ON", idle=True),
    left("VOLT:DIG 4", idle=True),
    left("SYST:AZER:STAT OFF", idle=True),
    left("FORM:ELEM READ,UNIT,RNUM"),
    left("TRAC:POIN 2;FEED CALC;FEED:CONT NEXT", idle=True),
)
_DMM6500 = (
    *(left(f'FUNC "{each}"', idle=True) for each in ("RES", "VOLT:AC", "FREQ:VOLT", "TEMP", "VOLT:DC:RAT")),
    left("CALC:VOLT:MATH:FORM MXB;MMF 2;MBF 0;STAT ON"),
    left("CALC:VOLT:MATH:FORM MXB;MMF 1;MBF 0.5;STAT ON"),
    left("CALC:VOLT:MATH:FORM PERC;PERC 1;STAT ON"),
    left("CALC:VOLT:MATH:FORM REC;STAT ON"),
    left("VOLT:UNIT DB"),
    left("VOLT:UNIT DBM"),
    left("VOLT:REL 1;REL:STAT ON"),
    left("VOLT:AVER:TCON MOV;COUN 100;STAT ON", idle=True),
    left("VOLT:LINE:SYNC ON", idle=True),
    left("VOLT:DEL:AUTO OFF", idle=True),
    left("VOLT:INP AUTO", idle=True),
    left("VOLT:AZER OFF", idle=True),
    left('DIG:FUNC "VOLT"', idle=True),
    left("FORM:ASC:PREC 1"),
    left("COUN 5", idle=True),
    left('TRAC:POIN 10,"defbuffer1"'),
    left('TRAC:FILL:MODE ONCE,"defbuffer1";:TRAC:POIN 10,"defbuffer1";:COUN 10;:TRAC:TRIG "defbuffer1"'),
)
OF_METERS = {"34401A": _HP, "34461A": _TRUEVOLT, "34465A": _TRUEVOLT, "2000": _2000, "DMM6500": _DMM6500}
EXTRA = {"34465A": (left("SAMP:SOUR TIM;TIM 2", idle=True),)}
CELLS = [
    (model, each)
    for model in METERS
    for each in (*OF_METERS[model], *EXTRA.get(model, ()), *_OF_ALL)
    if (model, each.words) != ("34401A", ("60 HZ",))  # which it cannot be asked for
]


_MODULATED = ("AM:DEPT 50;INT:FREQ 7;:AM:STAT ON", "FM:DEV 10;STAT ON", "PM:DEV 90;STAT ON", "FSK:FREQ 50;STAT ON")
_OF_A_SINE = (
    *(left("FUNC SIN", each) for each in _MODULATED),
    left("FUNC PULS", "PWM:STAT ON"),
    left("FUNC SIN", "FREQ:STAR 1;STOP 1000;:SWE:STAT ON"),
    left("FUNC SIN", "BURS:NCYC 1;INT:PER 1;:BURS:STAT ON"),
    left("FUNC SIN", "TRIG:SOUR BUS;:BURS:NCYC 5;STAT ON"),
)
_GENERATOR = (
    *_OF_A_SINE,
    left("OUTP:POL INV"),
    left("VOLT:OFFS 0", "VOLT:RANG:AUTO OFF", "FUNC DC", "VOLT:OFFS 5", "VOLT:RANG:AUTO OFF"),
    left("VOLT:UNIT DBM"),
    left("VOLT:UNIT VRMS", idle=True),
    left("OUTP:LOAD 50", idle=True),
    left("OUTP:LOAD 1000", "VOLT:OFFS 1", idle=True),
    left("OUTP:SYNC OFF", idle=True),
    left("OUTP:TRIG ON", idle=True),
    left("UNIT:ANGL RAD", idle=True),
    left("FUNC NOIS", "OUTP ON"),
    left("FUNC SIN", "VOLT 5", "OUTP ON"),
    *(left(f"FUNC {each}", idle=True) for each in ("SQU", "RAMP", "PULS", "USER", "DC")),
)
_TRUEFORM = (
    *_OF_A_SINE,
    left("FUNC SIN", "BPSK:STAT ON"),
    left("FUNC SIN", "SUM:AMPL 20;INT:FREQ 50;:SUM:STAT ON"),
    left("OUTP1:LOAD INF", "VOLT:LIM:HIGH 1;LOW -1;STAT ON"),
    left("OUTP1:LOAD 50", "VOLT:LIM:HIGH 1;LOW -1;STAT ON"),
    left("OUTP1:POL INV"),
    left("OUTP1:MODE GAT"),
    left("VOLT:RANG:AUTO OFF"),
    left("FREQ:MODE LIST", idle=True),
    left("VOLT:UNIT DBM", idle=True),
    left("VOLT:UNIT VRMS", idle=True),
    *(left(f"OUTP2:LOAD INF;:SOUR2:FUNC {each};VOLT:OFFS 1;:SOUR1:COMB:FEED CH2") for each in ("DC", "SIN")),
    *(left(f"SOUR{n}:TRAC {each}") for n, each in ((1, "ON"), (1, "INV"))),
    left("SOUR2:TRAC ON", idle=True),
    left("SOUR1:VOLT:COUP:STAT ON"),
    left("SOUR1:FREQ:COUP:STAT ON"),
    left("FUNC SIN", "VOLT 5", "OUTP1 ON"),
    *(left(f"FUNC {each}", idle=True) for each in ("SQU", "RAMP", "TRI", "PULS", "ARB", "PRBS", "DC")),
)
OF_GENERATORS = [
    (model, each) for model, cells in zip(GENERATORS, (_GENERATOR, _TRUEFORM), strict=True) for each in cells
]

OF_SCOPES = [
    (model, cell)
    for model in SCOPES
    for cell in (
        left(":CHAN1:INV 1"),
        left(":CHAN1:PROB 10", named="probe factor"),
        left(":CHAN1:UNIT AMP", idle=True),
        left(":CHAN1:BWL 1", idle=True),
        left(":CHAN1:PROB:SKEW 1E-7", idle=True),
        left(":CHAN1:COUP AC", idle=True),
        left(":CHAN1:OFFS 3", idle=True),
        left(":CHAN1:SCAL 0.01;OFFS 0.04", idle=True),
        left(":CHAN1:DISP 0;:CHAN2:DISP 1;:CHAN3:DISP 1;:CHAN4:DISP 1", idle=True),
        left(":ACQ:MODE SEGM", idle=True),
        left(":ACQ:MODE ETIM", idle=True),
        left(":ACQ:TYPE AVER;COUN 4096", idle=True),
        left(":ACQ:TYPE PEAK", idle=True),
        *(left(f":TIM:MODE {each}", idle=True) for each in ("WIND", "XY", "ROLL")),
        *(left(f":TIM:REF {each}", idle=True) for each in ("LEFT", "RIGH")),
        left(":TIM:POS 1E-3", idle=True),
        *(left(f":TRIG:MODE {each}", idle=True) for each in ("GLIT", "TV")),
        left(":TRIG:SWE NORM", idle=True),
        left(":TRIG:EDGE:SOUR EXT;SLOP NEG", idle=True),
        left(":TRIG:HOLD 5"),
        left(":TRIG:EDGE:COUP AC"),
        left(":TRIG:EDGE:REJ LF", idle=True),
        left(":TRIG:HFR 1", idle=True),
        left(":TRIG:NREJ 1", idle=True),
        left(":MEAS:DEF THR,ABS,0.3,0.2,0.1", idle=True),
        left(":WAV:VIEW ALL", idle=True),
        left(":WAV:BYT MSBF;FORM WORD;UNS 0", idle=True),
        left(":FUNC:DISP 1", idle=True),
        left(":RUN", idle=True),
        left(":SYST:LOCK 1", idle=True),
    )
]
CLIPPED = left(":CHAN1:SCAL 0.01;OFFS 0.5")
"""With it a level of 0.5 V is not on the screen until the channel is set."""

OF_SUPPLIES = [
    *(
        ("E3631A", cell)
        for cell in (
            left("OUTP:TRAC ON", idle=True),
            left("INST:SEL P25V;:VOLT 20;:CURR 1;:OUTP ON", idle=True),
            left("INST:SEL P6V;:VOLT 5;:CURR 5;:OUTP ON", idle=True),
            left("VOLT:TRIG 3;:TRIG:SOUR BUS;:INIT", idle=True),
            left("INST:COUP:TRIG ALL", idle=True),
            left("DISP OFF", idle=True),
        )
    ),
    *(
        ("E36312A", cell)
        for cell in (
            left("VOLT:PROT 6,(@2);:VOLT:PROT:STAT ON,(@2)"),
            left("VOLT:PROT 6,(@2);:VOLT:PROT:STAT ON,(@2);:VOLT 8,(@2);:OUTP ON,(@2)"),
            left("CURR:PROT:STAT ON,(@2)", idle=True),
            left("OUTP:DEL:RISE 5,(@2)"),
            left("OUTP:DEL:RISE 3600,(@1,2,3)"),
            left("OUTP:PAIR SER"),
            left("OUTP:PAIR PAR"),
            left("OUTP:TRAC ON"),
            left("OUTP:COUP:CHAN ALL"),
            left("OUTP:COUP:CHAN CH1,CH2"),
            left("VOLT:SENS EXT,(@2)"),
            left("VOLT 20,(@2);:CURR 1,(@2);:OUTP ON,(@1,2)"),
            left("INST:SEL CH3", idle=True),
        )
    ),
]
