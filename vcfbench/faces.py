"""Public names of packages: the stub next to ``__init__.py`` is their one list."""

import re
from pathlib import Path

_IMPORT = re.compile(r"^from (\S+) import ([^(\n]+|\([^)]*\))", re.MULTILINE)


def homes(init: str) -> dict[str, str]:
    """Return the module of each public name, from the imports in the stub next to the file `init`."""
    text = Path(init).with_suffix(".pyi").read_text(encoding="utf-8")
    return {name: module for module, names in _IMPORT.findall(text) for name in re.findall(r"(\w+) as \1", names)}
