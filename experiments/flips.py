"""Whether `vcfbench runs verify` sees what was changed in records: `python experiments/flips.py [FLIPS] [SEED]`.

Single bits are flipped at random places of the journal, of points.csv and of result.json of complete, killed, resumed,
amended and signed records, and of their footers; lines are forged, doubled, taken away and put elsewhere, with the sums
of the line, or of all that follow, made again. Each is verified, the signed ones with the key. What went unseen is
listed: a line cut from the end of a killed record that is not signed, and a whole chain made again without a signature.
The exit code is 1 where anything else went unseen.
"""

from __future__ import annotations

import json
import random
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import vcfbench
from vcfbench.archive.amending import amend_run
from vcfbench.archive.verified import verify_run
from vcfbench.records.journal import append_line
from vcfbench.records.seal import Sealer
from vcfbench.records.signing import SigningKey, new_key

if TYPE_CHECKING:
    from collections.abc import Iterator

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
Lines = list[bytes]


def sealed(lines: Lines, first: int, last: int) -> Lines:
    """Return lines of which those from `first` to `last` have seals that fit what stands before them."""
    made = lines[:first]
    for number, line in enumerate(lines[first:], first):
        values = {name: value for name, value in json.loads(line).items() if name != "seal"}
        text = json.dumps(values, separators=(",", ":")).encode()
        made.append(Sealer(b"".join(made)).sealed(text) if number <= last else line)
    return made


def records(folder: Path) -> dict[str, tuple[Path, list[str]]]:
    """Return a record of each kind, with the keys that it is verified with."""
    run = vcfbench.run("turntable", "ideal", settings=QUICK, runs=folder / "runs", metadata={"dut": "G-017"})
    assert run.directory is not None  # noqa: S101
    made: dict[str, tuple[Path, list[str]]] = {"complete": (run.directory, [])}
    killed = shutil.copytree(run.directory, folder / "runs" / f"{run.name}-killed")
    lines = (run.directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (killed / "journal.jsonl").write_bytes(b"".join(lines[: 2 * len(lines) // 3]))
    for name in ("points.csv", "result.json"):
        (killed / name).unlink()
    made["killed"] = killed, []
    resumed = vcfbench.resume(killed).directory
    assert resumed is not None  # noqa: S101
    made["resumed"] = resumed, []
    amended = shutil.copytree(run.directory, folder / "runs" / f"{run.name}-amended")
    amend_run(amended, {"dut": "G-018"}, reason="label")
    made["amended"] = amended, []
    new_key(folder / "key")
    key = SigningKey(folder / "key")
    signed = shutil.copytree(killed, folder / "runs" / f"{run.name}-signed")
    head = json.dumps({**json.loads(lines[0]), "signed_by": key.public}).encode()
    (signed / "journal.jsonl").write_bytes(b"".join(sealed([head, *lines[1 : len(lines) // 2]], 0, len(lines))))
    append_line(signed / "journal.jsonl", {"type": "watchdog", "why": "the program died", "safe": True}, key)
    made["killed, signed by the watchdog"] = signed, [key.public]
    return made


def flips(data: bytes, count: int, chance: random.Random) -> Iterator[bytes]:
    """Yield copies in each of which one bit is another."""
    for _ in range(count):
        place, bit = chance.randrange(len(data)), chance.randrange(8)
        yield data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


def forged(lines: Lines, chance: random.Random) -> Iterator[Lines]:
    """Yield a journal with one line changed, doubled, moved or taken away; sums made again of none, or of that line."""
    place = chance.randrange(1, len(lines) - 1)
    values = json.loads(lines[place])
    values["t_s"] = values.get("t_s", 0.0) + 1e-3
    line = json.dumps(values, separators=(",", ":")).encode()
    changed = [*lines[:place], line + b"\n", *lines[place + 1 :]]
    yield changed
    yield sealed(changed, place, place)
    yield [*lines[:place], lines[place], *lines[place:]]
    yield [*lines[:place], *lines[place + 1 :]]
    yield [*lines[:place], lines[place + 1], lines[place], *lines[place + 2 :]]


class Trial:
    """One record that is changed again and again, each time verified and put back."""

    def __init__(self, kind: str, directory: Path, keys: list[str], tried: Counter[str], unseen: Counter[str]) -> None:
        self._kind, self._directory, self._keys = kind, directory, keys
        self._tried, self._unseen = tried, unseen
        self.journal = directory / "journal.jsonl"
        assert verify_run(directory, keys=keys).verdict == "PASS", (kind, verify_run(directory, keys=keys))  # noqa: S101

    def change(self, what: str, path: Path, changed: bytes) -> None:
        """Look whether a file with other bytes is seen."""
        kept = path.read_bytes()
        path.write_bytes(changed)
        verdict = verify_run(self._directory, keys=self._keys).verdict
        path.write_bytes(kept)
        self._tried[f"{self._kind}: {what}"] += 1
        self._unseen[f"{self._kind}: {what}"] += verdict == "PASS"

    def flip(self, count: int, chance: random.Random) -> None:
        """Flip bits of the journal, of its last line, and of the files beside it."""
        data = self.journal.read_bytes()
        for path in sorted(self._directory.iterdir()):
            for changed in flips(path.read_bytes(), count if path == self.journal else count // 3, chance):
                self.change(f"flip in {path.name}", path, changed)
        last = data.rindex(b"\n", 0, -1) + 1
        for changed in flips(data[last:], count // 3, chance):
            self.change("flip in the last line", self.journal, data[:last] + changed)

    def forge(self, count: int, chance: random.Random) -> None:
        """Forge, double, move and take away lines; make all seals again; cut lines from the end."""
        lines = self.journal.read_bytes().splitlines(keepends=True)
        for _ in range(count):
            for changed in forged(lines, chance):
                self.change("forged line", self.journal, b"".join(changed))
        every = sealed(next(forged(lines, chance)), 0, len(lines))
        self.change("a line forged and all seals made again", self.journal, b"".join(every))
        for cut in (1, 2, 3):
            self.change(f"{cut} lines cut from the end", self.journal, b"".join(lines[:-cut]))


CANNOT_BE_SEEN = "all seals made again", "cut from the end"
"""Without a signature."""


def main() -> int:
    """Print of each kind how many changes were seen."""
    count, seed = (int(each) for each in (sys.argv[1:] + ["2000", "1"][len(sys.argv) - 1 :])[:2])
    chance, tried, unseen = random.Random(seed), Counter[str](), Counter[str]()  # noqa: S311
    with tempfile.TemporaryDirectory() as folder:
        kinds = records(Path(folder))
        for kind, (directory, keys) in kinds.items():
            trial = Trial(kind, directory, keys, tried, unseen)
            trial.flip(count // (2 * len(kinds)), chance)
            trial.forge(max(2, count // 200), chance)
    for where, times in tried.items():
        print(f"{where:75} {times - unseen[where]:5} of {times:5} seen")
    print(f"all: {sum(tried.values()) - sum(unseen.values())} of {sum(tried.values())} seen")
    missed = [where for where in unseen.elements() if not where.endswith(CANNOT_BE_SEEN) or "signed" in where]
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
