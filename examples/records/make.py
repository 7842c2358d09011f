"""Twenty-one records of one simulated gyroscope, one of each procedure, as an example data set.

python examples/records/make.py OUT makes them in the folder OUT, with its README: `runs/` and `devices/`. They are the
same for the same version, but for the day, and take some minutes.
"""

# ruff: noqa: INP001  # a script by itself
import shutil
import sys
from contextlib import chdir
from pathlib import Path

import vcfbench
from vcfbench.instructions.titles import BUILT_IN

BENCH, DEVICE, SEED = "lab", "G-001", 1
LATER = ("self-calibration", "online")
"""They need the certificate of `kvc`."""


def procedures() -> tuple[str, ...]:
    """Return all procedures, those that need a certificate last."""
    return (*(name for name in BUILT_IN if name not in LATER), *LATER)


def make(out: Path, names: tuple[str, ...] = procedures()) -> list[vcfbench.Run]:
    """Make the records of some procedures in a folder, and its README."""
    done, metadata = [], {"dut": DEVICE, "operator": "example", "tags": {"set": "examples"}}
    out = out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    for name in names:
        with chdir(out):  # where devices are kept
            done.append(vcfbench.run(name, BENCH, seed=SEED, runs=out / "runs", metadata=metadata))
        print(f"{name}: {done[-1].status}", flush=True)  # noqa: T201
    shutil.copy(Path(__file__).with_name("README.md"), out / "README.md")
    return done


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("python make.py OUT: expected one folder, which need not be there")
    make(Path(sys.argv[1]))
