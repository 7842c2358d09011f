"""``vcfbench sim``: the parts of the simulated bench, and the bench on real wires."""

from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from vcfbench.cli.answer import print_json
from vcfbench.cli.new_file import require_free, written_anew
from vcfbench.cli.options import Bench_, Json_, NewFile_, flag, option, seed_option, with_options
from vcfbench.cli.serve import ctl, serve
from vcfbench.clock import WallClock
from vcfbench.drivers.streams.description import Stream
from vcfbench.errors import ConfigError
from vcfbench.files import dotted
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.gyro.data_sheet import MOST_RANGE_DEG_S, DataSheet
from vcfbench.sim.inventory import inventory
from vcfbench.sim.own_gyro import LEFT_OUT, NUMBERS_V_PER_DEG_S, own_gyro_bench
from vcfbench.station.stream_profiles import with_stream
from vcfbench.strict import converted
from vcfbench.testing import soaking
from vcfbench.testing.soaking import Verdict

_FIGURES: Final = {
    "scale_factor_v_per_deg_s": ("scale_factor", "Scale factor, mV/(deg/s), of a stream its unit, signed", -12.542052),
    "range_deg_s": ("range", "Range, deg/s, either way", 200.0),
    "bias_deg_s": ("bias", "Bias, deg/s", 0.0),
    "drive_hz": ("drive_frequency", "Drive frequency, Hz", 3488.9),
    "q_drive": ("q_drive", "Quality factor of the drive mode", 1395.0),
    "split_hz": ("split", "Mode split, drive less sense frequency, Hz, signed", 24.8),
    "q_sense": ("q_sense", "Quality factor of the sense mode", 1224.0),
    "quadrature_deg_s": ("quadrature", "Quadrature, deg/s, as the rate that moves the sense mode as much", 0.0),
    "angle_random_walk_deg_sqrt_h": ("noise", "Angle random walk, deg/sqrt(h)", 0.0),
    "bias_instability_deg_h": ("bias_instability", "Bias instability (Allan minimum), deg/h", 0.0),
    "bandwidth_hz": ("bandwidth", "Bandwidth (-3 dB), Hz, a quarter to half the split", None),
    "k_vc_deg_s_per_v": ("k_vc", "K_Vc, (deg/s)/V, signed: rate that one volt of V_Vc stands for", None),
    "rail_v": ("rail", "Rails, V, either polarity", 10.0),
    "rails": ("rails", "Rails: 2, or 1 of a gyroscope with one supply, whose output rests in its middle", 2.0),
}
"""Keys of a data sheet: the option, its help, and the figure without it."""
_MILLI = 1e-3
_ROOM = 1.35
"""Supply over output at the end of the range: what its stage leaves free, a V_Vc that is 10 % off, and noise."""
_PAPERS: Final = {"quadrature_deg_s": 20.0, "angle_random_walk_deg_sqrt_h": 0.21, "bias_instability_deg_h": 3.7}
"""Figures instead where the imperfections are the paper's."""
_OPTIONS: Final[dict[str, Any]] = {
    name: Annotated[float | None, option("X", f"{words}.{'' if usual is None else f' [default: {usual:.15g}]'}")]
    for name, words, usual in _FIGURES.values()
}
"""Options of ``vcfbench sim new``, one a figure."""

app = typer.Typer(
    no_args_is_help=True, help="Show the simulated bench, give it your own gyroscope, serve and control it."
)


@app.command("show")
def show(
    bench: Bench_ = None,
    seed: Annotated[int | None, seed_option("Seed from which errors are drawn.")] = None,
    *,
    json: Json_ = False,
) -> None:
    """Show every physical parameter and every instrument error: value, unit, meaning, source."""
    description = load_bench(bench)
    rows = inventory(description, seed)
    if json:
        print_json({"bench": description.name, "parameters": rows})
    else:
        typer.echo(description.title)
        for row in rows:
            unit = "" if row.unit == "1" else f" {row.unit}"
            typer.echo(f"\n{row.path} = {_shown(row.value)}{unit}")
            typer.echo(f"    {row.meaning}{f' ({row.source})' if row.source else ''}")


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def new(
    file: NewFile_,
    *,
    imperfections: Annotated[
        Literal["none", "paper"], option(None, "All perfect except noise, or as in the paper.")
    ] = "none",
    name: Annotated[str | None, option("NAME", "Name of the bench. Default: that of FILE.")] = None,
    without: Annotated[
        list[str] | None, option("ROLE", f"Leave out {', '.join(sorted(LEFT_OUT))}. Repeatable.")
    ] = None,
    stream: Annotated[str | None, option("PROFILE", "The output is a stream of numbers, by this profile.")] = None,
    devices: Annotated[int, option("N", "Number of gyroscopes on one table, with --stream.", min=1, max=64)] = 1,
    **given: float | None,
) -> None:
    """Write a simulated bench with your own gyroscope: runs on it find the figures of its data sheet.

    Without --bandwidth the filter is at four splits, without --k-vc 1 V stands for three quarters of the range.
    """
    require_free(file)
    if devices > 1 and stream is None:
        raise ConfigError("--devices: several gyroscopes at once speak numbers here: --stream PROFILE too")
    lsb_per_deg_s, given = (None, given) if stream is None else _behind_numbers(stream, given, file.parent)
    real = imperfections == "paper"
    figures: dict[str, float] = {}
    for key, (figure, _, usual) in _FIGURES.items():
        asked = given.get(figure)
        value = (_PAPERS if real else {}).get(key, usual) if asked is None else asked
        if value is not None:
            figures[key] = value * _MILLI if key == "scale_factor_v_per_deg_s" else value
    figures.setdefault("k_vc_deg_s_per_v", 0.75 * figures["range_deg_s"])
    table = None
    if stream is not None:
        alone = {} if devices > 1 else {"resource": "ASRL9::INSTR"}
        table = {"profile": stream, "quiet": figures["angle_random_walk_deg_sqrt_h"] == 0.0, **alone}
    text = own_gyro_bench(
        DataSheet(**figures),
        name or file.stem,
        imperfections=real,
        without=without or (),
        stream=table,
        lsb_per_deg_s=lsb_per_deg_s,
        devices=devices,
        folder=file.parent,
    )
    written_anew(file, text)
    typer.echo(f"{file} is written; next: vcfbench run turntable --bench {file}")


