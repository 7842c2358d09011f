"""Every instrument model and every table language that bench files can name: one row each.

A row is data. It names classes as ``module:Name`` and imports them when they are used, so that reading a bench file
loads no driver and no simulation. Another package brings rows of its own as entry points::

    [project.entry-points."vcfbench.models"]
    M1 = "acme.m1:MODEL"

`MODEL` is a :class:`Model` (its classes may stand there themselves, not by name) or a :class:`TableLanguage`. What
comes with the project and what comes with another package are treated alike: discovery, served wires, RS-232.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType
from typing import Any, Final, Literal, TypeVar

from msgspec import Struct, field

from vcfbench.errors import ConfigError

Wire = Literal["tcp", "vxi11", "hislip", "pty"]
"""An interface on which a served bench can offer an instrument."""

ROLES: Final = ("power", "rate_source", "multimeter", "oscilloscope", "vibration_source", "v_vc_meter", "chamber")
"""The places on a bench that an instrument model can fill; the rate table's place takes a language."""

_GROUP, _PROFILES = "vcfbench.models", "vcfbench.table_profiles"
NO_WATCHDOG: Final = "no command for it is known"
HP_MAKERS = ("HEWLETT-PACKARD", "AGILENT", "KEYSIGHT")
"""The same instruments were sold under all three names, in any case of letters, with and without "Technologies"."""


def bare_model(answered: str) -> str:
    """Return the model in a reply to ``*IDN?`` in capitals, under its name in bench files.

    Keithley puts the word MODEL before it, and Keysight writes DSO-X 3024A for DSOX3024A.
    """
    return answered.strip().upper().removeprefix("MODEL ").replace("-X ", "X")


_Row = TypeVar("_Row", "Model", "TableLanguage")


class Model(Struct, frozen=True):
    """An instrument model.

    Args:
        name: what bench files call it, and what ``*IDN?`` answers as its second field.
        roles: places on the bench that it can fill, in the order in which discovery gives them out.
        driver: its :class:`~vcfbench.drivers.scpi_instrument.ScpiInstrument`, or a whole
            :class:`~vcfbench.drivers.registry.Driver`.
        twin: its simulated instrument with the class attribute `errors_class`; None leaves real benches only.
        makers: how the maker's name in ``*IDN?`` may begin, in capitals.
        wires: on which a served bench offers it by default: those of the real box, and TCP where labs put it on a
            converter.
        rs232: whether it has a serial port.
        specifications: its data sheet, as those of :mod:`vcfbench.specifications`; a multimeter needs one, for the
            resolution of its readings.
        answers: what it answers while it is at rest and well, by the beginning of the question; ``*IDN?`` at least.
        own: what tells it from the other models of its driver's class and its twin's, as ``{"sine_hz": 20e6}``; both
            then have a class method ``of_model(name, **own)``. None where it has classes of its own.
        own_watchdog: what its manual says of a watchdog in it, and why none is armed.
        terminals: of a supply: by output, its terminal for the rail and the one for ground.
    """

    name: str
    roles: tuple[str, ...]
    driver: Any
    twin: Any = None
    makers: tuple[str, ...] = HP_MAKERS
    wires: frozenset[Wire] = frozenset({"tcp", "pty"})
    rs232: bool = False
    specifications: Any = None
    answers: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    own: Mapping[str, Any] | None = None
    own_watchdog: str = NO_WATCHDOG
    terminals: Mapping[str, tuple[str, str]] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def places(self) -> tuple[str, ...]:
        """The roles of the model, with the second meter's for a model that can be a multimeter."""
        also = ("v_vc_meter",) if "multimeter" in self.roles and "v_vc_meter" not in self.roles else ()
        return (*self.roles, *also)

    def recognises(self, maker: str, model: str) -> bool:
        """Return True if `maker` and `model`, the first fields of ``*IDN?``, are those of this model."""
        return maker.upper().startswith(self.makers) and bare_model(model).startswith(self.name.upper())


class TableLanguage(Struct, frozen=True):
    """The language of a rate table.

    Args:
        name: what bench files call it.
        twin: the simulated table that speaks it, with the class attribute `errors_class`.
        dialect: its class in Python, made of a `TableSettings`; None for a profile ``NAME.toml`` of the package that
            reads it.
        baud_rate: of its serial line, unless the bench file or its profile says otherwise.
        makers: how the maker's name in ``*IDN?`` may begin, for those that answer it.
        model_prefix: how the model there begins.
        own_watchdog: what its manual says of a watchdog in it, and why none is armed.
    """

    name: str
    twin: Any = None
    dialect: Any = None
    baud_rate: int = 9_600
    makers: tuple[str, ...] = ()
    model_prefix: str = ""
    own_watchdog: str = NO_WATCHDOG

    def recognises(self, maker: str, model: str) -> bool:
        """Return True if `maker` and `model`, the first fields of ``*IDN?``, are those of a table of this language."""
        named = bool(self.makers) and maker.upper().startswith(self.makers)
        return named and model.upper().startswith(self.model_prefix)


