"""Who imports whom, how heavy an import is, and the shape of the code: what docs/architecture.md promises."""

from __future__ import annotations

import ast
import gc
import re
import subprocess
import sys
from collections import Counter, defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parents[1]
PACKAGES = ("vcfbench", "vcfbench_tables", "pyvisa_vcfbench", "simrack/simrack", "simrack/pyvisa_simrack")
FLOORS = [
    {"cli", "__main__"},
    {"validation"},
    {"testing"},
    {"page", "studies"},
    {"runs"},
    {"archive"},
    {"procedures"},
    {"belief", "devices"},
    {"uncertainty"},
    {"instructions"},
    {"reports"},
    {"steps"},
    {"bench"},
    {"safety"},
    {"sim"},
    {"station"},
    {"drivers", "records", "analysis"},
    {
        "interfaces",
        "models",
        "specifications",
        "strict",
        "files",
        "extras",
        "faces",
        "arguments",
        "typed",
        "errors",
        "clock",
        "version",
        "values",
    },
]
SEALED = {"drivers", "records", "analysis"}
FROM_THE_RACK = {
    "vcfbench.__main__": "simrack.stated",
    "vcfbench.clock": "simrack.clock",
    "vcfbench.specifications": "simrack.specifications",
}
KNOW_THE_SIMULATION = (
    *("vcfbench.bench", "vcfbench.cli.sim", "vcfbench.cli.serve", "vcfbench.sim", "vcfbench.testing"),
    *("vcfbench.cli.bench_new", "vcfbench.studies.truth"),
    "pyvisa_vcfbench",
    "pyvisa_simrack",
    "simrack",
)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
HEAVY = {"numpy", "scipy", "pyvisa", "pyvisa_py", "serial", "rich", "numba", "starlette", "uvicorn"}


@cache
def modules() -> dict[str, ast.Module]:
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    gc.disable()  # it would look again and again at a million nodes that stay
    try:
        return {module_name(path): ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    finally:
        gc.freeze()
        gc.enable()


@cache
def nodes(module: str) -> list[ast.AST]:
    return list(ast.walk(modules()[module]))


def module_name(path: Path) -> str:
    home = ROOT / "simrack" if path.is_relative_to(ROOT / "simrack") else ROOT
    return ".".join(path.relative_to(home).with_suffix("").parts).removesuffix(".__init__")


@cache
def imports(module: str) -> list[str]:
    """Every module named in an import, wherever it stands."""
    found = []
    for node in nodes(module):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide who imports whom"
            found += [str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)]
    return found


def floor_of(part: str) -> int:
    return next(level for level, parts in enumerate(FLOORS) if part in parts)


def inner_imports() -> Iterator[tuple[str, str]]:
    for name in modules():
        yield from ((name, target) for target in imports(name) if target.startswith("vcfbench."))


@pytest.mark.exhaustive
def test_every_part_of_the_package_has_its_floor() -> None:
    parts = {name.split(".")[1] for name in modules() if name.startswith("vcfbench.")}
    assert parts <= set().union(*FLOORS)


@pytest.mark.exhaustive  # .importlinter says the same, and its contract is held by `lint-imports`
def test_imports_point_downwards() -> None:
    wrong = []
    for name, target in inner_imports():
        if name.startswith(("pyvisa_vcfbench", "vcfbench_tables")) or "." not in name:
            continue
        ours, theirs = name.split(".")[1], target.split(".")[1]
        if theirs == ours:
            continue
        if floor_of(ours) > floor_of(theirs) or {ours, theirs} <= SEALED:
            wrong.append(f"{name} -> {target}")
    assert wrong == []


@pytest.mark.exhaustive
def test_only_the_bench_knows_that_there_is_a_simulation() -> None:
    wrong = [
        f"{name} -> {target}"
        for name in modules()
        for target in imports(name)
        if f"{target}.".startswith(("vcfbench.sim.", "simrack.")) and not name.startswith(KNOW_THE_SIMULATION)
        if not target.startswith(FROM_THE_RACK.get(name, "-"))
    ]
    assert wrong == []


def test_no_file_is_longer_than_500_lines() -> None:
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    assert [path.name for path in paths if path.read_text(encoding="utf-8").count("\n") > 500] == []


