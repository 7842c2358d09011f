"""``vcfbench sim``: the parts of the simulated bench, and the bench on real wires."""

from typing import Annotated, Any

import typer

from vcfbench.cli import serve
from vcfbench.cli.answer import print_json
from vcfbench.cli.options import Bench_, Json_, seed_option, with_options
from vcfbench.cli.sim_new import FIGURE_OPTIONS, new
from vcfbench.cli.soak import soak
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.inventory import inventory

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


app.command("new")(with_options(new, FIGURE_OPTIONS, place=1))
app.command("soak")(soak)
serve.register(app)
