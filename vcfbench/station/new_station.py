"""A bench file for a new station: the instruments found, put into the commented template."""

import re
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, Final

from vcfbench.errors import ConfigError
from vcfbench.models import ROLES
from vcfbench.station.consistency import LIMITS_OF
from vcfbench.station.description import BenchDescription
from vcfbench.station.file import checked_bench, template
from vcfbench.station.settings import PAPER_RATES_DEG_S
from vcfbench.station.writing import nested_tables, table_lines, value_text

LATITUDE: Final = "site.latitude_deg"
MAINS: Final = "site.mains_hz"
RAIL: Final = "procedure.positive_rail_v"

DEFAULT_LIMITS: Final[Mapping[str, float]] = {
    "max_rate_deg_s": 50.0,
    "max_acceleration_deg_s2": 50.0,
    "max_v_vc_v": 1.5,  # 225 deg/s by the K_Vc of the paper: room for its +-200
    "min_rail_v": 9.5,
    "max_rail_v": 10.5,
    "max_rail_current_a": 0.2,
    "min_temperature_c": -40.0,
    "max_temperature_c": 85.0,
    "max_ramp_k_min": 60.0,
}
"""Proposals of limits to begin with, low: Enter must not let an unknown table or gyroscope go further."""

_HEADER = re.compile(r"(?:# )?\[(?P<table>[A-Za-z0-9_.-]+)\](?P<rest>\s.*)?")
_KEY = re.compile(
    r"(?P<off># )?(?P<key>[A-Za-z0-9_]+) = (?P<value>[^#\"\[]+?|\"[^\"]*\"|\[[^\]]*\])(?P<note>\s+#.*|\s*)"
)
_NOTE_COLUMN: Final = 40
_ROLES: Final = (*ROLES, "rate_table")


_MATCHES: Final = ("procedure.kvc.match_rates_deg_s", "procedure.self-calibration.virtual_rates_deg_s")
_RATES_DEG_S: Final = {
    "phase.rate_deg_s": 100.0,
    "online.virtual_rate_deg_s": 50.0,
    "threshold.at_rate_deg_s": 10.0,
    "polarity.polarity_rate_deg_s": 10.0,
}
"""Rates of single procedures where nothing is set."""


def _fitting_rates(limit_deg_s: float) -> dict[str, Any]:
    """Return rates that stay below a limit, for every procedure whose own do not."""
    largest = {f"procedure.{key}": most for key, most in _RATES_DEG_S.items()}
    if limit_deg_s >= max(PAPER_RATES_DEG_S):
        return dict.fromkeys(("procedure.rates_deg_s", "procedure.virtual-coriolis", *_MATCHES, *largest))
    fitting = [rate for rate in PAPER_RATES_DEG_S if abs(rate) <= limit_deg_s]
    rates = fitting if len(fitting) >= 7 else [limit_deg_s * part for part in (1.0, 0.5, 0.2, 0.0, -0.2, -0.5, -1.0)]
    positive = [rate for rate in reversed(rates) if rate > 0.0]
    match = {"match_rate_deg_s": min(10.0, limit_deg_s), "match_rates_deg_s": positive}
    curve = [round(limit_deg_s * part, 6) for part in (0.1, 0.2, 0.4, 0.7, 1.0)]
    single = {key: min(most, limit_deg_s) if most > limit_deg_s else None for key, most in largest.items()}
    return {
        "procedure.rates_deg_s": rates,
        "procedure.virtual-coriolis": match,
        **dict.fromkeys(_MATCHES, curve),
        **single,
    }


def _rails(volts: Any) -> dict[str, Any]:
    if not isinstance(volts, int | float) or volts <= 0.0:
        raise ConfigError(f"{RAIL}: expected volts above 0, got {volts!r}")
    own = {"positive": None, "negative": None} if volts == 10.0 else {"positive": volts, "negative": -volts}
    window = {"limits.min_rail_v": round(0.95 * volts, 6), "limits.max_rail_v": round(1.05 * volts, 6)}
    return {**window, **{f"procedure.{rail}_rail_v": level for rail, level in own.items()}}


_FOLLOW: Final[dict[str, Callable[[float], dict[str, Any]]]] = {
    "limits.max_rate_deg_s": _fitting_rates,
    "limits.max_acceleration_deg_s2": lambda most: {"procedure.acceleration_deg_s2": most if most < 100.0 else None},
    "limits.max_rail_current_a": lambda most: {"procedure.rail_current_limit_a": most if most < 0.1 else None},
    RAIL: _rails,
}
"""What else a value decides: settings of the procedures that would leave a limit."""


