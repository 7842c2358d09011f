"""Draws of a seed: a bench, a procedure with short settings, and happenings to the run."""

import math
from collections.abc import Mapping
from random import Random
from typing import Any, Literal, get_args

from msgspec import Struct
from msgspec.structs import replace
from simrack.faults import Fault, Kind

from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.gyro.data_sheet import DataSheet, settling_s
from vcfbench.station.description import BenchDescription
from vcfbench.testing.gyroscopes import drawn_bench, drawn_sheet

What = Literal["fault", "kill", "power cut", "signal", "starter", "clock", "disk full", "sync fails"]
_ENDS = frozenset({"kill", "power cut"})
"""Happenings that a program does not survive."""

TOGETHER = 10
"""Seeds in a row on the same bench, with the same work."""
LANGUAGES = ("acl", "zaber", "atl", "esp", "dd16", "mn_as", "ruya", "aaaa")
_SPARE = frozenset({"ruya", "aaaa"})
"""Tables whose rate follows from angles."""
_SPARE_RANGE_DEG_S = 180.0
"""Range of a gyroscope that is turned by them, to a few deg/s."""
_METERS = ("34401A", "34461A", "34465A", "2000", "DMM6500")
_WIRES: Mapping[str, Mapping[str, str]] = {
    "direct": {},
    "table on RS-232": {"rate_table": "/dev/ttyS0"},
    "all on RS-232": {"rate_table": "/dev/ttyS0", "power": "ASRL1::INSTR", "multimeter": "ASRL2::INSTR"},
    "sockets": {"power": "TCPIP0::10.0.0.1::5025::SOCKET", "multimeter": "TCPIP0::10.0.0.2::5025::SOCKET"},
}
_RS232_METERS = ("34401A", "2000")
_OF_ROLE: Mapping[str, frozenset[str]] = {
    "power": frozenset({"current_limit"}),
    "multimeter": frozenset({"overload", "offset"}),
    "rate_table": frozenset(
        {
            *("interlock", "door", "emergency_stop", "drive_fault", "jam"),
            *("readback_zero", "readback_stuck", "readback_half", "readback_behind"),
        }
    ),
}
_OF_ONE = frozenset().union(*_OF_ROLE.values())
_SCPI_ONLY = frozenset({"error", "identity", "power_cycle"})
_ROLES = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table", "rate_table")
_TIME_CONSTANTS = 12.0
"""Of an output, in its settling time: readings closer than one share their noise, which few of them do not show."""


class Happening(Struct, frozen=True):
    """Something that happens to the program or to its bench after its start number `life`, from 0.

    `at` is when: the part of the clean run, in bench time, or, with `by_writes`, in operations of its disk. `size` is
    by how much a clock jumps (s), for how many operations a disk is full, how often synchronising fails.
    """

    life: int
    at: float
    what: What
    by_writes: bool = False
    size: float = 0.0
    fault: Fault | None = None

    @property
    def ends(self) -> bool:
        """True where the program does not survive it."""
        return self.what in _ENDS

    def describe(self) -> str:
        """Return in words the happening and its time."""
        where = f"start {self.life + 1}, {self.at:.1%} of its {'writes' if self.by_writes else 'time'}: "
        if self.fault is not None:
            return where + self.fault.describe()
        sizes = {"clock": f" {self.size:+.0f} s", "disk full": f" for {self.size:.0f} operations"}
        return where + self.what + sizes.get(self.what, f", {self.size:.0f} times" if self.size else "")


class Draw(Struct, frozen=True):
    """Draw of a seed; without its happenings it is its clean run."""

    seed: int
    specimens: int
    """Seed of the simulated bench."""
    gyroscope: int
    """Seed of its gyroscope."""
    language: str
    wires: str
    meter: str
    procedure: str
    settings: dict[str, Any]
    synchronised: bool
    """True where each line of the journal is synchronised, as on a real bench."""
    happenings: tuple[Happening, ...] = ()

    @property
    def lives(self) -> int:
        """Number of the program's starts."""
        return 1 + max((each.life + each.ends for each in self.happenings), default=0)

    def bench(self) -> BenchDescription:
        """Return the bench."""
        own = parse_bench(drawn_bench(self.gyroscope), f"gyroscope-{self.gyroscope}")
        assert own.rate_table is not None  # noqa: S101  # its file has one
        assert own.multimeter is not None  # noqa: S101
        steps = 16_000.0 / 9.0 if self.language == "zaber" else None
        roles: dict[str, Any] = {
            "rate_table": replace(own.rate_table, dialect=self.language, steps_per_deg=steps),
            "multimeter": replace(own.multimeter, model=self.meter),
            "power": own.power,
            "v_vc_meter": None,
        }
        for role, resource in _WIRES[self.wires].items():
            roles[role] = replace(roles[role], resource=resource)
        return replace(own, **roles, limits=replace(own.limits, max_acceleration_deg_s2=1000.0))

    def describe(self) -> list[str]:
        """Return it in lines for a reader."""
        settings = ", ".join(f"{key} {value}" for key, value in self.settings.items())
        journal = "synchronised" if self.synchronised else "as simulated"
        work = f"{self.procedure} of gyroscope {self.gyroscope}"
        bench = f"{work} on {self.language}, meter {self.meter}, wires {self.wires}, journal {journal}"
        return [f"seed {self.seed}: {bench}", f"  {settings}", *(f"  {each.describe()}" for each in self.happenings)]


def drawn(seed: int) -> Draw:
    """Return the draw of `seed`: the bench and the work of the first of its ten, so that one clean run serves all."""
    draw, first = _drawn(seed), _drawn(seed - seed % TOGETHER)
    return replace(first, seed=seed, happenings=draw.happenings)


