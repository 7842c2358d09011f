"""``vcfbench bench new``: finds instruments, asks, and writes the bench file of a station."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from msgspec import Struct

from vcfbench.cli import options
from vcfbench.cli.interview import Interview, written_anew
from vcfbench.cli.options import flag, option
from vcfbench.cli.set_option import plain_value
from vcfbench.cli.station_questions import ask_about_station
from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.models import languages, models_for
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.served import served_places
from vcfbench.station import discovery
from vcfbench.station.discovery import DiscoveredInstrument
from vcfbench.station.new_station import Draft

_NONE = "none"
_USUAL = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table")
"""Roles that are asked for when nothing was found for them."""


def new(
    file: options.NewFile_ = Path("station.toml"),
    library: options.Library_ = "@py",
    tries: options.Tries_ = None,
    served: Annotated[str | None, option("PORT", "Use the bench that `sim serve` serves: its control port.")] = None,
    answers: Annotated[
        list[str] | None,
        option("KEY=VALUE", "The value of a key of the file, which is then not asked for.", "--set"),
    ] = None,
    *,
    timeout: options.AnswerTime_ = 1.0,
    probe_serial: options.ProbeSerial_ = False,
    yes: Annotated[bool, flag("Ask nothing: use what is found and proposed.", "--yes", "-y")] = False,
    trace: options.Trace_ = None,
) -> None:
    """Make the bench file of a station: find the instruments, ask for the rest, write the file with comments.

    Enter accepts what is proposed. Each answer is checked at once. Nothing is written before the last one.
    """
    given = dict(options.key_and_value("--set", each, "limits.max_rate_deg_s=100") for each in answers or ())
    interview = Interview(given, silent=yes)
    path = interview.free_file(file)
    draft = Draft(str(path))
    with options.tracing(trace):
        _Placing(draft, interview, library, tuple(tries or ()), timeout, probe_serial, served).all()
        ask_about_station(draft, interview)
    interview.require_all_used()
    # Check the file as a whole and write it
    text = draft.text(f"Written by `vcfbench bench new` on {utc_now():%Y-%m-%d}.")
    parse_bench(text, str(path))
    written_anew(path, text)
    typer.echo(f"{path} is written; next: vcfbench bench check --bench {path}")
    if yes:
        typer.echo("nobody has looked at its [limits], [wiring] and [site]: do, before anything moves", err=True)


class _Placing(Struct, frozen=True):
    """Search for instruments, as ``bench discover`` takes it, and their roles; `served` is a control port."""

    draft: Draft
    interview: Interview
    library: str
    tries: tuple[str, ...]
    timeout_s: float
    probe_serial: bool
    served: str | None

    def all(self) -> None:
        """Find instruments, and ask for the role of each; then for those that were not found.

        Raises:
            BenchError: the VISA library cannot be used, or a served bench is not served.
        """
        typer.echo("Looking for instruments ...", err=True)
        found, places = self._found()
        for each in found:
            self._place(each, places.get(each.resource))
        while not self.interview.silent and (more := self._further()):
            self._place(more, None)
        for role in _USUAL:
            named = f"{role}.resource" in self.interview.given
            if role not in self.draft.roles() and (named or not self.interview.silent):
                self._name(role)
        if not self.draft.roles():
            raise ConfigError(
                "no instrument was found or named, so there is no bench", hint="--try RESOURCE, --served PORT"
            )

    def _found(self) -> tuple[list[DiscoveredInstrument], dict[str, str]]:
        """Return the instruments that answer, and the place of each by its resource, where it is known."""
        places: dict[str, str] = {}
        if self.served is not None:
            control, places = served_places(self.served)
            self.draft.values["served"] = {"control": control}
            asked = discovery.discover("@py", tuple(places), timeout_s=self.timeout_s)
            answering = list(asked.tried)
        else:
            probe = self.probe_serial
            asked = discovery.discover(self.library, self.tries, timeout_s=self.timeout_s, serial_probe=probe)
            answering = [*asked.resources, *(port.found for port in asked.serial_ports if port.found), *asked.tried]
            if self.library != "@py":
                self.draft.values["visa_library"] = self.library
        for each in answering:
            typer.echo(f"  {each.resource}: {each.answer or each.problem}", err=True)
        for port in asked.serial_ports:
            if port.found is None and self.served is None:
                typer.echo(f"  {port.port}: {port.description}, not asked (--probe-serial asks)", err=True)
        return [each for each in answering if each.answer is not None], places

    def _place(self, found: DiscoveredInstrument, hint: str | None) -> None:
        """Ask for the role of an instrument that answered, and whether another specimen shall be refused."""
        possible = discovery.places(found.model) or (*_USUAL, "v_vc_meter", "vibration_source", "chamber")
        free = [role for role in possible if role not in self.draft.roles()]
        proposed = hint if hint in free else free[0] if free and found.model is not None else _NONE

        def take(role: str) -> None:
            if role == _NONE:
                return
            if role not in free:
                taken = f"; {role} is filled already" if role in self.draft.roles() else ""
                raise ConfigError(f"expected one of {', '.join((*free, _NONE))}, came {role!r}{taken}")
            self.draft.add_instrument(role, self._keys(role, found))
            if role != "rate_table" and found.serial_number is not None:
                words = f"  refuse any other than number {found.serial_number} (yes, no)"
                if self.interview.ask(f"{role}.serial_number", words, "no", _one_of("yes", "no")) == "yes":
                    self.draft.change({f"{role}.serial_number": found.serial_number})

        what = found.model or "not recognised"
        self.interview.ask(f"role of {found.resource}", f"{what} at {found.resource}: its role", proposed, take)

    def _keys(self, role: str, found: DiscoveredInstrument) -> dict[str, Any]:
        """Return the bench file's keys of an instrument; those of one that is not recognised are asked for."""
        ask, keys = self.interview.ask, discovery.taken_over(role, found)
        if found.model is None and role == "rate_table":
            keys["dialect"] = ask(
                "rate_table.dialect", "  language of the table", "acl", _one_of(*languages(), file=".toml")
            )
        elif found.model is None:
            keys["model"] = (found.answer or "").split(",")[1].strip() if "," in (found.answer or "") else ""
            keys["like"] = ask(
                f"{role}.like", "  which it speaks like", models_for(role)[0], _one_of(*models_for(role))
            )
        if keys.get("dialect") == "zaber":
            keys["steps_per_deg"] = ask("rate_table.steps_per_deg", "  microsteps per degree", "", _number)
        return keys

    def _further(self) -> DiscoveredInstrument | None:
        """Ask for a resource that does not announce itself; None when there is none."""

        def take(answer: str) -> DiscoveredInstrument | None:
            parts = {role: self.draft.values[role] for role in self.draft.roles()}
            if other := next((role for role, part in parts.items() if part["resource"] == answer), None):
                raise ConfigError(f"{answer} is {other} already")
            return self._asked(answer) if answer else None

        words = "Another resource to ask (TCPIP0::..., socket://host:port; Enter: none)"
        return self.interview.ask("further", words, "", take)

    def _asked(self, resource: str) -> DiscoveredInstrument:
        """Return the instrument that answers at `resource`; ConfigError when none does."""
        found = discovery.discover("@py", (resource,), timeout_s=self.timeout_s).tried[0]
        if found.answer is None:
            raise ConfigError(f"{resource}: {found.problem}")
        return found

    def _name(self, role: str) -> None:
        """Ask where an instrument is that was not found; one that is switched off today may be named all the same."""

        def take(answer: str) -> None:
            if not answer:
                return
            resource = answer.removeprefix("off ").strip()
            if answer.startswith("off "):
                table = role == "rate_table"
                key, first = ("dialect", "acl") if table else ("model", models_for(role)[0])
                read = _one_of(*languages(), file=".toml") if table else _one_of(*models_for(role))
                model = self.interview.ask(f"{role}.{key}", f"  its {key}", first, read)
                found = discovery.DiscoveredInstrument(resource, model=model)
            else:
                found = self._asked(resource)
                if found.model is not None and role not in discovery.places(found.model):
                    raise ConfigError(f"{found.model} answers there, which is no {role}")
            self.draft.add_instrument(role, self._keys(role, found))

        words = "its resource ('off RESOURCE' when it does not answer today; Enter: the bench has none)"
        words = f"No {role} was found: {words}"
        self.interview.ask(f"{role}.resource", words, "", take)


def _one_of(*known: str, file: str = "") -> Callable[[str], str]:
    """Return what takes one of the words `known`, or the name of a `file` by its suffix."""

    def take(answer: str) -> str:
        if answer in known or (file and answer.endswith(file)):
            return answer
        raise ConfigError(f"expected one of {', '.join(known)}{f', or FILE{file}' if file else ''}, came {answer!r}")

    return take


def _number(answer: str) -> object:
    number = plain_value(answer, "")
    if not isinstance(number, int | float):
        raise ConfigError(f"expected a number, came {answer!r}")
    return number
