"""Records verified: those that are what was written, those that are not, and what cannot be known."""

from __future__ import annotations

import json
import shutil
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from tests.seals import sealed
from vcfbench.archive.amending import amend_run
from vcfbench.archive.verified import Verification, verify_run
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError
from vcfbench.records.journal import append_line
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of a complete run."""
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path_factory.mktemp("runs"))
    assert run.directory is not None
    return run.directory


@pytest.fixture
def record(whole: Path, tmp_path: Path) -> Path:
    return shutil.copytree(whole, tmp_path / "runs" / whole.name)


def cut(record: Path, kept: int) -> None:
    """Leave so many lines of a record, as a kill does."""
    lines = (record / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (record / "journal.jsonl").write_bytes(b"".join(lines[:kept]))
    for name in ("points.csv", "result.json"):
        (record / name).unlink()


def no_text(path: Path, at: bytes) -> None:
    """Flip the highest bit of a byte in what is there: it is no UTF-8 then."""
    data = bytearray(path.read_bytes())
    data[data.index(at) + 1] ^= 128
    path.write_bytes(data)


def changed(record: Path, change: Callable[[dict[str, Any]], object], *, with_point: bool = True) -> None:
    """Change the first step with a point, or the header, and make all seals again."""
    journal = record / "journal.jsonl"
    lines = [json.loads(line) for line in journal.read_bytes().splitlines()]
    change(next(line for line in lines if "point" in line) if with_point else lines[0])
    journal.write_bytes(sealed(b"".join(json.dumps(line).encode() + b"\n" for line in lines)))


def test_written_killed_resumed_and_amended_records_pass(record: Path) -> None:
    assert verify_run(record).verdict == "PASS"
    amend_run(record, {"operator": "B. Person"}, reason="another shift")
    found = verify_run(record)
    assert (found.verdict, found.revision, found.points) == ("PASS", 2, 3)
    cut(record, 25)
    assert "whether lines were cut off its end cannot be known" in " ".join(verify_run(record).notes)
    resumed = vcfbench.resume(record).directory
    assert resumed is not None
    assert [verify_run(each).verdict for each in (record, resumed)] == ["PASS", "PASS"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda record: (record / "points.csv").unlink(), "points.csv: expected a file of the record, there is no"),
        (lambda record: (record / "points.csv").write_text("step\n"), "points.csv is not what was written"),
        (lambda record: (record / "result.json").write_text("{}"), "result.json is not what was written"),
        (lambda record: changed(record, lambda line: line["point"].update(std_v=9.0)), "its point is not that of its"),
        (lambda record: changed(record, lambda line: line.update(end_s=1e6)), "bench time goes back"),
        (lambda record: changed(record, lambda line: line["step"].update(samples=4)), "its key is"),
        (lambda record: changed(record, lambda line: line.pop("versions"), with_point=False), "line 1: no header of"),
        (lambda record: (record / "journal.jsonl").write_text("{"), "line 1: there is no whole header"),
        (lambda record: no_text(record / "journal.jsonl", b"Start-up"), "line 2 is no JSON object"),
    ],
)
def test_what_is_wrong_is_named(spoil: Callable[[Path], object], words: str, record: Path) -> None:
    """Also where all seals were made again, as far as the numbers contradict each other."""
    spoil(record)
    found = verify_run(record)
    assert (found.verdict, words in (found.wrong or "")) == ("FAIL", True), found.wrong


def test_a_key_that_was_changed_is_named_by_its_line(record: Path) -> None:
    """One bit of it: the point can no longer be read, which is not the fault of the first line."""
    journal = record / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    place = next(at for at, line in enumerate(lines) if b'"point":{' in line)
    lines[place] = lines[place].replace(b'"rate_deg_s":', b'"rate_deg_r":', 1)
    journal.write_bytes(b"".join(lines))
    found = verify_run(record)
    assert (found.verdict, found.line) == ("FAIL", place + 1)
    assert "its seal differs" in (found.wrong or "")


def test_cut_footer_is_noticed_by_derived_files(record: Path) -> None:
    data = (record / "journal.jsonl").read_bytes()
    (record / "journal.jsonl").write_bytes(data[: data.rindex(b"\n", 0, -1) + 1])
    assert verify_run(record).wrong == "points.csv is made when the last line is, which is missing"


def test_cut_of_earlier_record_is_seen_in_resumed_one(record: Path) -> None:
    cut(record, 25)
    resumed = vcfbench.resume(record).directory
    assert resumed is not None
    lines = (record / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (record / "journal.jsonl").write_bytes(b"".join(lines[:-1]))
    assert "has a different seal" in (verify_run(resumed).wrong or "")


def test_a_record_without_seals_does_not_pass(record: Path) -> None:
    journal = record / "journal.jsonl"
    lines = [json.loads(line) for line in journal.read_bytes().splitlines()]
    bare = [{name: value for name, value in line.items() if name != "seal"} for line in lines]
    journal.write_bytes(b"".join(json.dumps(line).encode() + b"\n" for line in bare))
    assert verify_run(record).wrong == "line 1 was changed: its seal differs"


def test_verify_names_each_record_and_ends_with_1_on_failure(record: Path) -> None:
    other = shutil.copytree(record, record.with_name("other"))
    (other / "points.csv").write_text("")
    done = CliRunner().invoke(app, ["runs", "verify", str(record), str(other), "--json"])
    assert done.exit_code == 1
    assert [each["verdict"] for each in json.loads(done.stdout)["runs"]] == ["PASS", "FAIL"]
    assert CliRunner().invoke(app, ["runs", "verify", str(record)]).exit_code == 0


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the public key of a station whose records are signed."""
    pytest.importorskip("cryptography")
    from vcfbench.records.signing import new_key, public_key_of  # noqa: PLC0415

    public = new_key(tmp_path / "key")
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0
    with pytest.raises(ConfigError, match="no key can be written there: File exists"):
        new_key(tmp_path / "key")
    monkeypatch.setenv("VCFBENCH_SIGNING_KEY", str(tmp_path / "key"))
    return public_key_of(public)