def _trueform(name: str, sine_hz: float) -> Model:
    """Return the row of a 33500B or 33600A, whose sines go up to `sine_hz`, which it is sold by."""
    maker = "Agilent" if name.endswith("B") else "Keysight"
    return Model(
        name,
        ("rate_source", "vibration_source"),
        driver="vcfbench.drivers.trueform:Trueform",
        twin="simrack.instruments.trueform:TrueformTwin",
        own={"sine_hz": sine_hz},
        makers=("AGILENT", "KEYSIGHT"),
        wires=frozenset({"tcp", "vxi11", "hislip"}),
        specifications="vcfbench.specifications:KEYSIGHT_33500B",
        answers={"*IDN?": f"{maker} Technologies,{name},MY52701054,3.05-1.19-2.00-52-00", "OUTP1?": "0"},
    )


def _truevolt(name: str, sheet: str, *, makers: tuple[str, ...] = ("KEYSIGHT",), **own: Any) -> Model:
    """Return the row of a 34461A or 34465A, or of one with the numbers `own` and the data sheet `sheet`."""
    return Model(
        name,
        ("multimeter",),
        driver="vcfbench.drivers.truevolt:Truevolt",
        twin="simrack.instruments.truevolt:TruevoltTwin",
        own={"makers": makers, **own},
        makers=makers,
        wires=frozenset({"tcp", "vxi11", "hislip"}),
        specifications=f"vcfbench.specifications:{sheet}",
        answers={"*IDN?": f"Keysight Technologies,{name},MY1,A.02.17-02.40-02.17-00.52-03-01"},
    )


def _x_series(name: str) -> Model:
    """Return the row of an InfiniiVision 3000 X or 4000 X."""
    return Model(
        name,
        ("oscilloscope",),
        driver="vcfbench.drivers.infiniivision:InfiniiVisionX",
        twin="simrack.instruments.infiniivision:InfiniiVisionXTwin",
        own={},
        makers=("AGILENT", "KEYSIGHT"),
        wires=frozenset({"tcp", "vxi11"}),
        answers={"*IDN?": f"KEYSIGHT TECHNOLOGIES,{name[:3]}-X {name[4:]},MY1,07.30.2019051434", ":OPER:COND?": "+0"},
    )


