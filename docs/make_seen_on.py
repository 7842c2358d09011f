# noqa: INP001 - a script, not a package
"""Makes docs/seen-on.md of the bundles in tests/testing/kit/bundles: `python docs/make_seen_on.py`."""

from __future__ import annotations

from pathlib import Path

from vcfbench.testing.kit.check import checked

HERE = Path(__file__).parent
HEAD = """# Seen on

What real instruments answered, recorded with [the kit](howto/kit.md) and compared with the
simulated instrument of that model. Made by `python docs/make_seen_on.py`.

"""
NONE = "**Empty: nothing has been seen on a real instrument yet.**\n"


def page() -> str:
    """Return the page."""
    seen = [
        each for path in sorted((HERE.parent / "tests/testing/kit/bundles").glob("*.trace")) for each in checked(path)
    ]
    lines = [f"- {each}\n" + "".join(f"    - `{found}`\n" for found in each.differing) for each in seen]
    return HEAD + ("".join(lines) or NONE)


if __name__ == "__main__":
    (HERE / "seen-on.md").write_text(page(), encoding="utf-8")
