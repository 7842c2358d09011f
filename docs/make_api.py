# noqa: INP001 - a script, not a package
"""Makes the page of the API, every public name with its signature and docstring, from the source.

The site has it (docs/site_hook.py); `python docs/make_api.py` prints it. Nothing is imported. Names are grouped by the
package that defines them, members are in the order of the source.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vcfbench.faces import homes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

DOCS = Path(__file__).parent
PACKAGE = DOCS.parent / "vcfbench"
GROUPS = {
    "Runs": ("runs", "safety", "archive", "records", "studies"),
    "Results": ("values", "procedures.turntable", "procedures.virtual_coriolis", "analysis.column"),
    "Reports": ("reports",),
    "Benches": ("bench", "station", "procedures.bench_file"),
    "Procedures": ("procedures", "instructions", "steps"),
    "Analysis": ("analysis",),
    "Instruments": ("interfaces",),
    "Time": ("clock",),
    "Validation": ("validation",),
    "Errors": ("errors",),
}
"""Titles, and where the names below them are defined; a name is in the group with the longest fit."""

HEAD = """\
# API reference

Everything that `import vcfbench` offers, made from the docstrings. How it is used is in [From Python](python.md).

The examples begin with the names of this one, `run` (a complete run of a simulated bench) with the `events` that its
observer got, `stopped` (a run that was broken off) and the `settings` of `run` by its bench file `lab.toml`:

```pycon
>>> from dataclasses import dataclass
>>> from typing import Annotated
>>> import vcfbench
>>> from msgspec import Meta
>>> from vcfbench.clock import ScaledClock, VirtualClock, WallClock, sleep
>>> from vcfbench.testing import open_simulated
>>> with open_simulated("ideal", seed=1) as lab:
...     bench = lab.bench
...     lab.fault("multimeter", "overload")  # faults show which errors come
```
"""
EXAMPLE = re.compile(r"^>>> .+?(?=\n\n|\Z)", re.MULTILINE | re.DOTALL)
SECTION = re.compile(r"^(Args|Raises|Returns|Yields):$", re.MULTILINE)
ITEM = re.compile(r"^(?P<name>[\w*.]+): +(?P<words>.*)$")
WORDS = {"Args": "Arguments", "Raises": "Raises", "Returns": "Returns", "Yields": "Yields"}
WIDEST = 90
Function = ast.FunctionDef | ast.AsyncFunctionDef


def api_page() -> str:
    """Return the page."""
    homes = public_homes()
    parts = [HEAD]
    for group in GROUPS:
        parts.append(f"## {group}\n")
        names = (name for name, module in homes.items() if group_of(module) == group)
        parts += [each for name in names for each in described(name, homes[name])]
    return linked("\n".join(parts), list(homes))


def group_of(module: str) -> str:
    """Return the title under which names of a module are."""
    fits = [(len(home), title) for title, places in GROUPS.items() for home in places if within(module, home)]
    return max(fits)[1]


def within(module: str, home: str) -> bool:
    """Return whether a module is a package, or in it."""
    return f"{module}.".startswith(f"vcfbench.{home}.")


def public_homes() -> dict[str, str]:
    """Return the module of each public name, as the stub of the package imports them."""
    return homes(str(PACKAGE / "__init__.py"))


@cache
def source_of(module: str) -> tuple[str, ast.Module]:
    """Return text and tree of a module."""
    home = PACKAGE.parent / "simrack" if module.startswith("simrack.") else PACKAGE.parent
    path = home / Path(*module.split("."))
    text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
    return text, ast.parse(text)


def described(name: str, module: str) -> Iterator[str]:
    """Yield what there is to say of a public name."""
    text, tree = source_of(home_of(name, module))
    node, said = next((node, said) for node, said in documented(tree.body) if name in defined(node))
    if isinstance(node, ast.ClassDef):
        yield f"### class {name}\n"  # so that Run and run are two headings
        yield from a_class(node, text)
    elif isinstance(node, Function):
        yield f"### {name}\n"
        yield from a_function(node, text)
    else:
        yield f"### {name}\n"
        yield fenced(source(text, node))
        if said:
            yield markdown(said)


def home_of(name: str, module: str) -> str:
    """Return the module that defines a name which `module` has, if only by importing it."""
    body = source_of(module)[1].body
    if any(name in defined(node) for node in body):
        return module
    imports = (node for node in body if isinstance(node, ast.ImportFrom))
    return home_of(name, next(str(node.module) for node in imports if name in {alias.name for alias in node.names}))


def documented(body: Sequence[ast.stmt]) -> Iterator[tuple[ast.stmt, str]]:
    """Yield every statement with the docstring that stands below it."""
    for node, below in zip(body, [*body[1:], None], strict=True):
        yield node, docstring(below)


def docstring(node: ast.stmt | None) -> str:
    """Return the words of a statement that is nothing but a string."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return cleandoc(node.value.value)
    return ""