def _behind_numbers(
    profile: str, given: dict[str, float | None], folder: Path
) -> tuple[float | None, dict[str, float | None]]:
    """Return LSB a deg/s, None in another unit, and the figures of the voltage of which a stream's numbers are made.

    Raises:
        ConfigError: a figure that such a gyroscope has not, no LSB, or a range beyond its largest number.
    """
    for figure in ("rail", "rails", "k_vc"):
        if given[figure] is not None:
            option_ = figure.replace("_", "-")
            raise ConfigError(f"--{option_}: not with --stream: that gyroscope feeds itself, and has no input for V_Vc")
    asked: dict[str, Any] = {"gyro": {"stream": {"profile": profile, "resource": "sim"}}}
    keys = with_stream(asked, "--stream", folder)["gyro"]["stream"]
    stream = converted(keys, Stream, lambda path: f"{profile}: {dotted(path)}")
    per_deg_s, lsb = given["scale_factor"], stream.unit == "LSB"
    if lsb and not per_deg_s:
        expected = f"the {stream.output_unit}/(deg/s) of its data sheet: {stream.name} speaks LSB"
        raise ConfigError(f"--scale-factor: expected {expected}")
    range_deg_s, bias_deg_s = given["range"] or _FIGURES["range_deg_s"][2] or 0.0, abs(given["bias"] or 0.0)
    most_deg_s, of = min(
        (stream.largest / abs(per_deg_s or 1.0) - bias_deg_s, f"the largest number of {stream.name} less the bias"),
        (MOST_RANGE_DEG_S, "as fast as the simulated table turns"),
    )
    if range_deg_s > most_deg_s:
        said = "" if given["range"] else ", the default"
        raise ConfigError(f"--range: expected at most {most_deg_s:.4g} deg/s, {of}, got {range_deg_s:g}{said}")
    volts = NUMBERS_V_PER_DEG_S if lsb or per_deg_s is None else NUMBERS_V_PER_DEG_S * per_deg_s
    rail_v = _ROOM * abs(volts) * (range_deg_s + bias_deg_s)
    figures = {"scale_factor": volts / _MILLI, "rail": min(15.0, max(10.0, rail_v))}
    return per_deg_s if lsb else None, {**given, **figures}


app.command("new")(with_options(new, _OPTIONS, place=1))


@app.command("soak")
def soak(
    seeds: Annotated[str, option("A:B", "Seeds from A up to, not including, B.")] = "0:100",
    minutes: Annotated[float | None, option("N", "Start no further seed after this time.", min=0.0)] = None,
    *,
    verbose: Annotated[bool, flag("Print for each seed the drawn case and its end.", "--verbose", "-v")] = False,
) -> None:
    """Try runs on simulated benches under faults, kills and full disks that seeds draw.

    What breaks is said with the smallest part of its draw that still breaks it; the exit code is then 1.
    """
    parts = seeds.split(":")
    if not (len(parts) == 2 and all(map(str.isdecimal, parts)) and int(parts[0]) < int(parts[1])):
        raise ConfigError(f"--seeds: expected A:B, whole numbers with A below B, got {seeds!r}")
    first, last = map(int, parts)
    clock, broken, tried = WallClock(), list[int](), 0
    for verdict in soaking.soak(range(first, last)):
        tried += 1
        if verbose or verdict.wrong:
            typer.echo("\n".join([*verdict.draw.describe(), *_words(verdict)]))
        if verdict.wrong:
            broken.append(verdict.draw.seed)
            least = soaking.shrunk(verdict)
            typer.echo("\n".join(["the smallest that still breaks it:", *least.draw.describe(), *_words(least)]))
        if minutes is not None and clock.now() >= 60.0 * minutes:
            break
    typer.echo(f"{tried} seeds from {first} in {clock.now():.0f} s: {len(broken)} broken")
    for seed in broken:
        typer.echo(f"vcfbench sim soak --seeds {seed}:{seed + 1} -v")
    if broken:
        raise typer.Exit(1)


def _words(verdict: Verdict) -> list[str]:
    ends = (f"  start {number}: {end}" for number, end in enumerate(verdict.ends, start=1))
    return [*ends, *(f"  BROKEN: {each}" for each in verdict.wrong)]


app.command("serve")(serve)
app.command("ctl")(ctl)
