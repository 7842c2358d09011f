"""``vcfbench bench new``: finds instruments, asks for limits and latitude, and writes the bench file of a station."""

from contextlib import suppress
from os import environ
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.prompt import Prompt

from vcfbench.bench.simulated_instruments import CONTROL_PORT, CONTROL_VARIABLE
from vcfbench.cli import options
from vcfbench.cli.new_file import require_free, written_anew
from vcfbench.cli.options import flag, option
from vcfbench.cli.set_option import plain_value
from vcfbench.clock import utc_now
from vcfbench.drivers.wire import is_simulated
from vcfbench.errors import BenchError, ConfigError, ConnectFailed
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.served import served_places
from vcfbench.station import discovery
from vcfbench.station.consistency import NOT_BESIDE_STREAM
from vcfbench.station.discovery import DiscoveredInstrument
from vcfbench.station.new_station import LATITUDE, MAINS, RAIL, Draft

_NONE: Final = "none"
_NEGATIVE: Final = "wiring.rails.negative"
_SCALE: Final = "procedure.scale_factor_v_per_deg_s"
_STREAM: Final = "gyro.stream."
_QUESTIONS: Final = {
    "limits.max_rate_deg_s": "Highest rate, deg/s",
    "limits.max_acceleration_deg_s2": "Highest acceleration, deg/s^2",
    "limits.max_v_vc_v": "Highest V_Vc, V, either sign",
    "limits.max_rail_current_a": "Highest current limit of a rail, A",
    "limits.min_temperature_c": "Lowest temperature, degC",
    "limits.max_temperature_c": "Highest temperature, degC",
    "limits.max_ramp_k_min": "Fastest ramp, K/min",
    LATITUDE: "Latitude, deg, north positive (for the Earth's rate)",
    MAINS: "Mains, Hz (50 or 60; a voltmeter's readings go by it)",
}
"""What must never be exceeded here, by the instruments that are there, and what nothing tells."""
_BY_HAND: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    "power": ("supply of the PCB", {"by": "hand", "model": "supply"}),
    "multimeter": ("multimeter", {"by": "hand", "model": "34401A", "resolution_v": 1e-4}),
    "rate_table": ("rate table", {"by": "hand", "model": "table"}),
}
"""What a person may set and read where no such instrument answers, with proposals for its table."""


def new(
    file: options.NewFile_ = Path("station.toml"),
    library: options.Library_ = "@py",
    tries: options.Tries_ = None,
    served: Annotated[str | None, option("PORT", "Use the bench that `sim serve` serves: its control port.")] = None,
    settings: Annotated[
        list[str] | None,
        option("KEY=VALUE", "The value of a key of the file, which is then not asked for. Repeatable.", "--set"),
    ] = None,
    *,
    timeout: options.AnswerTime_ = 1.0,
    probe_serial: options.ProbeSerial_ = False,
    yes: Annotated[bool, flag("No questions: use the instruments found and the proposals.", "--yes", "-y")] = False,
    trace: options.Trace_ = None,
) -> None:
    """Make the bench file of a station: find the instruments, ask for limits and latitude, write the file.

    Enter accepts what is proposed. All else is in the file with its meaning: put in yours, or give it with --set.
    """
    require_free(file)
    texts = options.keys_and_values("--set", settings or (), "limits.max_rate_deg_s=100")
    given = {key: plain_value(text, f"--set {key}") for key, text in texts.items()}
    draft = Draft(str(file))
    with options.tracing(trace):
        typer.echo("Looking for instruments ...", err=True)
        found, places = _found(draft, library, tuple(tries or ()), timeout, probe_serial=probe_serial, served=served)
    _add_named(draft, given, "by", ask=not yes)
    for each in found:
        _place(each, draft, given, places.get(each.resource), ask=not yes)
    _add_named(draft, given, "resource", ask=not yes)  # what does not answer today
    streams = any(key.startswith(_STREAM) for key in given)
    there = {*draft.roles(), *(["multimeter"] if streams else [])}
    for role, (words, keys) in _BY_HAND.items() if not yes else ():
        asked = f"No {words} answers: is there one that a person sets and reads"
        if role not in there and _answer(asked, _NONE, choices=["hand", _NONE]) != _NONE:
            draft.add_instrument(role, keys)
    if not (draft.roles() or streams):
        hint = "--try RESOURCE, --served PORT; --set power.by=hand --set power.model=NAME where a person sets it"
        raise ConfigError("expected at least one instrument, found or named", hint=hint)
    draft.set(given)
    rails_open = "power" in draft.roles() and not given.keys() & {RAIL, "limits.min_rail_v", "limits.max_rail_v"}
    if not yes:
        _ask(draft, given, rails_open=rails_open)
    elif LATITUDE not in given:  # 0, the equator, would be a wrong Earth's rate that nobody sees
        raise ConfigError(f"{LATITUDE}: expected the latitude of the bench", hint=f"--set {LATITUDE}=48.1")
    text = draft.text(f"Written by `vcfbench bench new` on {utc_now():%Y-%m-%d}.")
    parse_bench(text, str(file))
    written_anew(file, text)
    typer.echo(f"{file} is written; next: vcfbench bench check --bench {file}")
    unseen = "[limits], [wiring] and [site]" if yes else "[wiring]"
    typer.echo(f"check its {unseen} before anything moves", err=True)
    if _counts(draft):
        typer.echo(f"its numbers are LSB: for rates --set {_SCALE}=LSB_PER_DEG_S by the data sheet", err=True)
    if rails_open and yes:
        typer.echo(f"rails of +10 and -10 V were taken: a gyroscope of others needs --set {RAIL}=VOLTS", err=True)


