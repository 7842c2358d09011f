"""A PostgreSQL server for tests: the one that VCFBENCH_TEST_POSTGRESQL names, or one of our own, gone afterwards."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

VARIABLE = "VCFBENCH_TEST_POSTGRESQL"


@contextmanager
def database() -> Iterator[str]:
    """Make a database of its own, and give its URL; skip where there is no server."""
    psycopg = pytest.importorskip("psycopg")
    with server() as url:
        name = f"vcfbench_{uuid4().hex[:12]}"
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        begin, _, query = url.partition("?")
        try:
            yield f"{begin.rpartition('/')[0]}/{name}{'?' if query else ''}{query}"
        finally:
            with psycopg.connect(url, autocommit=True) as connection:
                connection.execute(f"DROP DATABASE {name} WITH (FORCE)")


@contextmanager
def server() -> Iterator[str]:
    """Give the URL of a server's database ``postgres``."""
    if VARIABLE in os.environ:
        yield os.environ[VARIABLE]
        return
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if not found or os.name == "nt":
        pytest.skip(f"no PostgreSQL here; {VARIABLE}=postgresql://user@host/postgres names one")
    programs, owner = found[-1].parent, _owner()
    folder = Path(tempfile.mkdtemp(prefix="vcfpg-", dir="/tmp"))
    shutil.chown(folder, **({} if not owner else {"user": owner["user"]}))
    data = folder / "data"
    try:
        _done([programs / "initdb", "-D", data, "-U", "vcfbench", "-A", "trust", "--no-sync", "--no-locale"], owner)
        options = f"-k {folder} -c listen_addresses= -c fsync=off"
        start = [programs / "pg_ctl", "-D", data, "-w", "-o", options, "-l", folder / "log", "start"]
        _done(start, owner)
        try:
            yield f"postgresql://vcfbench@/postgres?host={folder}"
        finally:
            _done([programs / "pg_ctl", "-D", data, "-m", "immediate", "stop"], owner)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _owner() -> dict[str, Any]:
    """Return whose the server shall be: PostgreSQL refuses to be run by root."""
    if os.geteuid() != 0:
        return {}
    return {"user": "postgres", "group": "postgres", "extra_groups": []}


def _done(command: list[Any], owner: dict[str, Any]) -> None:
    environment = {"PATH": os.environ["PATH"], "LC_ALL": "C"}
    subprocess.run(  # noqa: S603 - our own
        list(map(str, command)), check=True, stdout=subprocess.DEVNULL, env=environment, cwd="/", timeout=60, **owner
    )
