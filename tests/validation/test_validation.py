"""The validation passes on a sound program, and names each mistake that is planted into it."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from statistics import NormalDist
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

import vcfbench.analysis.budget
import vcfbench.analysis.regression
import vcfbench.archive.verified
import vcfbench.drivers.hp34401a
from vcfbench.cli.main import app
from vcfbench.reports.text import text_of
from vcfbench.validation import benches, installation, numbers
from vcfbench.validation.check import Checked, made
from vcfbench.validation.validate import Validation, validate, validation_report, write_validation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from vcfbench.validation.check import Check


def exhaustive(*values: object) -> object:
    return pytest.param(*values, marks=pytest.mark.exhaustive)


def failed(checks: Sequence[Check], names: Sequence[str]) -> list[str]:
    asked = [each for each in checks if each.name in names]
    assert len(asked) == len(names)
    return [each.name for each in (made("an area", check) for check in asked) if each.verdict == "FAIL"]


def test_installation_and_arithmetic_are_sound() -> None:
    found = [made("an area", each) for each in (*installation.CHECKS, *numbers.CHECKS)]
    assert [(each.name, each.came) for each in found if each.verdict == "FAIL"] == []


@pytest.mark.parametrize("name", ["limits", exhaustive("wires"), "resumption", "seals", exhaustive("faults")])
def test_simulated_benches_are_sound(name: str) -> None:
    checks = [each for each in benches.checks(30) if each.name == name]
    assert len(checks) == 1
    assert [(each.name, each.came) for each in (made("", c) for c in checks) if each.verdict != "PASS"] == []


def broken_fit(patch: pytest.MonkeyPatch) -> None:
    slope = vcfbench.analysis.regression.slope
    patch.setattr(vcfbench.analysis.regression, "slope", lambda x, y: slope(x, y) * (1.0 + 1e-8))


def wrong_constant(patch: pytest.MonkeyPatch) -> None:
    right = vcfbench.analysis.budget.Source.within
    halved = classmethod(lambda _cls, name, value, half_width, unit="": right(name, value, half_width / 2.0, unit))
    patch.setattr(vcfbench.analysis.budget.Source, "within", halved)


def wrong_allan(patch: pytest.MonkeyPatch) -> None:
    deviation = numbers.allan_deviation
    patch.setattr(numbers, "allan_deviation", lambda record, *rest: deviation(record[:-1], *rest))


def one_sided(patch: pytest.MonkeyPatch) -> None:
    quantile = numbers.t_quantile
    patch.setattr(numbers, "t_quantile", lambda tail, dof: quantile(2.0 * tail, dof))


def no_correlations(patch: pytest.MonkeyPatch) -> None:
    evaluate = vcfbench.analysis.budget.evaluate
    patch.setattr(
        vcfbench.analysis.budget, "evaluate", lambda sources, model, _=None, **rest: evaluate(sources, model, **rest)
    )


def sum_in_place_of_root(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(numbers, "e_n", lambda one, u_one, two, u_two: abs(one - two) / (u_one + u_two))


@pytest.mark.parametrize(
    ("plant", "names"),
    [
        (broken_fit, ["straight line"]),
        (wrong_constant, ["data-sheet limits"]),
        (wrong_allan, ["Allan deviation"]),
        (one_sided, ["Student's t"]),
        (no_correlations, ["correlated sources", "another calculator"]),
        (sum_in_place_of_root, ["agreement"]),
    ],
)
def test_mistake_in_the_arithmetic_is_named(
    plant: Callable[[pytest.MonkeyPatch], None], names: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if "another calculator" in names:
        pytest.importorskip("GTC")
    assert failed(numbers.CHECKS, names) == []
    plant(monkeypatch)
    assert failed(numbers.CHECKS, [each.name for each in numbers.CHECKS]) == names


def test_old_numpy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    version = installation.version
    monkeypatch.setattr(installation, "version", lambda name: "1.20.3" if name == "numpy" else version(name))
    found = made("", installation.CHECKS[0])
    assert (found.verdict, found.came) == ("FAIL", "numpy>=2.0: 1.20.3 is installed")


def installed(folder: Path, name: str, *files: str, version: str = "1.0", origin: str = "{}") -> None:
    """Put a distribution into a folder, as pip leaves it."""
    about = folder / f"{name}-{version}.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.3\nName: {name}\nVersion: {version}\n")
    (about / "direct_url.json").write_text(origin)
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text("")
    empty = "sha256=47DEQpj8HBSa-_TImW-5JCeuQeRkm5NMpJWZG3hSuFU,0"
    (about / "RECORD").write_text("".join(f"{file},{empty}\n" for file in files) + f"{about.name}/RECORD,,\n")


@pytest.mark.parametrize("changed", ["vcfbench/a.py", "vcfbench_tables/profiles/a.toml", "simrack/manuals/a.txt"])
def test_changed_file_is_named(changed: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    cache, command = "vcfbench/__pycache__/a.cpython-311.pyc", "../bin/vcfbench"
    installer = "vcfbench-1.0.dist-info/INSTALLER"  # conda writes its name over pip's
    lib = tmp_path / "lib"
    lib.mkdir()
    installed(lib, "vcfbench", "vcfbench/a.py", "vcfbench_tables/profiles/a.toml", cache, command, installer)
    installed(lib, "simrack", "simrack/manuals/a.txt")
    monkeypatch.syspath_prepend(lib)
    for file in (cache, command, installer):  # the interpreter's and the installer's
        (lib / file).write_text("else")
    sound = made("", installation.CHECKS[1])
    assert (sound.verdict, sound.came) == ("PASS", "3 files unchanged")
    (lib / changed).write_text("K = 2\n")
    found = made("", installation.CHECKS[1])
    assert (found.verdict, found.came) == ("FAIL", f"changed: {changed}")


APART = "vcfbench 1.0 beside simrack 1.1: one tag makes both, install them together"
TREE = '{"dir_info": {"editable": true}, "url": "file:///home/a"}'


@pytest.mark.parametrize(("origin", "said"), [("{}", ("FAIL", APART)), (TREE, ("PASS", "0 as required"))])
def test_simrack_of_another_version_is_named(
    origin: str, said: tuple[str, str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A working tree has the version of the day when it was installed, and runs what is there now."""
    installed(tmp_path, "vcfbench", version="1.0")
    installed(tmp_path, "simrack", version="1.1", origin=origin)
    monkeypatch.syspath_prepend(tmp_path)
    found = made("", installation.CHECKS[0])
    assert (found.verdict, found.came) == said