def defined(node: ast.stmt) -> list[str]:
    """Return the names that a statement gives a value."""
    if isinstance(node, ast.ClassDef | Function):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]


def a_class(node: ast.ClassDef, text: str) -> Iterator[str]:
    """Yield a class: how it is made, its docstring, its fields, properties and methods."""
    names = (source(text, base) for base in node.bases)
    bases = ", ".join(name for name in names if name and name != "Struct")  # how its fields are kept is nothing to know
    methods = [each for each in node.body if isinstance(each, Function)]
    constructor = next((each for each in methods if each.name == "__init__"), None)
    if constructor is not None:
        yield fenced(f"{node.name}{arguments(constructor, text)}")
    elif bases:
        yield fenced(f"class {node.name}({bases})")
    yield markdown(ast.get_docstring(node) or "")
    fields = list(fields_of(node, text))
    if fields:
        yield "\n".join([*fields, ""])
    for each in methods:
        if not each.name.startswith("_"):
            yield from a_method(each, node.name, text)


def fields_of(node: ast.ClassDef, text: str) -> Iterator[str]:
    """Yield a line for every public field: its name, type and default, and the words below it."""
    for each, said in documented(node.body):
        names = [name for name in defined(each) if not name.startswith("_")]
        if not names or not isinstance(each, ast.AnnAssign | ast.Assign):
            continue
        if isinstance(each, ast.AnnAssign):
            annotation, description = described_type(each.annotation)
            kind = f"{names[0]}: {source(text, annotation)}"
            default = "" if each.value is None else f" = {source(text, each.value)}"
        else:
            description = ""
            kind, default = names[0], f" = {source(text, each.value)}"
        words = " ".join(markdown(said or description).split())
        yield f"- `{' '.join(f'{kind}{default}'.split())}`{words and f': {words}'}"


def described_type(annotation: ast.expr) -> tuple[ast.expr, str]:
    """Return the type of ``Annotated[type, Meta(description=words)]``, or ``said(words)``, and the words."""
    if isinstance(annotation, ast.Subscript) and isinstance(annotation.slice, ast.Tuple):
        kind, *more = annotation.slice.elts
        calls = [each for each in more if isinstance(each, ast.Call)]
        given = {key.arg: key.value for each in calls for key in each.keywords}
        said = [each.args[0] for each in calls if ast.unparse(each.func).endswith("said")]
        words = said[0] if said else given.get("description")
        if isinstance(words, ast.Constant):
            return kind, str(words.value)
    return annotation, ""


def a_method(node: Function, owner: str, text: str) -> Iterator[str]:
    """Yield a method or property."""
    decorators = {source(text, each) for each in node.decorator_list}
    said = markdown(ast.get_docstring(node) or "")
    if "property" in decorators:
        yield f"`{owner}.{node.name}{returned(node, text, ': ')}`\n"
    else:
        yield fenced(f"{owner}.{node.name}{arguments(node, text)}{returned(node, text)}")
    yield said


def a_function(node: Function, text: str) -> Iterator[str]:
    """Yield a function."""
    yield fenced(f"{node.name}{arguments(node, text)}{returned(node, text)}")
    yield markdown(ast.get_docstring(node) or "")


def returned(node: Function, text: str, before: str = " -> ") -> str:
    """Return the type that comes back, as it is written."""
    return "" if node.returns is None else f"{before}{annotated(text, node.returns)}"