def _drawn(seed: int) -> Draw:
    random = Random(f"soak {seed}")  # noqa: S311  # faults, no secrets
    language = random.choice(LANGUAGES)
    wires = random.choices(tuple(_WIRES), (12, 2, 1, 5))[0]  # each character on RS-232 takes its time
    meter = random.choice(_RS232_METERS if wires == "all on RS-232" else _METERS)
    gyroscope = seed
    while language in _SPARE and drawn_sheet(gyroscope).range_deg_s < _SPARE_RANGE_DEG_S:
        gyroscope += 1_000_000
    sheet = drawn_sheet(gyroscope)
    procedure, settings = _work(random, language, sheet, 0.5 if wires == "all on RS-232" else random.choice((0.1, 0.5)))
    lives = random.choices((1, 2, 3), (5, 4, 1))[0]
    happenings = [_fault(random, life=random.randrange(lives)) for _ in range(random.randrange(6))]
    happenings += [_end(random, life) for life in range(lives - 1)]
    happenings += [_besides(random, random.randrange(lives)) for _ in range(random.choice((0, 0, 1, 1, 2, 3)))]
    happenings.sort(key=lambda each: (each.life, each.at))
    synchronised = random.random() < 0.5
    specimens = 1 + seed % 1000
    return Draw(
        seed, specimens, gyroscope, language, wires, meter, procedure, settings, synchronised, tuple(happenings)
    )


def _work(random: Random, language: str, sheet: DataSheet, interval_s: float) -> tuple[str, dict[str, Any]]:
    """Return a procedure and settings with which it is short; a reading every `interval_s`."""
    started_s = settling_s(sheet)[0]
    procedure = random.choices(("turntable", "virtual-coriolis", "zero", "polarity", "power"), (10, 7, 1, 1, 1))[0]
    if procedure == "zero":
        return procedure, {"duration_s": 200.0, "sample_interval_s": 1.0, "powered_s": max(10.0, started_s)}
    spare: dict[str, Any] = {"rate_tolerance_deg_s": 5.0} if language in _SPARE else {}
    if procedure == "power":
        return procedure, spare | {
            "warm_up_s": max(20.0, started_s),
            "log_s": 2.0,
            "off_s": 2.0,
            "cycles": 1,
            "samples": 3,
        }
    if procedure == "polarity":
        return procedure, spare | {"samples": 3}
    ends = language == "aaaa"  # the travel of its table does: too short for the steps of virtual-coriolis
    procedure = "turntable" if ends else procedure
    rates = (20.0, 10.0, 0.0, -10.0, -20.0) if ends else (60.0, 20.0, 0.0, -20.0, -60.0)
    few, size = random.random() < 0.5, min(sheet.range_deg_s, 100.0 if ends else math.inf) / 200.0
    interval_s = max(interval_s, settling_s(sheet)[1] / _TIME_CONSTANTS)
    settings: dict[str, Any] = {
        "rates_deg_s": [rate * size for rate in (rates[1:-1] if few else rates)],
        "samples": random.randrange(3, 7),
        "sample_interval_s": interval_s,
        "order": random.choice(("paper", "alternate", "abba", "loop")),
        "zeros": random.choice(("none", "ends", "bracket")),
    }
    settings |= {"nplc": 1} if interval_s < 0.5 else {}
    return procedure, settings | spare


def _fault(random: Random, life: int) -> Happening:
    role = random.choice(_ROLES)
    known = [
        kind
        for kind in get_args(Kind)
        if (kind not in _OF_ONE or kind in _OF_ROLE.get(role, ())) and (kind not in _SCPI_ONLY or role != "rate_table")
    ]
    kind = random.choice(known)
    lasts = random.choice((None, random.uniform(0.05, 2.0), random.uniform(2.0, 20.0)))
    counted = kind in {"silent", "late", "garbled", "garbage", "truncated"} and random.random() < 0.5
    size_v = random.choice((20e-3, 0.1, 0.5)) * random.choice((1.0, -1.0))
    delay_s, count = random.choice((0.3, 1.5, 3.0, 8.0)), random.randrange(1, 4) if counted else None
    own: dict[str, dict[str, Any]] = {
        "late": {"delay_s": delay_s},
        "error": {"number": random.choice((-222, -410, -113))},
        "offset": {"offset": size_v},
        "current_limit": {"load_ohm": random.choice((1.0, 50.0))},
    }
    fault = Fault(role, kind, duration_s=lasts, count=count, **own.get(kind, {}))
    return Happening(life, random.uniform(0.0, 1.05), "fault", fault=fault)


def _end(random: Random, life: int) -> Happening:
    what: What = random.choice(("kill", "kill", "power cut"))
    return Happening(life, random.uniform(0.02, 1.0), what, by_writes=random.random() < 0.6)


def _besides(random: Random, life: int) -> Happening:
    what: What = random.choice(("signal", "signal", "starter", "clock", "disk full", "sync fails"))
    writes = what in {"disk full", "sync fails"}
    sizes = {
        "clock": random.choice((-86400.0, -3600.0, -1.5, 1.5, 3600.0, 86400.0)),
        "disk full": random.choice((1.0, 3.0, 1e9)),
        "sync fails": random.choice((1.0, 1e9)),
        "signal": random.choice((1.0, 1.0, 2.0, 3.0)),
    }
    return Happening(life, random.uniform(0.0, 1.05), what, by_writes=writes, size=sizes.get(what, 0.0))