def test_working_tree_has_no_sums(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("vcfbench", "simrack"):
        installed(tmp_path, name, f"_{name}.pth", origin=TREE)
    monkeypatch.syspath_prepend(tmp_path)
    assert made("", installation.CHECKS[1]).verdict == "NOT CHECKED"


def test_every_package_has_its_sum_whatever_its_files_are(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    packages = ("vcfbench", "vcfbench_tables", "pyvisa_vcfbench", "simrack", "pyvisa_simrack")
    assert {f"{each}, SHA-256 of its files" for each in packages} <= set(installation.versions())
    package = tmp_path / "some_tables"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "profile.toml").write_text("a = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = installation.fingerprint("some_tables")
    (package / "a.pyc").touch()
    assert installation.fingerprint("some_tables") == before
    (package / "profile.toml").write_text("a = 2\n")
    assert installation.fingerprint("some_tables") != before


def test_seals_that_are_not_checked_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vcfbench.archive.verified._Check, "findings", lambda _: iter(()))
    assert failed(benches.checks(), ["seals"]) == ["seals"]


@pytest.mark.exhaustive
def test_flipped_sign_of_the_meter_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    read = vcfbench.drivers.hp34401a.Hp34401A.begun_reading_v
    monkeypatch.setattr(vcfbench.drivers.hp34401a.Hp34401A, "begun_reading_v", lambda meter: -read(meter))
    names = [f"U95 of virtual-coriolis: turntable, {value}" for value in ("scale factor", "bias")]
    assert failed(benches.checks(2), names) == names


@pytest.mark.parametrize("size", [1.35, 1.0 / 1.35])
def test_uncertainty_a_third_too_large_or_too_small_is_named(size: float) -> None:
    calibrations = benches.Calibrations(benches.RUNS)
    places = [(place + 0.5) / benches.RUNS for place in range(benches.RUNS)]
    errors = [NormalDist().inv_cdf(each) for each in places]

    def said(u: float) -> bool:
        calibrations.kept = [{"k_vc.z": e / u, "k_vc.covered": abs(e) < 1.96 * u} for e in errors]
        return calibrations.covered("k_vc").passed

    assert said(1.0)
    assert not said(size)


def test_uncertainty_of_half_the_size_is_named() -> None:
    """Errors as they are, over half the u."""
    calibrations = benches.Calibrations(100)
    errors = [(place + 0.5) / 50.0 - 1.0 for place in range(100)]  # of a rectangle, whose s is 1
    row = "k_vc"
    calibrations.kept = [{f"{row}.z": e * 3.0**0.5, f"{row}.covered": abs(e) < 0.95} for e in errors]
    assert calibrations.covered(row).passed
    calibrations.kept = [{f"{row}.z": 2.0 * e * 3.0**0.5, f"{row}.covered": abs(e) < 0.475} for e in errors]
    found = calibrations.covered(row)
    assert (found.passed, found.came) == (False, "48 of 100 within U95; errors over u: mean +0.00, s 2.01")


def validation(*checks: Checked) -> Validation:
    began = datetime(2026, 11, 27, 9, 0, tzinfo=UTC)
    return Validation(checks, {"numpy": "2.0"}, "bench-pc", "A. Person", began, 12.0)


PASSED = Checked("Arithmetic", "sum", "One and one?", "by hand", "2", "2", "PASS", 0.1)
FAILED = Checked("Arithmetic", "product", "Two by two?", "by hand", "4", "5", "FAIL", 0.1)


def test_document_says_what_was_asked_what_came_who_and_when(tmp_path: Path) -> None:
    found = validation(PASSED, FAILED)
    assert (found.passed, found.failed) == (False, ("product",))
    text = text_of(validation_report(found))
    assert "FAILED: product." in text
    for word in ("A. Person", "2026-11-27", "bench-pc", "Two by two?", "by hand", "numpy"):
        assert word in text
    assert validation(PASSED).passed
    (written,) = write_validation(found, tmp_path / "v.html")
    assert "FAILED: product." in written.read_text()


def test_validate_prints_each_check_and_exit_code_is_verdict(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(benches, "checks", lambda _: ())
    cli = CliRunner()
    good = cli.invoke(app, ["validate", "-o", str(tmp_path / "v.md")])
    assert good.exit_code == 0
    assert "PASS         straight line: 1.00211681802" in good.stdout
    assert re.search(r"^PASS +packages: \d+ as required$", good.stdout, re.MULTILINE)  # what came
    assert (tmp_path / "v.md").exists()
    broken_fit(monkeypatch)
    bad = cli.invoke(app, ["validate", "--json", "--by", "A. Person"])
    said = json.loads(bad.stdout)
    assert (bad.exit_code, said["passed"], said["by"]) == (1, False, "A. Person")
    assert [each["name"] for each in said["checks"] if each["verdict"] == "FAIL"] == ["straight line"]


def test_own_bench_is_checked_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benches, "checks", lambda _: ())
    own = [each for each in validate("paper").checks if each.area == "Own bench"]
    assert [(each.verdict, each.name) for each in own] == [("PASS", "paper")]
    assert "multimeter: well" in own[0].came