def test_a_signature_sees_what_seals_alone_cannot(key: str, tmp_path: Path) -> None:
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path / "runs")
    assert run.directory is not None
    record, journal = run.directory, run.directory / "journal.jsonl"

    def verified() -> Verification:
        return verify_run(record, keys=[key])

    assert (verified().verdict, verified().signed_by) == ("PASS", (key,))
    assert "by another key" in (verify_run(record, keys=["00" * 32]).wrong or "")
    whole = journal.read_bytes()
    changed(record, lambda header: header.update(note="forged"), with_point=False)
    assert "is no signature of the line before" in (verified().wrong or "")
    lines = whole.splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:-1]))
    assert verified().wrong == "it ends without a signature"
    assert "lines may be missing from its end" in (verify_run(record).wrong or "")
    with pytest.raises(ConfigError, match="the amendment was not written: it was to be signed"):
        amend_run(record, {"dut": "G-018"}, reason="label")  # what it is held to be would be signed
    journal.write_bytes(whole)
    append_line(journal, {"type": "amendment", "revision": 2, "by": "Eve", "reason": "none", "changes": []})
    with pytest.raises(ConfigError, match="the amendment was not written: what was amended"):
        amend_run(record, {"dut": "G-018"}, reason="label")
    journal.write_bytes(whole)
    amend_run(record, {"dut": "G-018"}, reason="label")
    assert verified().verdict == "PASS"
    append_line(journal, {**json.loads(journal.read_bytes().splitlines()[-2]), "revision": 3})
    assert verified().verdict == "FAIL"


