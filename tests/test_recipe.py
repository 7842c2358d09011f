"""The conda recipe asks for what the distributions ask for."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

from vcfbench.version import installed_version

ROOT = Path(__file__).parents[1]
OF_CONDA = {"matplotlib": "matplotlib-base"}
"""What conda-forge calls by another name: without the windows of a desktop."""


@pytest.fixture(scope="module")
def recipe() -> dict[str, Any]:
    yaml = pytest.importorskip("yaml")
    return dict(yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text("utf-8")))


@pytest.mark.parametrize(("name", "file"), [("vcfbench", "pyproject.toml"), ("simrack", "simrack/pyproject.toml")])
def test_requirements_are_those_of_the_distribution(recipe: dict[str, Any], name: str, file: str) -> None:
    project = tomllib.loads((ROOT / file).read_text("utf-8"))["project"]
    asked = {each.name: str(each.specifier) for each in map(Requirement, project["dependencies"])}
    wanted = {OF_CONDA.get(key, key): by for key, by in asked.items() if key != "simrack"}
    wanted["python"] = project["requires-python"]
    (output,) = (each for each in recipe["outputs"] if each["package"]["name"] == name)
    found = dict(line.split(" ", 1) for line in output["requirements"]["run"])
    assert (found.pop("simrack", None) is not None) == ("simrack" in asked)
    assert found == wanted


def test_rattler_build_renders_both_packages(recipe: dict[str, Any]) -> None:
    """It refuses keys that it does not know, and specs that conda cannot read."""
    rattler_build = pytest.importorskip("rattler_build", reason="pip install '.[dev]'")
    rendered = rattler_build.Stage0Recipe.from_file(ROOT / "recipe" / "recipe.yaml").render()
    assert [each.recipe.package.name for each in rendered] == [each["package"]["name"] for each in recipe["outputs"]]


def test_version_is_that_of_the_release(recipe: dict[str, Any]) -> None:
    assert installed_version().startswith(recipe["context"]["version"])
