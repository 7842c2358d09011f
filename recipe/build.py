# noqa: INP001 - a script
"""Build both packages of recipe.yaml by rattler-build, and run their tests, where conda-forge is out of reach.

    pip install py-rattler py-rattler-build packaging
    pip download --dest dist dist/*.whl pip hatchling
    python recipe/build.py dist build/conda

`dist` has the sdists and wheels of a release. Stand-ins for the packages of conda-forge are made of the wheels there
and of the Python that runs this. So requirements, build and tests of the recipe are tried, and not whether conda-forge
has each package in that version.
"""

from __future__ import annotations

import asyncio
import hashlib
import re
import shutil
import sys
from email.parser import Parser
from pathlib import Path
from zipfile import ZipFile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from rattler.index import index_fs
from rattler_build import Package, Stage0Recipe, assemble_package

RECIPE = Path(__file__).with_name("recipe.yaml")
OF_CONDA = {"matplotlib": "matplotlib-base"}
PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"
SITE = Path("lib", PYTHON, "site-packages")
OURS = ("simrack", "vcfbench")


def stand_in(channel: Path, name: str, version: str, files: Path, depends: list[str]) -> None:
    """Put a package with these files into the channel."""
    assemble_package(
        *(OF_CONDA.get(name, name), version, "linux-64", "0", channel / "linux-64"),
        files_dir=files,
        depends=depends,
        compression_level=1,
        detect_prefix=False,
    )


def of_this_python(channel: Path, files: Path) -> None:
    """Put the Python that runs this into the channel."""
    base = Path(sys.base_prefix)
    left_out = shutil.ignore_patterns("site-packages", "dist-packages", "test", "__pycache__", "config-*")
    shutil.copytree(base / "lib" / PYTHON, files / "lib" / PYTHON, ignore=left_out)
    for library in base.glob("lib/libpython3*.so*"):
        shutil.copy(library, files / "lib")
    (files / "bin").mkdir()
    for name in ("python", "python3", PYTHON):
        shutil.copy(base / "bin" / PYTHON, files / "bin" / name)
    stand_in(channel, "python", sys.version.split()[0], files, [])


def of_wheel(channel: Path, wheel: Path, files: Path) -> None:
    """Put what a wheel installs into the channel, with its requirements."""
    with ZipFile(wheel) as archive:
        (listed,) = (name for name in archive.namelist() if re.fullmatch(r"[^/]+\.dist-info/METADATA", name))
        metadata = Parser().parsestr(archive.read(listed).decode())
        archive.extractall(files / SITE)
    wanted = [each for each in map(Requirement, metadata.get_all("Requires-Dist") or ()) if not_an_extra(each)]
    names = [canonicalize_name(each.name) for each in wanted]
    depends = [f"{OF_CONDA.get(name, name)} {each.specifier}".strip() for name, each in zip(names, wanted, strict=True)]
    stand_in(channel, canonicalize_name(metadata["Name"]), metadata["Version"], files, ["python", *depends])


def not_an_extra(asked: Requirement) -> bool:
    """Return True if it is required without an extra."""
    return asked.marker is None or asked.marker.evaluate({"extra": ""})


def with_sources(dist: Path) -> str:
    """Return the recipe with addresses and sums of the sdists in `dist`."""
    text = RECIPE.read_text("utf-8")
    version = re.findall(r'^  version: "(.+)"$', text, re.MULTILINE)[0]
    for name in OURS:
        path = (dist / f"{name}-{version}.tar.gz").resolve()
        text = text.replace(f"https://vcfbench.invalid/dist/{name}-${{{{ version }}}}.tar.gz", path.as_uri())
        text = text.replace("0" * 64, hashlib.sha256(path.read_bytes()).hexdigest(), 1)
    return text


def main(dist: Path, work: Path) -> int:
    """Build and try both packages in `work`, which must be new; return 1 if a test of theirs fails."""
    channel, out = work / "channel", work / "out"
    for folder in (channel / "linux-64", channel / "noarch", out, work / "recipe"):
        folder.mkdir(parents=True)
    of_this_python(channel, work / "files" / "python")
    for wheel in sorted(dist.glob("*.whl")):
        if not wheel.name.startswith(OURS):
            of_wheel(channel, wheel, work / "files" / wheel.stem)
    asyncio.run(index_fs(channel))
    recipe = work / "recipe" / "recipe.yaml"
    recipe.write_text(with_sources(dist), "utf-8")
    channels = [channel.resolve().as_uri(), out.resolve().as_uri()]
    failed = 0
    for variant in Stage0Recipe.from_file(recipe).render():
        for path in variant.run_build(output_dir=out, channels=channels, no_build_id=True).packages:
            for result in Package.from_file(path).run_tests(channel=channels):
                sys.stdout.write(f"{Path(path).name}: {'holds' if result.success else result.output}\n")
                failed += not result.success
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:3])))
