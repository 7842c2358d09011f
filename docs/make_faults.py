# noqa: INP001 - a script, not a package
"""The page of the fault matrix, made from the cells in docs/evidence/fault-matrix.json."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

CELLS = Path(__file__).parent / "evidence" / "fault-matrix.json"

_HEAD = """# The fault matrix

What becomes of the bench when a wire fails at a bad moment. This page is made of `docs/evidence/fault-matrix.json`,
which has every cell, and which a test writes:

```text
python -m pytest -m fault_matrix tests/faults/test_matrix.py
```

In each cell `vcfbench run` works on a bench that another process simulates, over TCP or a pseudo-terminal, on the
wall clock as on a real one. A man in the middle (`simrack.wire_faults.faulty_wire`) spoils what the instrument answers
from the moment that the row names: one answer (*once*) or all (*lasting*). Commands still arrive. Then the physics is
asked, past all instruments: is the table at rest, is everything off, and since when? Exit code, words and record must
say the same.

*Safe* counts the cells in which the instrument could be told anything: all but *unreachable, lasting*, where there is
no connection any more. *Still* is the longest time from the step that failed (from the end of a run in which none
did) to the table's rest, *all* until everything is off too, which an orderly end does last. The bar is 5 s for
*still*, and 5 s after the end of the run for all, beside what a stop takes on a good wire on the same machine. Exit
code 0: the fault was healed, and the numbers are right. 3: the run ended, the bench is proved safe. 5: it was told to
stop, which could not be proved.
"""

_COLUMNS = "| cells | safe | still | all | 0 | 3 | 5 | else | wrong |"
_RULE = "|---:|---:|---:|---:|---:|---:|---:|---:|---:|"


def write_cells(cells: Sequence[Mapping[str, Any]]) -> None:
    """Write the cells, one per line."""
    struck = [cell for cell in cells if cell["hit"]]  # where the fault never struck nothing was shown
    ordered = sorted(struck, key=lambda cell: json.dumps({**cell, "rest_s": None, "still_s": None}))
    CELLS.write_text("[\n" + ",\n".join(json.dumps(cell) for cell in ordered) + "\n]\n", encoding="utf-8")


def read_cells() -> list[dict[str, Any]]:
    """Read the cells."""
    cells: list[dict[str, Any]] = json.loads(CELLS.read_text(encoding="utf-8"))
    return cells


def fault_page() -> str:
    """Return the page of the kept cells."""
    return page(read_cells())


def page(cells: Sequence[Mapping[str, Any]]) -> str:
    """Return the page."""
    faults = [cell for cell in cells if "no fault" not in cell["mode"]]
    stops = [cell["rest_s"] for cell in cells if "no fault" in cell["mode"] and cell["rest_s"] is not None]
    at_rate = [cell for cell in faults if cell["moment"] == "table at rate"]
    parts = [
        _HEAD,
        f"Stops on a good wire took {min(stops):.1f} to {max(stops):.1f} s. {_counted(faults)} All that were run:\n",
        _table("", faults, lambda _: "all"),
        "\n## By moment\n\nThe fault is on the wire of the table, of the generator, of the supply.\n",
        _table("moment", faults, lambda cell: str(cell["moment"])),
        "\n## By the table's language, at rate\n",
        _table("language", at_rate, lambda cell: f"`{cell['language']}`"),
        "\n## By mode\n",
        _table("mode", faults, lambda cell: f"{cell['mode']}, {'lasting' if cell['lasting'] else 'once'}"),
        "\n## By wire\n",
        _table("wire", faults, lambda cell: str(cell["wires"])),
        *_wrong(cells),
    ]
    return "\n".join(parts)


def _counted(faults: Sequence[Mapping[str, Any]]) -> str:
    """Say how many cells there are, and how many of them the machine was too slow or too busy to come by."""
    languages, moments, wires, modes = (
        len({cell[key] for cell in faults}) for key in ("language", "moment", "wires", "mode")
    )
    every = 2 * wires * modes * (languages + moments - 1)  # the wires of the others with the languages in turn
    if len(faults) == every:
        return f"All {every} cells were run."
    return f"Of {every} cells {len(faults)} were run; nothing is said of the other {every - len(faults)}."


def _table(title: str, cells: Sequence[Mapping[str, Any]], name: Any) -> str:
    rows: dict[str, list[Mapping[str, Any]]] = {}
    for cell in cells:
        rows.setdefault(name(cell), []).append(cell)
    lines = [f"| {title} {_COLUMNS}", f"|---{_RULE}", *(_row(key, rows[key]) for key in sorted(rows))]
    return "\n".join(lines) + "\n"


def _row(name: str, cells: Sequence[Mapping[str, Any]]) -> str:
    hears = [cell for cell in cells if cell["hears"]]
    safe = sum(1 for cell in hears if cell["at_rest_and_off"])
    codes = Counter(cell["exit_code"] for cell in cells)
    other = sum(count for code, count in codes.items() if code not in {0, 3, 5})
    wrong = sum(1 for cell in cells if cell["wrong"])
    still, rest = (_longest(hears, key) for key in ("still_s", "rest_s"))
    counts = f"{codes[0]} | {codes[3]} | {codes[5]} | {other}"
    return f"| {name} | {len(cells)} | {safe} of {len(hears)} | {still} | {rest} | {counts} | {wrong} |"


def _longest(cells: Sequence[Mapping[str, Any]], key: str) -> str:
    times = [cell[key] for cell in cells if cell[key] is not None]
    return f"{max(times):.1f} s" if times else ""


def _wrong(cells: Iterable[Mapping[str, Any]]) -> list[str]:
    lines = [
        f"- {cell['language']}, {cell['moment']}, {cell['wires']}, {cell['mode']}, "
        f"{'lasting' if cell['lasting'] else 'once'}: {'; '.join(cell['wrong'])}"
        for cell in cells
        if cell["wrong"]
    ]
    return ["\n## What is wrong\n", *lines, ""] if lines else []