def test_signed_record_is_not_amended_without_a_key(key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The record would have failed for good: no later signature may vouch for an amendment that has none."""
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path / "runs")
    assert run.directory is not None
    monkeypatch.delenv("VCFBENCH_SIGNING_KEY")
    with pytest.raises(ConfigError, match="the amendment was not written: the record is signed") as refused:
        amend_run(run.directory, {"dut": "G-018"}, reason="label")
    assert "VCFBENCH_SIGNING_KEY" in (refused.value.hint or "")
    assert verify_run(run.directory, keys=[key]).verdict == "PASS"


def test_a_killed_record_that_the_watchdog_signed_shows_a_cut(key: str, record: Path, tmp_path: Path) -> None:
    from vcfbench.records.signing import SigningKey  # noqa: PLC0415

    cut(record, 25)
    changed(record, lambda header: header.update(signed_by=key), with_point=False)
    assert "lines may be missing from its end" in (verify_run(record).wrong or "")
    append_line(
        record / "journal.jsonl", {"type": "watchdog", "why": "died", "safe": True}, SigningKey(tmp_path / "key")
    )
    assert verify_run(record, keys=[key]).verdict == "PASS"
    lines = (record / "journal.jsonl").read_bytes().splitlines(keepends=True)
    for cut_off in (1, 2, 5):
        (record / "journal.jsonl").write_bytes(b"".join(lines[:-cut_off]))
        assert "lines may be missing from its end" in (verify_run(record).wrong or "")


def test_unusable_key_is_refused_before_records_are_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cryptography")
    (tmp_path / "key").write_text("no key")
    monkeypatch.setenv("VCFBENCH_SIGNING_KEY", str(tmp_path / "key"))
    with pytest.raises(ConfigError, match="expected a private key in PEM"):
        vcfbench.run("turntable", "ideal", settings=QUICK, runs=tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("command", ["list", "show", "report"])
def test_a_result_that_is_no_text_is_one_sentence(command: str, record: Path) -> None:
    """`runs list` reads the results alone, of whatever form."""
    no_text(record / "result.json", b'"unit"')
    run = [] if command == "list" else [record.name]
    done = CliRunner().invoke(app, ["runs", command, *run, "--runs", str(record.parent)])
    assert not isinstance(done.exception, UnicodeDecodeError)
    assert done.output


def test_earlier_verdict_rules_and_missing_newer_keys_are_no_fault(tmp_path: Path) -> None:
    bench = embedded_text("ideal") + '\n[acceptance]\nguard_band = "U95"\nbias_v = [-1.0, 1.0]\n'
    (tmp_path / "bench.toml").write_text(bench, encoding="utf-8")
    run = vcfbench.run("turntable", tmp_path / "bench.toml", settings=QUICK, runs=tmp_path / "runs")
    record = run.directory
    assert record is not None
    answer = json.loads((record / "result.json").read_text(encoding="utf-8"))
    del answer["values"], answer["results"]["uncertainty"]["bounds"]
    answer["acceptance"]["verdict"] = answer["acceptance"]["limits"][0]["verdict"] = "marginal"
    del answer["acceptance"]["limits"][0]["rule"]
    text = json.dumps(answer).encode()
    (record / "result.json").write_bytes(text)
    lines = [json.loads(line) for line in (record / "journal.jsonl").read_bytes().splitlines()]
    lines[-1]["files"]["result.json"] = sha256(text).hexdigest()
    (record / "journal.jsonl").write_bytes(sealed(b"".join(json.dumps(line).encode() + b"\n" for line in lines)))
    found = verify_run(record)
    assert (found.verdict, found.wrong) == ("PASS", None)
    assert "the verdict, marginal, is by the rules of that version; by the present rules it is pass" in found.notes


@pytest.mark.parametrize(
    ("of", "by", "evaluation", "words"),
    few(
        [
            ("value", 0.008, None, "computed again, equal only as far as printed"),  # in units of u
            ("u", 0.004, None, "computed again, equal only as far as printed"),
            ("value", 0.3, None, ""),
            ("u", 0.3, None, ""),
            ("value", 0.3, "0", "computed again with other versions (evaluation 0, here"),
            ("u", 0.3, "none", "computed again with other versions (evaluation of before, here"),
        ],
        every=3,
    ),
)
def test_record_is_verified_by_printed_digits_or_named_evaluation(
    of: str, by: float, evaluation: str | None, words: str, tmp_path: Path
) -> None:
    run = vcfbench.run("turntable", "paper", seed=1, settings=QUICK, runs=tmp_path)
    record = run.directory
    assert record is not None
    answer = json.loads((record / "result.json").read_text(encoding="utf-8"))
    moved = by * run.results.bias.u
    answer["results"]["bias"][of] += moved
    for stated in (*answer["values"], *answer["results"]["uncertainty"]["values"]):
        if stated["name"] == "bias":
            stated[of] += moved
    text = json.dumps(answer).encode()
    (record / "result.json").write_bytes(text)
    lines = [json.loads(line) for line in (record / "journal.jsonl").read_bytes().splitlines()]
    lines[0]["versions"] |= {} if evaluation is None else {"evaluation": evaluation}
    if evaluation == "none":
        del lines[0]["versions"]["evaluation"]
    lines[-1]["files"]["result.json"] = sha256(text).hexdigest()
    (record / "journal.jsonl").write_bytes(sealed(b"".join(json.dumps(line).encode() + b"\n" for line in lines)))
    found = verify_run(record)
    assert found.verdict == ("PASS" if words else "FAIL"), (found.wrong, found.notes)
    assert any(words in note for note in found.notes) if words else "bias" in (found.wrong or "")
