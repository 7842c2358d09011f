"""What a bench can run as it is set: what it has, and what dry runs find beyond its limits."""

from collections.abc import Sequence

from vcfbench.errors import BenchError, LimitError
from vcfbench.runs.needs import AS_SET, what_can_run
from vcfbench.runs.request import dry_run
from vcfbench.station.description import BenchDescription


def what_would_run(description: BenchDescription, not_ready: Sequence[str] = ()) -> dict[str, str | None]:
    """Return what :func:`what_can_run` does, and the limit of bench or instrument that a procedure would leave."""
    lacks = what_can_run(description, not_ready)
    for name in [name for name, lack in lacks.items() if lack is None]:
        try:
            dry_run(name, description)
        except LimitError as error:
            lacks[name] = f"{name} {AS_SET}: {error.what}"
        except BenchError:  # of what is only known of a device, or of a run
            continue
    return lacks
