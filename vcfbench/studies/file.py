"""Study files: read and checked wholly before anything runs."""

import hashlib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import msgspec
from msgspec import Meta, Struct, field, structs

from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import dotted, parse_toml, read_text, require_numbers, shown
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.procedures import catalogue
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.procedures.catalogue import is_file
from vcfbench.runs.request import Request, prepare
from vcfbench.station.description import BenchDescription
from vcfbench.station.file import EMBEDDED, embedded_text
from vcfbench.station.layering import Layer, merged
from vcfbench.strict import converted, refusal
from vcfbench.studies.vary import SETTINGS, Drawn, Listed, Varied, combined, count, leaves, placed, varied
from vcfbench.version import installed_version

_MOST_CASES = 10_000
_MOST_RUNS = 1_000_000
_UNASKED_RUNS = 10_000  # A study of more, which takes a quarter of an hour and more, says so itself (`most_runs`)


class _Seeds(Struct, frozen=True, forbid_unknown_fields=True):
    """``[seeds]``."""

    count: Annotated[int, Meta(ge=1, le=_MOST_RUNS)]
    first: Annotated[int, Meta(ge=0, le=2**53)] = 0


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    """A study file."""

    procedure: Annotated[str, Meta(min_length=1)]
    seeds: _Seeds
    bench: Annotated[str, Meta(min_length=1)] = "paper"
    title: Annotated[str, Meta(max_length=200)] = ""
    settings: dict[str, Any] = field(default_factory=dict)
    change: dict[str, Any] = field(default_factory=dict)
    vary: dict[str, Any] = field(default_factory=dict)
    combine: Literal["grid", "paired"] = "grid"
    metrics: Annotated[tuple[str, ...], Meta(min_length=1)] = ("*",)
    most_runs: Annotated[int, Meta(ge=1, le=_MOST_RUNS)] = _UNASKED_RUNS


class Case(Struct, frozen=True):
    """One combination of the values that a study lists: `values` by path; `number` counts from 0."""

    number: int
    values: Mapping[str, Any]


class Study(Struct, frozen=True, kw_only=True):
    """A study that was checked: procedure, bench and settings, cases, seeds, metrics.

    `bench_table` is the bench file with the study's changes, `source` names the study file in errors. Those metrics are
    kept whose names one of the patterns `metrics` fits (``virtual.*``).
    """

    source: str
    title: str
    procedure: str
    bench: str
    bench_table: Mapping[str, Any]
    settings: Mapping[str, Any]
    change: Mapping[str, Any]
    varied: tuple[Varied, ...]
    cases: tuple[Case, ...]
    seeds: range
    metrics: tuple[str, ...]

    @property
    def runs(self) -> list[tuple[int, int]]:
        """Case and seed of every run, in order."""
        return [(case.number, seed) for case in self.cases for seed in self.seeds]

    def of(self, case: int) -> Self:
        """Return the study with one of its cases, which is all that a run of it needs."""
        return structs.replace(self, cases=(self.cases[case],))

    @property
    def labels(self) -> dict[str, str]:
        """Label of each varied path's column."""
        return {each.path: each.label for each in self.varied}

    def values(self, case: Case, seed: int) -> dict[str, Any]:
        """Return the value of every varied path in one run."""
        drawn = {each.path: each.value(seed) for each in self.varied if isinstance(each, Drawn)}
        return {each.path: drawn.get(each.path, case.values.get(each.path)) for each in self.varied}

    def described(self, case: Case, seed: int) -> tuple[BenchDescription, dict[str, Any]]:
        """Return the bench of one run, and its settings.

        Raises:
            ConfigError: a value cannot be, or its path is unknown; the words name the key of the study file.
        """
        table: dict[str, Any] = dict(self.bench_table)
        asked: dict[str, Any] = {SETTINGS: dict(self.settings)}
        for path, value in self.values(case, seed).items():
            where = f"{self.source}: vary.{path}"
            if path == SETTINGS or path.startswith(f"{SETTINGS}."):
                asked = placed(asked, path, value, where)
            else:
                table = placed(table, path, value, where)
        marked = "\0"  # no file is called so: what follows it in an error is the key
        try:
            return checked_bench(table, marked), asked[SETTINGS]
        except ConfigError as error:
            before, mark, rest = error.what.partition(f"{marked}: ")
            if not mark:
                raise
            key, where = rest.partition(":")[0], f"{self.bench}: "  # the file, and the table in it
            if any(key.startswith(each.path) or each.path.startswith(key) for each in self.varied):
                where = f"{self.source}: vary."
            elif any(key.startswith(each) or each.startswith(key) for each, _ in leaves(self.change)):
                where = f"{self.source}: change."
            raise ConfigError(f"{before}{where}{rest}", hint=error.hint) from None

    def request(self, case: Case, seed: int) -> Request:
        """Return one run of the study as :func:`vcfbench.runs.conduct.conduct` takes it; it keeps no record."""
        description, settings = self.described(case, seed)
        return Request(_loaded(self.procedure), description, seed, Layer(settings, self._naming), runs=None)

    def _naming(self, keys: tuple[str | int, ...]) -> str:
        path = dotted((SETTINGS, *keys))
        given = any(path.startswith(each.path) for each in self.varied)
        return f"{self.source}: {'vary.' if given else ''}{path}"

    def fingerprint(self) -> str:
        """Return a fingerprint of all that the study's results depend on, but for its seeds."""
        inputs = {
            "version": installed_version(),
            "procedure": self.procedure,
            "code": read_text(self.procedure, "a procedure")
            if is_file(self.procedure)
            else "",  # of a custom procedure
            "bench": self.bench_table,
            "settings": self.settings,
            "vary": self.varied,
            "cases": [case.values for case in self.cases],
            "metrics": self.metrics,
        }
        return hashlib.sha256(msgspec.json.encode(inputs, order="sorted")).hexdigest()

    def check(self) -> Iterator[Case]:
        """Check every run before any is done, and yield each case when it is checked.

        Each case's plan is walked against the limits; where values are drawn, the bench and settings of every seed are
        checked too.

        Raises:
            BenchError: a run cannot be as asked; file, key and what was expected are in the words.
        """
        draws = any(isinstance(each, Drawn) for each in self.varied)
        for case in self.cases:
            for seed in self.seeds if draws else self.seeds[:1]:
                try:
                    prepared = prepare(self.request(case, seed))
                    if seed == self.seeds[0]:
                        prepared.planned()
                except BenchError as error:
                    said = ", ".join(f"{path} = {value}" for path, value in self.values(case, seed).items())
                    drawn, which = f"drawn for seed {seed}" * draws, f"case {case.number} ({said})" if said else ""
                    error.hint = "; ".join(filter(None, [error.hint, drawn, which]))
                    if not str(error).startswith(f"{self.source}: "):
                        error.what = f"{self.source}: {error.what}"
                    raise
            yield case