def test_the_plug_in_of_tables_is_found_and_not_imported() -> None:
    own = {"vcfbench." + name for name in ("clock", "drivers", "errors", "files", "interfaces", "models", "strict")}
    seen = [(name, target) for name in modules() for target in imports(name)]
    wrong = [each for each in seen if each[0].startswith("vcfbench.") and each[1].startswith("vcfbench_tables")]
    beyond = [
        (name, target)
        for name, target in seen
        if name.startswith("vcfbench_tables") and target.startswith(("vcfbench.", "simrack"))
        if ".".join(target.split(".")[:2]) not in own
    ]
    assert (wrong, beyond) == ([], [])


def test_the_rack_knows_nobody() -> None:
    ours = ("vcfbench", "vcfbench_tables", "pyvisa_vcfbench")
    rack = [name for name in modules() if name.split(".")[0] in ("simrack", "pyvisa_simrack")]
    assert rack
    seen = [(name, target) for name in rack for target in imports(name)]
    assert [each for each in seen if each[1].startswith(ours)] == []


def parts_and_what_they_import() -> dict[str, dict[str, set[str]]]:
    """By package: which of its parts import which others, for types alone and inside functions too."""
    found: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for name in modules():
        for target in imports(name):
            ours, theirs = name.split("."), target.split(".")
            same = next((n for n, (a, b) in enumerate(zip(ours, theirs, strict=False)) if a != b), None)
            if same and ".".join(theirs[: same + 1]) in modules():
                found[".".join(ours[:same])][ours[same]].add(theirs[same])
    return found


def circle_in(parts: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(parts).prepare()
    except CycleError as error:
        circle: list[str] = error.args[1]
        return circle[::-1]
    return []


def test_nothing_imports_in_circles_not_even_for_types() -> None:
    circles = {package: circle_in(parts) for package, parts in parts_and_what_they_import().items()}
    assert {package: circle for package, circle in circles.items() if circle} == {}


@pytest.mark.parametrize("module", ["vcfbench", "vcfbench.cli.main", "vcfbench.station.description"])
def test_nothing_heavy_is_imported_before_it_is_needed(module: str) -> None:
    code = f"import sys, {module}; print(*sorted(set(sys.modules) & {HEAVY!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.split() == []


def body_lengths() -> Iterator[tuple[str, int]]:
    """Lines of every function body, its docstring not counted; a body of one expression is a table of values."""
    for name in modules():
        for node in nodes(name):
            if isinstance(node, FUNCTIONS):
                body = node.body[1:] if ast.get_docstring(node) is not None else node.body
                table = len(body) == 1 and isinstance(body[0], ast.Return | ast.Expr)
                lines = sum(int(each.end_lineno or 0) - each.lineno + 1 for each in body)
                yield f"{name}.{node.name}", 1 if table else lines


def test_no_function_is_longer_than_a_screen() -> None:
    assert {name: lines for name, lines in body_lengths() if lines > 60} == {}


CLAUSE = re.compile(r"\b(what|who|whoever|whom|whether|how|why|whence|in which way|way in which)\b", re.IGNORECASE)
"""Words that begin a clause in the place of a noun."""
PASS_NAMES_ON = {"clock", "errors", "specifications"}
"""Modules from which others take names that are defined elsewhere."""


def of_vcfbench() -> list[str]:
    return [name for name in modules() if name.startswith("vcfbench.")]


@pytest.mark.parametrize("distribution", ["vcfbench", "simrack"])
def test_first_lines_of_docstrings_hold_few_clauses(distribution: str) -> None:
    """The whole line counts: "Return what is known" names nothing, "Return the known sources" does."""
    kinds = (*FUNCTIONS, ast.ClassDef, ast.Module)
    ours = [name for name in modules() if ("simrack" in name.partition(".")[0]) == (distribution == "simrack")]
    lines = [
        said.splitlines()[0]
        for name in ours
        for node in nodes(name)
        if isinstance(node, kinds) and (said := ast.get_docstring(node))
    ]
    assert sum(CLAUSE.search(line) is not None for line in lines) <= 0.03 * len(lines)


def test_few_names_of_tests_have_more_than_ten_words() -> None:
    """`test_<unit>_<condition>_<result>`; the share may only fall."""
    paths = [*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "simrack" / "simrack_tests").rglob("test_*.py")]
    found = [name for path in paths for name in re.findall(r"^ *def test_(\w+)", path.read_text("utf-8"), re.MULTILINE)]
    assert sum(len(name.split("_")) > 10 for name in found) <= 0.01 * len(found)