MODELS: Final[tuple[Model, ...]] = (
    Model(
        "E3631A",
        ("power",),
        driver="vcfbench.drivers.e3631a:E3631A",
        twin="simrack.instruments.e3631a:E3631ATwin",
        specifications="vcfbench.specifications:KEYSIGHT_E3631A",
        rs232=True,
        answers={"*IDN?": "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0", "OUTP?": "0", "MEAS:VOLT?": "+0.0"},
        terminals={"P6V": ("+ of +6V", "- of +6V"), "P25V": ("+ of +-25V", "COM"), "N25V": ("- of +-25V", "COM")},
    ),
    Model(
        "E36312A",
        ("power",),
        driver="vcfbench.drivers.e36312a:E36312A",
        twin="simrack.instruments.e36312a:E36312ATwin",
        makers=("KEYSIGHT",),
        wires=frozenset({"tcp", "vxi11", "hislip"}),
        specifications="vcfbench.specifications:KEYSIGHT_E36312A",
        answers={
            "*IDN?": "Keysight Technologies,E36312A,MY59002391,2.1.0-1.0.4-1.12",
            "OUTP? (@1,2,3)": "0,0,0",
            "MEAS:VOLT?": "+0.0",
        },
        # Three outputs that float; the third stands for N25V, turned round
        terminals={
            "P6V": ("+ of output 1", "- of output 1"),
            "P25V": ("+ of output 2", "- of output 2"),
            "N25V": ("- of output 3", "+ of output 3"),
        },
    ),
    Model(
        "33220A",
        ("rate_source", "vibration_source"),
        driver="vcfbench.drivers.agilent33220a:Agilent33220A",
        twin="simrack.instruments.agilent33220a:Agilent33220ATwin",
        makers=("AGILENT", "KEYSIGHT"),
        wires=frozenset({"tcp", "vxi11"}),
        specifications="vcfbench.specifications:AGILENT_33220A",
        answers={"*IDN?": "Agilent Technologies,33220A,MY44008868,2.00-2.00-22-2", "OUTP?": "0"},
    ),
    _trueform("33509B", sine_hz=20e6),
    _trueform("33510B", sine_hz=20e6),
    _trueform("33511B", sine_hz=20e6),
    _trueform("33512B", sine_hz=20e6),
    _trueform("33521B", sine_hz=30e6),
    _trueform("33522B", sine_hz=30e6),
    _trueform("33611A", sine_hz=80e6),
    _trueform("33612A", sine_hz=80e6),
    _trueform("33621A", sine_hz=120e6),
    _trueform("33622A", sine_hz=120e6),
    Model(
        "34401A",
        ("multimeter",),
        driver="vcfbench.drivers.hp34401a:Hp34401A",
        twin="simrack.instruments.hp34401a:Hp34401ATwin",
        rs232=True,
        specifications="vcfbench.specifications:HP_34401A",
        answers={"*IDN?": "HEWLETT-PACKARD,34401A,0,10-5-2"},
    ),
    # Apertures that do not depend on the line: Truevolt guide p. 452; memory: p. 306
    _truevolt("34461A", "KEYSIGHT_34461A", makers=("KEYSIGHT", "AGILENT"), fast_apertures_s={0.02: 0.3e-3, 0.2: 3e-3}),
    # More integration times (guide p. 329); it refuses the three fastest without its option DIG
    _truevolt(
        "34465A",
        "KEYSIGHT_34465A",
        memory_readings=50_000,
        integration_times_nplc=(0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1.0, 10.0, 100.0),
    ),
    Model(
        "2000",
        ("multimeter",),
        driver="vcfbench.drivers.keithley:Keithley2000",
        twin="simrack.instruments.keithley:Keithley2000Twin",
        makers=("KEITHLEY",),
        rs232=True,
        specifications="vcfbench.specifications:KEITHLEY_2000",
        answers={"*IDN?": "KEITHLEY INSTRUMENTS INC.,MODEL 2000,1308393,A20  /A02"},
    ),
    Model(
        "DMM6500",
        ("multimeter",),
        driver="vcfbench.drivers.keithley:KeithleyDMM6500",
        twin="simrack.instruments.keithley:KeithleyDMM6500Twin",
        makers=("KEITHLEY",),
        wires=frozenset({"tcp", "vxi11"}),
        specifications="vcfbench.specifications:KEITHLEY_DMM6500",
        answers={"*IDN?": "KEITHLEY INSTRUMENTS,MODEL DMM6500,04592448,1.7.12b", "*LANG?": "SCPI"},
    ),
    Model(
        "DSO7104B",
        ("oscilloscope",),
        driver="vcfbench.drivers.dso7104b:Dso7104B",
        twin="simrack.instruments.dso7104b:Dso7104BTwin",
        makers=("AGILENT", "KEYSIGHT"),
        wires=frozenset({"tcp", "vxi11"}),
        answers={"*IDN?": "AGILENT TECHNOLOGIES,DSO7104B,MY1,06.00.0003", ":OPER:COND?": "+0"},
    ),
    *map(_x_series, ("DSOX3024A", "MSOX3104T", "DSOX4104A")),
    Model(
        "ATS-545",
        ("chamber",),
        driver="vcfbench.drivers.ats545:TemptronicATS545",
        twin="simrack.instruments.ats545:TemptronicATS545Twin",
        makers=("TEMPTRONIC", "INTEST"),
        rs232=True,
        answers={"*IDN?": "Temptronic,ATS-545,0,1.0", "AUXC?": "0", "*ESR?": "0"},
    ),
)
"""The instrument models that come with the project."""

LANGUAGES: Final = (
    TableLanguage(
        "acl",
        twin="simrack.rate_tables.acl:AclTable",
        dialect="vcfbench.drivers.rate_table.acl:AclDialect",
        makers=("ACUTRONIC", "ACTIDYN"),
        model_prefix="AC",
        own_watchdog="its time-out is for TRACK mode, a run uses rate mode",
    ),
)
"""The language of the user's own table; those of :mod:`vcfbench_tables` come along as any other package's do."""
_OWN: Final[tuple[Model | TableLanguage, ...]] = (*MODELS, *LANGUAGES)


def resolve(reference: Any) -> Any:
    """Return the object named ``module:Name``; return anything but a text unchanged."""
    if not isinstance(reference, str):
        return reference
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)