def read_study(file: Path | str) -> Study:
    """Return the study that a TOML file describes; its values are checked by :meth:`Study.check`.

    Raises:
        ConfigError: it cannot be read, a key is unknown, or its bench is not simulated or has several gyroscopes.
        PlanError: there is no such procedure.
    """
    path, source = Path(file), shown(file)
    said = converted(parse_toml(read_text(path, "a study file"), source), _File, lambda k: f"{source}: {dotted(k)}")
    return _study(said, source, path.parent)


def study_of(values: Mapping[str, Any], source: str = "study") -> Study:
    """Return the study that `values`, tables as a study file has them, describe; errors as :func:`read_study`."""
    plain: dict[str, Any] = msgspec.to_builtins(values, enc_hook=lambda each: getattr(each, "tolist", each.__str__)())
    require_numbers(plain, source)
    return _study(converted(plain, _File, lambda keys: f"{source}: {dotted(keys)}"), source, Path())


def _study(said: _File, source: str, folder: Path) -> Study:
    bench, table = _bench_table(said.bench, folder)
    changed = merged(table, said.change)
    paths = varied(said.vary, source)
    axes = [each for each in paths if isinstance(each, Listed)]
    number, runs = count(axes, said.combine), count(axes, said.combine) * said.seeds.count
    came = f"{number} cases of {said.seeds.count} seeds, {runs} runs"
    if number > _MOST_CASES:  # before any is made
        raise refusal(f"{source}: vary", f"at most {_MOST_CASES} cases", came)
    if runs > said.most_runs:
        error = refusal(f"{source}: vary and seeds", f"at most {said.most_runs} runs", came)
        error.hint = f"most_runs of the study file says how many are meant, at most {_MOST_RUNS}"
        raise error
    cases = tuple(Case(number, values) for number, values in enumerate(combined(axes, said.combine, source)))
    study = Study(
        source=source,
        title=said.title,
        # the absolute path of a custom procedure's file
        procedure=str((folder / said.procedure).resolve()) if is_file(said.procedure) else said.procedure,
        bench=bench,
        bench_table=changed,
        settings=said.settings,
        change=said.change,
        varied=paths,
        cases=cases,
        seeds=range(said.seeds.first, said.seeds.first + said.seeds.count),
        metrics=said.metrics,
    )
    if changed.get("device"):
        raise ConfigError(
            f"{source}: bench: expected a bench with one gyroscope, {bench} has several ([[device]])",
            hint="a study runs one gyroscope with many seeds: leave out the tables [[device]]",
        )
    if not isinstance(changed.get("simulation"), dict) or "served" in changed:
        raise ConfigError(
            f"{source}: bench: expected a bench that is simulated here, {bench} is not",
            hint="its bench file has no table [simulation], or a table [served]",
        )
    _loaded(study.procedure)
    return study


def _bench_table(bench: str, folder: Path) -> tuple[str, dict[str, Any]]:
    """Return a bench's name for errors, and its file as a table; profiles are found from anywhere."""
    file = folder / bench
    if bench in EMBEDDED and not file.is_file():
        return f"embedded {bench} bench", parse_toml(embedded_text(bench), bench)
    table = parse_toml(read_text(file, "a bench file"), shown(file))
    for role, key in (("rate_table", "dialect"), ("multimeter", "calibration_dcc"), ("v_vc_meter", "calibration_dcc")):
        part = table.get(role)
        named = part.get(key) if isinstance(part, dict) else None
        if isinstance(named, str) and (key != "dialect" or named.endswith(".toml")):
            table = placed(table, f"{role}.{key}", str((file.parent / named).resolve()), shown(file))
    return shown(file), table


@cache  # the file of a custom procedure is read and run once
def _loaded(name: str) -> AnyProcedure:
    """Return the procedure of a name or a file; errors as :func:`vcfbench.procedures.catalogue.procedure`."""
    return catalogue.procedure(Path(name) if is_file(name) else name)