def _found(
    draft: Draft, library: str, tries: tuple[str, ...], timeout_s: float, *, probe_serial: bool, served: str | None
) -> tuple[list[DiscoveredInstrument], dict[str, str]]:
    """Return the instruments that answer, and the place of each by its resource, where it is known."""
    places: dict[str, str] = {}
    if served is not None:
        control, places = served_places(served)
        draft.values["served"] = {"control": control}
        asked = discovery.discover("@py", tuple(places), timeout_s=timeout_s)
        answering = list(asked.tried)
    else:
        asked = discovery.discover(library, tries, timeout_s=timeout_s, serial_probe=probe_serial)
        answering = [*asked.resources, *(port.found for port in asked.serial_ports if port.found), *asked.tried]
        if library != "@py":
            draft.values["visa_library"] = library
        if is_simulated(library):
            typer.echo(f"  {library}: simulated, without a rate table; `sim serve` and --served have one", err=True)
        at = {each.resource for each in answering if "//127." in each.resource or "::127." in each.resource}
        with suppress(ConnectFailed):  # a server of simulated instruments tells which are its own
            control, known = served_places(environ.get(CONTROL_VARIABLE, str(CONTROL_PORT))) if at else ("", {})
            if at & known.keys():
                places, draft.values["served"] = known, {"control": control}
                typer.echo(f"  {', '.join(sorted(at & known.keys()))}: simulated, served by {control}", err=True)
    for each in answering:
        typer.echo(f"  {each.resource}: {each.answer or each.problem}", err=True)
    for port in asked.serial_ports:
        if port.found is None and served is None:
            typer.echo(f"  {port.port}: {port.description}, not queried (--probe-serial queries it)", err=True)
    return [each for each in answering if each.answer is not None], places