class Draft:
    """A bench file that is being made: whole and right at every moment, or the change is refused."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.values: dict[str, Any] = {"name": "lab-1", "title": "calibration bench", "site": {"latitude_deg": 0.0}}

    def change(self, changes: Mapping[str, Any]) -> BenchDescription:
        """Set values at their dotted keys (None removes one) and check the whole.

        Raises:
            ConfigError: it would not be a bench file any more; nothing is changed.
        """
        candidate = deepcopy(self.values)
        for path, value in changes.items():
            if value is None and self.value(path) is None:
                continue
            values = candidate
            *tables, key = path.split(".")
            for table in tables:
                values = values.setdefault(table, {})
            if value is None:
                values.pop(key, None)
            else:
                values[key] = value
        description = checked_bench(candidate, self.source, folder=Path(self.source).parent)
        self.values = candidate
        return description

    def set(self, given: Mapping[str, Any]) -> None:
        """Put values at their dotted keys, and the settings that follow from them.

        Raises:
            ConfigError: it would not be a bench file any more.
        """
        self.change(given)
        follow = [_FOLLOW[key](value) for key, value in given.items() if key in _FOLLOW]
        settled = {*given, *(["procedure.negative_rail_v"] if self.value("wiring.rails.negative") == "none" else [])}
        self.change({key: value for each in follow for key, value in each.items() if key not in settled})

    def add_instrument(self, role: str, keys: Mapping[str, Any]) -> None:
        """Put an instrument on the bench, with proposals for its limits.

        Raises:
            ConfigError: it cannot be there.
        """
        known = self.values.get("limits", {})
        limits = {f"limits.{key}": known.get(key, DEFAULT_LIMITS[key]) for key in LIMITS_OF.get(role, ())}
        self.set({role: dict(keys), **limits})

    def roles(self) -> list[str]:
        """Return the roles that are filled."""
        return [role for role in _ROLES if role in self.values]

    def value(self, path: str) -> Any:
        """Return the value at a dotted key, or None."""
        below: Any = self.values
        for key in path.split("."):
            below = below.get(key) if isinstance(below, dict) else None
        return below

    def text(self, head: str) -> str:
        """Return the bench file: `head` and the wiring of the supply as remarks, then the template with the values."""
        wired = self.change({}).rails_at
        return filled_template(template(), self.values, f"{head}\n# {wired}" if wired else head)


def filled_template(text: str, values: Mapping[str, Any], head: str) -> str:
    """Return the template `text` with `values` at their keys; all other keys are remarks, with their meanings."""
    left = {table: dict(keys) for table, keys in nested_tables(values)}
    lines: list[str] = [f"# {head}", "#"]
    for table, block in _blocks(text):
        lines += _filled_block(table, block, left.pop(table, None))
    for table, keys in left.items():
        lines += table_lines(table, keys)
    return "\n".join(lines) + "\n"


def _blocks(text: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the lines of each table of the template, its header first; the name of those before the first is ''."""
    table, block = "", list[str]()
    for line in text.splitlines():
        header = _HEADER.fullmatch(line)
        if header is not None:
            yield table, block
            table, block = header["table"], []
        block.append(line)
    yield table, block


def _filled_block(table: str, block: list[str], keys: dict[str, Any] | None) -> list[str]:
    """Return a block with `keys` in it; None leaves all of it as remarks."""
    lines: list[str] = []
    left = dict(keys or {})
    last_key = 0
    for line in block:
        key = _KEY.fullmatch(line)
        if _HEADER.fullmatch(line):
            missing = keys is None and table.partition(".")[0] in _ROLES
            lines.append(line if keys is None and not missing else _switched(line, on=not missing))
            last_key = len(lines)
        elif key is None:
            lines.append(line)
        else:
            if key["key"] in left:
                setting, note = f"{key['key']} = {value_text(left.pop(key['key']))}", key["note"].strip()
                if note == "# put yours":  # it is not the template's proposal any more
                    note = ""
                lines.append(f"{setting:<{_NOTE_COLUMN - 1}} {note}" if note else setting)
            else:
                lines.append(_switched(line, on=False))
            last_key = len(lines)
    lines[last_key:last_key] = [f"{key} = {value_text(value)}" for key, value in left.items()]
    return lines


def _switched(line: str, *, on: bool) -> str:
    bare = line.removeprefix("# ")
    return bare if on else f"# {bare}"
