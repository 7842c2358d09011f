"""``python -m tests.golden --because "COMMIT: what it changed" [PART OF A KEY ...]`` makes the hashes anew.

All of them takes a minute of one processor; parts of keys (``kvc``, ``"online paper"``, ``replies``) take less.
A hash that changed on purpose is made anew in a commit that does nothing else.
"""

from __future__ import annotations

import argparse
import json

from tests.evaluation import require_raised
from tests.golden.cases import HASHES, arithmetic, jobs
from vcfbench.version import EVALUATION


def main() -> None:
    """Make the hashes whose section and key contain one of the words, all without words."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*", metavar="PART OF A KEY")
    parser.add_argument("--because", required=True, help="the commit that changed the numbers, and why")
    asked = parser.parse_args()
    kept = json.loads(HASHES.read_text()) if HASHES.exists() else {"changes": []}
    same = kept.get("made_with") == arithmetic()
    if kept["changes"] and asked.words and not same:
        parser.error(f"the others were made with {kept['made_with']}; make all of them anew, without words")
    sections = {section: {key: kept.get(section, {}).get(key) for key in parts} for section, parts in jobs().items()}
    head = {"changes": kept["changes"], "made_with": arithmetic(), "evaluation": EVALUATION}
    changed = set()
    for section, parts in jobs().items():
        old = sections[section]
        for key, make in parts.items():
            wanted = not asked.words or any(word in f"{section} {key}" for word in asked.words)
            found = make() if wanted or old[key] is None else old[key]
            if section != "replies" and old[key] is not None and found["results"] != old[key]["results"]:
                require_raised(kept.get("evaluation", 0), [key])
            if found != old[key]:
                changed.add(f"{section} {key}")
                print(section, key, _differing(old[key], found), flush=True)  # noqa: T201
                old[key] = found
                HASHES.write_text(_text({**head, **sections}))
    if changed:
        kept["changes"].append(f"{asked.because} ({len(changed)} of {sum(map(len, sections.values()))} changed)")
    HASHES.write_text(_text({**head, **sections}))


def _differing(old: object, new: object) -> str:
    if isinstance(old, dict) and isinstance(new, dict):
        return ", ".join(name for name in new if new[name] != old.get(name))
    return "new" if old is None else "changed"


def _text(whole: dict[str, object]) -> str:
    """Return JSON with one key of a section on a line."""
    parts = [f' "{name}": {_part(value)}' for name, value in whole.items()]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _part(value: object) -> str:
    if isinstance(value, int):
        return str(value)
    if isinstance(value, list):
        return "[\n" + ",\n".join(f"  {json.dumps(each)}" for each in value) + "\n ]"
    assert isinstance(value, dict)
    return "{\n" + ",\n".join(f"  {json.dumps(key)}: {json.dumps(each)}" for key, each in value.items()) + "\n }"


if __name__ == "__main__":
    main()