def _place(found: DiscoveredInstrument, draft: Draft, given: dict[str, Any], hint: str | None, *, ask: bool) -> None:
    """Put an instrument that answered on the bench: in the role that it can have, or that a person chooses."""
    named = next((key.removesuffix(".resource") for key, value in given.items() if value == found.resource), hint)
    free = [role for role in discovery.places(found.model) if role not in draft.roles()]
    useless = {*NOT_BESIDE_STREAM, "oscilloscope"} if any(key.startswith(_STREAM) for key in given) else set()
    if found.model is None:
        typer.echo(f"{found.resource} is not recognised; put it on the bench if it is", err=True)
        typer.echo(f"  an instrument: --set ROLE.resource={found.resource} --set ROLE.like=MODEL", err=True)
        typer.echo(f"  a stream: --set {_STREAM}resource={found.resource} --set {_STREAM}profile=NAME", err=True)
    elif set(free) & useless and named not in free:
        typer.echo(f"{found.model} at {found.resource} is left out: the output is a stream", err=True)
    elif free:
        role = named if named in free else free[0]
        if ask:
            role = _answer(f"{found.model} at {found.resource}: its role", role, choices=[*free, _NONE])
        if role != _NONE:
            _add(draft, role, {**discovery.taken_over(role, found), **_of(role, given)}, ask=ask)


def _add(draft: Draft, role: str, keys: dict[str, Any], *, ask: bool) -> None:
    """Put an instrument on the bench, with the microsteps that a Zaber stage does not tell."""
    steps, key = "steps_per_deg", f"{role}.steps_per_deg"
    silent = keys.get("dialect") == "zaber" and steps not in keys
    if silent and not ask:
        raise ConfigError(f"{key}: expected the stage's microsteps per degree", hint=f"--set {key}=NUMBER")
    while True:
        try:
            typed = {steps: plain_value(_answer("Microsteps per degree of the stage", None), key)} if silent else {}
            return draft.add_instrument(role, {**keys, **typed})
        except BenchError as error:
            if not silent or steps not in str(error):  # no answer here would mend it
                raise
            typer.echo(f"  no: {error}", err=True)


def _add_named(draft: Draft, given: dict[str, Any], last: str, *, ask: bool) -> None:
    """Put the instruments on the bench that are named by a key that ends so, with the other keys that are given."""
    for role in [key.removesuffix(f".{last}") for key in given if key.endswith(f".{last}")]:
        if role not in draft.roles():
            _add(draft, role, _of(role, given), ask=ask)


def _of(role: str, given: dict[str, Any]) -> dict[str, Any]:
    return {key.removeprefix(f"{role}."): value for key, value in given.items() if key.startswith(f"{role}.")}


def _ask(draft: Draft, given: dict[str, Any], *, rails_open: bool) -> None:
    """Ask for what nothing tells; the supplies of the gyroscope have no proposal, for of the wrong ones it dies."""
    if rails_open:
        supplies = (
            "2" if _NEGATIVE in given else _answer("Supplies of the gyroscope: 2 (+ and -) or 1", None, ["1", "2"])
        )
        draft.set({_NEGATIVE: _NONE} if supplies == "1" else {})
        _ask_for(RAIL, "Volts of each", draft)
    for key, words in _QUESTIONS.items():
        if key not in given and (key in {LATITUDE, MAINS} or draft.value(key) is not None):
            _ask_for(key, words, draft)
    if _counts(draft):
        _ask_for(_SCALE, "Scale factor by the data sheet, LSB a deg/s, signed", draft)


def _counts(draft: Draft) -> bool:
    """Return True if the output is counts of which nothing tells the scale factor."""
    stream = draft.change({}).stream
    return stream is not None and stream.unit == "LSB" and draft.value(_SCALE) is None


def _ask_for(key: str, words: str, draft: Draft) -> None:
    """Ask for the value of a key until it fits; its proposal comes from the draft."""
    fixed = {LATITUDE: None, MAINS: "50", RAIL: None, _SCALE: None}
    proposed = fixed[key] if key in fixed else f"{draft.value(key):g}"
    while True:
        answer = _answer(words, proposed)
        try:
            return draft.set({key: plain_value(answer, key)})
        except BenchError as error:
            typer.echo(f"  no: {error}", err=True)


def _answer(words: str, proposed: str | None, choices: list[str] | None = None) -> str:
    default: Any = ... if proposed is None else proposed
    try:
        return str(Prompt.ask(words, console=Console(stderr=True), choices=choices, default=default))
    except EOFError:
        what = "the input ended before the last question; no file was written"
        raise ConfigError(what, hint="--yes accepts the proposals") from None