def driver_of(row: Model) -> Any:
    """Return the driver of a model: its class, or a whole :class:`~vcfbench.drivers.registry.Driver`."""
    kind = resolve(row.driver)
    return kind if row.own is None else kind.of_model(row.name, **row.own)


def own_watchdog(name: str, like: str | None = None) -> str:
    """Return the notes on a watchdog in the model or table language `name`, which may speak as the model `like`."""
    row = find_model(name) or find_language(name) or (find_model(like) if like else None)
    return NO_WATCHDOG if row is None else row.own_watchdog


def rail_terminals(name: str, like: str | None, positive: str, negative: str) -> str:
    """Say where the rails are connected at a supply `name`, which may speak as the model `like`, by their outputs."""
    rows = [row for each in (name, like) if each and (row := find_model(each)) is not None and row.terminals]
    if not rows:
        return f"the terminals of a {name} are not known here: measure both rails at the plug before the PCB is on it"
    plus, one = rows[0].terminals[positive]
    if negative == "none":
        return f"{rows[0].name}: the one rail to {plus}, ground to {one}"
    minus, other = rows[0].terminals[negative]
    ground = " and ".join(dict.fromkeys((one, other)))
    return f"{rows[0].name}: positive rail to {plus}, negative rail to {minus}, ground to {ground}"


def twin_of(row: Model | TableLanguage) -> Any:
    """Return the class of the simulated instrument of a model, or of the table of a language, that has one."""
    kind = resolve(row.twin)
    return kind if isinstance(row, TableLanguage) or row.own is None else kind.of_model(row.name, **row.own)


def model_names() -> tuple[str, ...]:
    """Return the names of all models and languages, those of other packages last."""
    own = tuple(row.name for row in _OWN)
    return (*own, *(name for name in _installed() if name not in own))


def models_for(role: str) -> tuple[str, ...]:
    """Return the names of the models that can fill `role`; a package that cannot be loaded fills none."""
    return tuple(row.name for row in _every() if isinstance(row, Model) and role in row.places)


def languages() -> tuple[str, ...]:
    """Return the names of all table languages; those of packages that cannot be loaded are left out."""
    return tuple(row.name for row in _every() if isinstance(row, TableLanguage))


def find_model(name: str) -> Model | None:
    """Return the row of the model `name`, or None.

    Raises:
        ConfigError: another package registers it and cannot be loaded.
    """
    return _find(name, Model)


def data_sheet_of(name: str) -> Any:
    """Return the data sheet of the model `name`, one of :mod:`vcfbench.specifications`, or None."""
    row = find_model(name)
    return None if row is None else resolve(row.specifications)


def find_language(name: str) -> TableLanguage | None:
    """Return the row of the table language `name`, or None.

    Raises:
        ConfigError: another package registers it and cannot be loaded.
    """
    return _find(name, TableLanguage)


@cache
def profile_reader() -> Any:
    """Return the module of the package with table languages in TOML: `load_profile` and `spoken`.

    Raises:
        ConfigError: none is installed.
    """
    for entry in entry_points(group=_PROFILES):
        return entry.load()
    raise ConfigError("no installed package reads table languages in TOML (vcfbench_tables does)")


def recognised(maker: str, model: str) -> Model | TableLanguage | None:
    """Return the row of the model whose ``*IDN?`` begins with `maker` and `model`, or None."""
    return next((row for row in _every() if row.recognises(maker, model)), None)


def _every() -> Iterator[Model | TableLanguage]:
    yield from _OWN
    for name in _installed():
        with suppress(ConfigError):  # one that cannot be loaded is none
            yield _load(name)


def _find(name: str, kind: type[_Row]) -> _Row | None:
    row = next((each for each in _OWN if each.name == name), None)
    if row is None and name in _installed():  # looked for only where it is none of our own: that takes long
        row = _load(name)
    return row if isinstance(row, kind) else None


@cache  # looking through the installed packages takes milliseconds
def _installed() -> Mapping[str, EntryPoint]:
    found = sorted(entry_points(group=_GROUP), key=lambda entry: entry.name, reverse=True)
    return {entry.name: entry for entry in reversed(found)}


def _load(name: str) -> Model | TableLanguage:
    entry = _installed()[name]
    try:
        row = entry.load()
    except Exception as error:  # another package is anyone's code
        raise ConfigError(f"the model {name!r} ({entry.value}) cannot be loaded: {error}") from error
    if isinstance(row, Model | TableLanguage) and row.name == name:
        return row
    raise ConfigError(f"the entry registered for {name!r} ({entry.value}) is not a row of vcfbench.models")