def arguments(node: Function, text: str) -> str:
    """Return the arguments in their brackets, as they are written, `self` left out."""
    given = node.args
    places = [*given.posonlyargs, *given.args]
    defaults = [None] * (len(places) - len(given.defaults)) + list(given.defaults)
    words = [argument(each, default, text) for each, default in zip(places, defaults, strict=True)]
    if given.posonlyargs:
        words.insert(len(given.posonlyargs), "/")
    if given.vararg is not None:
        words.append(f"*{argument(given.vararg, None, text)}")
    elif given.kwonlyargs:
        words.append("*")
    words += [argument(*each, text) for each in zip(given.kwonlyargs, given.kw_defaults, strict=True)]
    if given.kwarg is not None:
        words.append(f"**{argument(given.kwarg, None, text)}")
    shown = [word for word in words if word not in {"self", "cls"}]
    line = f"({', '.join(shown)})"
    return line if len(line) <= WIDEST else "(\n    " + ",\n    ".join(shown) + ",\n)"


def source(text: str, node: ast.AST) -> str:
    """Return the source of a node. `ast.get_source_segment` splits all of the text each time: that is most of it."""
    place: Any = node
    lines = encoded_lines(text)[place.lineno - 1 : place.end_lineno]
    lines[-1] = lines[-1][: place.end_col_offset]
    lines[0] = lines[0][place.col_offset :]
    return b"".join(lines).decode()


@cache
def encoded_lines(text: str) -> list[bytes]:
    """Return the lines of a source, which columns count in bytes."""
    return text.encode().splitlines(keepends=True)


def annotated(text: str, node: ast.expr) -> str:
    """Return the source of an annotation, without the quotes of one that names what is defined further on."""
    return source(text, node).strip('"')


def argument(node: ast.arg, default: ast.expr | None, text: str) -> str:
    """Return one argument with its type and default."""
    kind = "" if node.annotation is None else f": {annotated(text, node.annotation)}"
    if default is None:
        return f"{node.arg}{kind}"
    equals = " = " if kind else "="
    return f"{node.arg}{kind}{equals}{source(text, default)}"


def fenced(code: str) -> str:
    """Return code in a block of its own."""
    return f"```\n{code}\n```\n"


def markdown(said: str) -> str:
    """Return a docstring as Markdown: roles and double backquotes as code, sections as lists."""
    head, *rest = SECTION.split(re.sub(r":\w+:`~?([^`]+)`", r"`\1`", said).replace("``", "`").replace("::\n", ":\n"))
    parts = [head.strip()]
    for title, body in zip(rest[::2], rest[1::2], strict=True):
        items, _, after = dedented(body).partition("\n\n")
        parts += [f"{WORDS[title]}:", listed(items), after.strip()]
    return EXAMPLE.sub(lambda found: f"```pycon\n{found[0]}\n```", "\n\n".join(filter(None, parts))) + "\n"


def dedented(body: str) -> str:
    """Return the lines of a section without its indentation; what is not indented comes after an empty line."""
    return "\n".join(line.removeprefix("    ") for line in body.strip("\n").splitlines())


def listed(items: str) -> str:
    """Return ``name: words`` as a list, lines that go on joined to theirs; anything else as it is."""
    lines: list[str] = []
    for line in items.splitlines():
        item = ITEM.match(line)
        if item is not None:
            lines.append(f"- `{item['name']}`: {item['words']}")
        elif lines:
            lines[-1] += f" {line.strip()}"
        else:
            lines.append(line)
    return "\n".join(lines)


def linked(page: str, names: Sequence[str]) -> str:
    """Make links of the public names that the words mention: classes, and functions with their package."""
    classes = "|".join(sorted((name for name in names if name[0].isupper()), key=len, reverse=True))
    functions = "|".join(sorted((name for name in names if name[0].islower()), key=len, reverse=True))
    a_name = re.compile(rf"`(?:vcfbench\.)?(?:\w+\.)*({classes})`|`vcfbench\.({functions})`")
    blocks = re.split(r"(^```\w*\n.*?^```$)", page, flags=re.MULTILINE | re.DOTALL)
    return "".join(each if place % 2 else a_name.sub(link, each) for place, each in enumerate(blocks))


def link(found: re.Match[str]) -> str:
    """Return a name as a link to its heading."""
    name = found[1] or found[2]
    return f"[`{name}`](#{'class-' if found[1] else ''}{name.lower()})"


if __name__ == "__main__":
    print(api_page(), end="")  # noqa: T201