def test_few_private_functions_are_called_once() -> None:
    """A helper with one caller in its file sends the reader there and back."""
    once, count = 0, 0
    for module in of_vcfbench():
        uses = Counter(node.id for node in nodes(module) if isinstance(node, ast.Name))
        uses.update(node.attr for node in nodes(module) if isinstance(node, ast.Attribute))
        names = [node.name for node in nodes(module) if isinstance(node, FUNCTIONS)]
        once += sum(uses[name] == 1 for name in names if name.startswith("_") and not name.startswith("__"))
        count += len(names)
    assert once <= 0.14 * count


def test_lists_of_public_names_stand_where_names_are_passed_on() -> None:
    lists = {name.removeprefix("vcfbench.") for name in of_vcfbench() if "__all__" in set(names(name))}
    assert lists <= PASS_NAMES_ON


def test_imports_within_functions_are_few() -> None:
    """At most three in two thousand lines: they keep the start quick where a library or a module is large."""
    lines, within = 0, 0
    for name in of_vcfbench():
        spans = [(node.lineno, int(node.end_lineno or 0)) for node in nodes(name) if isinstance(node, FUNCTIONS)]
        found = [node.lineno for node in nodes(name) if isinstance(node, ast.Import | ast.ImportFrom)]
        within += sum(any(first < line <= last for first, last in spans) for line in found)
        lines += int(modules()[name].body[-1].end_lineno or 0)
    assert 1000.0 * within <= 1.5 * lines


def test_nothing_reads_results_by_the_names_of_their_fields() -> None:
    """What a run found are its values, found by type; one reader of records knows the names of before."""
    of_mapping = {"values", "items", "keys", "get"}  # of values by name
    reading = []
    for name in of_vcfbench():
        room, _, module = name.removeprefix("vcfbench.").partition(".")
        if room in ("procedures", "devices", "uncertainty") or module == "stated":
            continue
        for node in nodes(name):
            match node:
                case ast.Attribute(value=ast.Attribute(attr="results"), attr=field) if field not in of_mapping:
                    found = field
                case (
                    ast.Call(func=ast.Name("getattr" | "hasattr"), args=[ast.Attribute(attr="results"), *_])
                    | ast.Call(func=ast.Name("getattr" | "hasattr"), args=[ast.Name("results"), *_])
                    | ast.Subscript(value=ast.Name("results"), slice=ast.Constant(str()))
                    | ast.Subscript(value=ast.Attribute(attr="results"), slice=ast.Constant(str()))
                ):
                    found = "by name"
                case _:
                    continue
            reading.append(f"{name}:{node.lineno} {found}")
    assert reading == []


def test_every_module_explains_itself() -> None:
    assert [name for name, tree in modules().items() if not ast.get_docstring(tree)] == []


def class_names(part: str) -> set[str]:
    found = [node for name in modules() if f"{name}.".startswith(f"{part}.") for node in nodes(name)]
    kinds = {node.name for node in found if isinstance(node, ast.ClassDef)}
    return {kind for kind in kinds if not kind.startswith("_")}


def test_driver_and_twin_classes_have_different_names() -> None:
    """Who reads of an E3631A must know whether it is the driver or the instrument."""
    assert (class_names("vcfbench.drivers") | class_names("vcfbench.interfaces")) & class_names("simrack") == set()


def names(module: str) -> Iterator[str]:
    """Yield what a module names by itself: functions, classes, parameters, variables, fields."""
    for node in nodes(module):
        if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def test_names_are_words_of_the_field() -> None:
    """What was told is stated, commanded, reported or recorded: a name says which."""
    private = {"told", "misfit", "misfits", "mishap", "mishaps"}
    found = {f"{module}: {name}" for module in modules() for name in names(module)}
    assert {each for each in found if private & set(each.partition(": ")[2].lower().split("_"))} == set()


def test_the_files_that_the_map_names_are_there() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.split("## Where is ...?")[1].split("\n## ")[0]
    named = re.findall(r"\| `([^`]+)`[^|]*\|$", table, re.MULTILINE)
    assert len(named) >= 20
    assert [name for name in named if not (ROOT / name).is_file()] == []
