"""Which wrong lines the tests see: mutants of one line each, drawn by seed, against the tests nearest to their module.

    python experiments/mutants.py 0:36 --lines mutants.jsonl    seeds 0 to 35, a line each
    python experiments/mutants.py --summary mutants.jsonl

A seed draws a module of the procedures, of the rooms below them, of analysis or sim/gyro, by its length, and in a
function of it an operator, sign, number, root, size or comparison that becomes another. The tests are those that
import the module, and the tables of parts and of values; none is exhaustive. They run in a copy of what git has, so
that nothing here is touched. Killed is a mutant where one fails. What stands in the file of --lines is not run again.
The exit code is 1 where fewer than 95 % are killed.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import random
import re
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parents[1]
WHERE = ("procedures", "uncertainty", "belief", "devices", "instructions", "analysis", "sim/gyro")
TABLES = ("tests/procedures/parts", "tests/procedures/test_plans.py", "tests/runs/test_expected.py")
SMALL = ("belief", "devices", "instructions", "sim/gyro")
"""Rooms all of whose tests are near: they reach a module through others."""
LEAST = 0.95
LONGEST_S = 900.0
SWAPS: dict[type[ast.AST], str] = {
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.Lt: ">=",
    ast.Gt: "<=",
    ast.LtE: ">",
    ast.GtE: "<",
}


def git(*words: str) -> bytes:
    command = ["git", "-C", str(ROOT), *words]
    return subprocess.run(command, check=True, capture_output=True).stdout


def mutations(tree: ast.AST, lines: list[str]) -> Iterator[tuple[int, str]]:
    """Yield line numbers, from 0, and what stands there of each mutant: one place of it each, in functions alone."""
    functions = [each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef)]
    for node in {id(node): node for each in functions for part in each.body for node in ast.walk(part)}.values():
        match node:
            case ast.BinOp(left=first, right=second) | ast.Compare(left=first, comparators=[second]):
                kind = node.op if isinstance(node, ast.BinOp) else node.ops[0]
                if type(kind) in SWAPS and first.end_lineno == second.lineno:
                    line = lines[second.lineno - 1]
                    middle = line[first.end_col_offset : second.col_offset]
                    marks = "".join(each for each in middle if each not in " ()")
                    if marks in {"+", "-", "*", "/", "<", ">", "<=", ">="}:
                        other = middle.replace(marks, SWAPS[type(kind)])
                        yield second.lineno - 1, line[: first.end_col_offset] + other + line[second.col_offset :]
            case ast.UnaryOp(op=ast.USub()):
                line = lines[node.lineno - 1]
                yield node.lineno - 1, f"{line[: node.col_offset]} {line[node.col_offset + 1 :]}"
            case ast.Constant(value=float(value)) if value:
                line, end = lines[node.lineno - 1], node.end_col_offset or 0
                yield node.lineno - 1, f"{line[: node.col_offset]}{2.0 * value!r}{line[end:]}"
            case ast.Call(func=ast.Attribute(attr="sqrt")):
                line, at = lines[node.lineno - 1], node.func.end_col_offset or 0
                yield node.lineno - 1, f"{line[: at - len('sqrt')]}fabs{line[at:]}"
            case ast.Call(func=ast.Name(id="abs"), args=[_]):
                line, at = lines[node.lineno - 1], node.func.end_col_offset or 0
                yield node.lineno - 1, f"{line[: at - 3]}{line[at:]}"


def drawn(seed: int) -> tuple[str, int, str]:
    """Return the module of a seed, the number of its line from 0, and what shall stand there."""
    chance = random.Random(f"mutant {seed}")  # noqa: S311 - no secret
    names = git("ls-files", *(f"vcfbench/{each}" for each in WHERE)).decode().split()
    modules = [name for name in names if name.endswith(".py")]
    while True:
        name = chance.choices(modules, [(ROOT / each).stat().st_size for each in modules])[0]
        text = (ROOT / name).read_text("utf-8")
        lines = text.splitlines()
        if found := list(mutations(ast.parse(text), lines)):
            number, line = chance.choice(found)
            return name, number, line


def tests_of(name: str) -> list[str]:
    """Return the files of tests that import a module, bear its name or stand in its room; else those of its users."""
    dotted = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    package, _, own = dotted.rpartition(".")
    imports = re.compile(rf"(?:from {dotted} import|from {package} import [^\n]*\b{own}\b|import {dotted}\b)")
    named = (f"/test_{own}.py", f"/test_{package.rpartition('.')[2]}.py")
    room = next((f"tests/{each}/" for each in SMALL if name.startswith(f"vcfbench/{each}/")), "no room")
    every = git("ls-files", "tests/*/test_*.py").decode().split()
    near = [each for each in every if each.endswith(named) or each.startswith(room)]
    found = [*near, *(each for each in every if each not in near and imports.search((ROOT / each).read_text("utf-8")))]
    if found or name.endswith("/__init__.py"):
        return found
    modules = git("ls-files", "vcfbench/*.py").decode().split()
    users = [each for each in modules if imports.search((ROOT / each).read_text("utf-8"))]
    return sorted({each for user in users for each in tests_of(user)})


def failing(copy: Path, *words: str) -> list[str]:
    """Return what pytest says of tests that fail, or its last words where it does not come so far."""
    asked = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", *words]
    done = subprocess.run(asked, cwd=copy, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    seen = [each for each in done.stdout.splitlines() if each.startswith(("FAILED", "ERROR"))]
    return seen or ([done.stdout[-300:] + done.stderr[-300:]] if done.returncode else [])


def tried(seed: int, copy: Path, without: list[str]) -> dict[str, Any]:
    """Return the line of a seed: what was changed, and by which test it is seen, `without` those that fail anyway."""
    name, number, changed = drawn(seed)
    path = copy / name
    whole = path.read_text("utf-8")
    lines = whole.splitlines()
    line = {"seed": seed, "module": name, "line": number + 1, "was": lines[number].strip(), "is": changed.strip()}
    path.write_text("\n".join([*lines[:number], changed, *lines[number + 1 :]]) + "\n", "utf-8")
    try:
        for tests in ([each for each in tests_of(name) if not each.startswith(TABLES)], list(TABLES)):
            if tests and (seen := failing(copy, "-x", *tests, *without)):
                return line | {"killed": True, "by": seen[0][:200]}
    except subprocess.TimeoutExpired:
        return line | {"killed": True, "by": "it does not end"}
    finally:
        path.write_text(whole, "utf-8")
    return line | {"killed": False}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="?", default="0:36", help="first, and the one after the last")
    parser.add_argument("--lines", type=Path, default=Path("mutants.jsonl"))
    parser.add_argument("--summary", type=Path, help="run nothing, sum up such a file")
    asked = parser.parse_args()
    file = asked.summary or asked.lines
    had = [json.loads(each) for each in file.read_text("utf-8").splitlines()] if file.exists() else []
    if asked.summary is None:
        first, after = map(int, asked.seeds.split(":"))
        with tempfile.TemporaryDirectory() as name:
            with tarfile.open(fileobj=io.BytesIO(git("archive", "HEAD"))) as archive:
                archive.extractall(name, filter="data")
            anyway = failing(Path(name), *TABLES)
            without = [word for each in anyway for word in ("--deselect", each.split(" - ")[0].removeprefix("FAILED "))]
            for seed in sorted(set(range(first, after)) - {each["seed"] for each in had}):
                had.append(tried(seed, Path(name), without))
                with file.open("a", encoding="utf-8") as out:
                    print(json.dumps(had[-1]), file=out)
    for each in had:
        if not each["killed"]:
            print(f"{each['seed']} {each['module']}:{each['line']}\n    {each['was']}\n    {each['is']}")
    killed = sum(each["killed"] for each in had)
    print(f"{killed} of {len(had)} are killed")
    return int(killed < LEAST * len(had))


if __name__ == "__main__":
    sys.exit(main())
