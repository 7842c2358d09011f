from __future__ import annotations

import errno
import json
import os
import re
import signal
import socket
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.ports import free_port

from vcfbench.bench.ground import station
from vcfbench.clock import WallClock, sleep
from vcfbench.errors import BenchError
from vcfbench.files import try_lock
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.safety.lock import InUse, LockUnusable, instrument_locks, lock_directory, lock_path, owners_of
from vcfbench.safety.processes import mark_of
from vcfbench.station.file import template

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.clock import Clock

METER = "GPIB0::22::INSTR"
SUPPLY = "GPIB0::5::INSTR"
OPEN_FILES = Path("/dev/fd")
HOLD = """
import sys
from vcfbench.safety.lock import instrument_locks
with instrument_locks("lab-1", {"multimeter": "GPIB::22", "power": "GPIB0::5::INSTR"}):
    print("held", flush=True)
    sys.stdin.read()
"""
posix = pytest.mark.skipif(sys.platform == "win32", reason="links and modes are different there")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    return tmp_path / "locks"


@pytest.fixture
def holder() -> Iterator[subprocess.Popen[str]]:
    """Another process that has meter and supply."""
    command = [sys.executable, "-c", HOLD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_second_process_gets_owner_under_any_name(holder: subprocess.Popen[str]) -> None:
    words = rf"multimeter at gpib::22: in use by process {holder.pid} of \S+ on \S+ for station lab-1 since 20\d\d-"
    with pytest.raises(InUse, match=words) as caught, instrument_locks("other", {"multimeter": "gpib::22"}):
        pytest.fail("two have it")
    assert caught.value.exit_code == 3
    assert caught.value.owner is not None
    assert caught.value.owner.pid == holder.pid
    assert str(lock_path(METER)) in str(caught.value)


def test_all_are_taken_or_none(holder: subprocess.Popen[str]) -> None:
    assert holder.poll() is None
    with pytest.raises(InUse), instrument_locks("other", {"rate_source": "GPIB0::10::INSTR", "power": SUPPLY}):
        pytest.fail("two have it")
    with instrument_locks("other", {"rate_source": "GPIB0::10::INSTR"}):
        owner = json.loads(lock_path("GPIB0::10::INSTR").read_text("utf-8"))
    assert (owner["pid"], owner["station"], owner["resource"]) == (os.getpid(), "other", "GPIB0::10::INSTR")


def test_unusable_lock_does_not_hide_other_owner(folder: Path) -> None:
    (lock_path("GPIB0::10::INSTR")).mkdir(parents=True)
    both = {"rate_source": "GPIB0::10::INSTR", "power": SUPPLY}
    with pytest.raises(LockUnusable, match="Is a directory"), instrument_locks("other", both):
        pytest.fail("it has no lock")
    with instrument_locks("one", {"power": SUPPLY}), pytest.raises(InUse), instrument_locks("other", both):
        pytest.fail("two have it")
    assert folder.is_dir()


def test_first_of_several_unusable_locks_is_named() -> None:
    first, last = sorted((METER, SUPPLY))
    for each in (first, last):
        lock_path(each).mkdir(parents=True)
    with pytest.raises(LockUnusable, match=re.escape(str(lock_path(first)))):
        instrument_locks("lab-1", {"one": last, "other": first}).__enter__()


def test_a_killed_process_leaves_its_instruments_free(holder: subprocess.Popen[str]) -> None:
    holder.kill()
    holder.wait()
    assert lock_path(METER).exists()
    with instrument_locks("lab-1", {"multimeter": METER}) as left_by:
        assert f'"pid": {os.getpid()}' in lock_path(METER).read_text("utf-8")
        assert left_by["multimeter"].startswith(f"process {holder.pid} of ")
    with instrument_locks("lab-1", {"multimeter": METER}) as left_by:
        assert left_by == {}


def test_live_owners_of_resources_are_listed_by_number(holder: subprocess.Popen[str]) -> None:
    owners = owners_of(["GPIB::22", SUPPLY, "GPIB0::10::INSTR"])
    assert {pid: owner.station for pid, owner in owners.items()} == {holder.pid: "lab-1"}
    holder.kill()
    holder.wait()
    assert owners_of([METER, SUPPLY]) == {}


@pytest.mark.skipif(not Path("/proc/locks").exists(), reason="the system does not tell who holds a lock")
def test_nobody_is_ended_on_the_word_of_a_text(holder: subprocess.Popen[str], folder: Path) -> None:
    """Everybody may lay a file there that names another's process."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as victim:
        said = json.loads(lock_path(METER).read_text("utf-8"))
        named = json.dumps({**said, "pid": victim.pid, "mark": mark_of(victim.pid)})
        lock_path("GPIB0::10::INSTR").write_text(named, encoding="utf-8")
        assert owners_of(["GPIB0::10::INSTR"]) == {}  # nobody holds it
        lock_path(METER).write_text(named, encoding="utf-8")
        assert {*owners_of([METER])} == {holder.pid}  # who holds it, whatever it says
        folder.chmod(0o777)
        with pytest.raises(BenchError, match=f"process {holder.pid} holds .* nothing was ended"):
            owners_of([METER])
        folder.chmod(0o1777)
        assert {*owners_of([METER])} == {holder.pid}
        if os.geteuid() == 0:
            os.chown(lock_path(METER), 12_345, 12_345)
            with pytest.raises(BenchError, match="the file is user 12345's and the process user 0's"):
                owners_of([METER])
        victim.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="no lock of Windows is told")
@pytest.mark.parametrize("told", [None, "", "1: POSIX  ADVISORY  WRITE 1 00:1a:23 0 EOF\n"])
def test_nobody_is_ended_where_the_system_does_not_tell_who_holds_a_lock(
    holder: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch, told: str | None
) -> None:
    """As without /proc, or where the holder is in another container, or on a file system of another device number."""
    read_text = Path.read_text

    def read(path: Path, *args: Any, **named: Any) -> str:
        if path != Path("/proc/locks"):
            return read_text(path, *args, **named)
        if told is None:
            raise FileNotFoundError(errno.ENOENT, "No such file or directory", str(path))
        return told

    monkeypatch.setattr(Path, "read_text", read)
    with pytest.raises(BenchError, match="does not report which process holds"):
        owners_of([METER])
    holder.kill()
    holder.wait()
    if told is not None:
        assert owners_of([METER]) == {}


def test_end_of_local_owner_is_awaited_and_remote_one_unknown(
    holder: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (owner,) = owners_of([METER]).values()
    clock = WallClock()
    assert not owner.ended_within(60.0)  # it lives: it may have become another program
    assert clock.now() < 60.0
    monkeypatch.setattr("vcfbench.safety.lock.dying", lambda _pid: True)
    clock = WallClock()
    assert not owner.ended_within(0.1)
    assert clock.now() >= 0.1
    assert not structs.replace(owner, host="elsewhere").ended_within(60.0)
    assert clock.now() < 60.0  # of one elsewhere nothing comes to be known
    holder.kill()
    holder.wait()
    assert owner.ended_within(600.0)
    assert not structs.replace(owner, mark=None).alive()  # signed by a version that knew no marks
    assert not structs.replace(owner, host="elsewhere").ended_within(0.0)


@pytest.mark.skipif(not OPEN_FILES.is_dir(), reason="open files are counted there")
def test_released_or_refused_lock_leaves_no_open_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(_file: int) -> bool:
        raise OSError(errno.ENOLCK, "No locks available")

    folder.mkdir()
    os.mkfifo(lock_path(METER))
    before = len(list(OPEN_FILES.iterdir()))
    for _ in range(5):
        with instrument_locks("lab-1", {"power": SUPPLY}), pytest.raises(InUse):
            instrument_locks("lab-1", {"power": SUPPLY}).__enter__()
        with pytest.raises(LockUnusable, match="is not a regular file"):
            instrument_locks("lab-1", {"multimeter": METER}).__enter__()
    monkeypatch.setattr("vcfbench.safety.lock.try_lock", no_locks)
    with pytest.raises(LockUnusable, match=r"lock file .* cannot be locked: No locks available"):
        instrument_locks("lab-1", {"power": SUPPLY}).__enter__()
    assert len(list(OPEN_FILES.iterdir())) == before


@posix
@pytest.mark.parametrize("meanwhile", ["taken away", "another"])
def test_lock_file_removed_while_held_is_made_anew(meanwhile: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its owner has given it back: who locks what is no longer there would have it beside the next one."""
    path, tries = lock_path(METER), list[int]()

    def slow(file: int) -> bool:
        tries.append(file)
        if len(tries) == 1:
            path.unlink()
            if meanwhile == "another":
                path.write_text("")
        return try_lock(file)

    monkeypatch.setattr("vcfbench.safety.lock.try_lock", slow)
    with instrument_locks("lab-1", {"multimeter": METER}):
        assert len(tries) == 2
        with pytest.raises(InUse, match=rf"process {os.getpid()} of "):
            instrument_locks("lab-2", {"multimeter": METER}).__enter__()


@posix
def test_link_laid_during_locking_is_not_followed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def slow(file: int) -> bool:
        lock_path(METER).rename(tmp_path / "elsewhere")
        lock_path(METER).symlink_to(tmp_path / "elsewhere")
        return try_lock(file)

    monkeypatch.setattr("vcfbench.safety.lock.try_lock", slow)
    with pytest.raises(LockUnusable, match="cannot be opened"):
        instrument_locks("lab-1", {"multimeter": METER}).__enter__()


@posix
def test_who_is_still_dying_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lock is free before its wires are."""
    with instrument_locks("lab-1", {"multimeter": METER}):
        signed = json.loads(lock_path(METER).read_text("utf-8"))
    waits: list[float] = []

    def wait(clock: Clock, wait_s: float) -> None:
        waits.append(wait_s)
        sleep(clock, wait_s)

    monkeypatch.setattr("vcfbench.safety.lock.sleep", wait)
    monkeypatch.setattr("vcfbench.safety.lock.dying", lambda _pid: True)
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(0.2)"]) as dying:
        owner = {**signed, "pid": dying.pid, "mark": mark_of(dying.pid)}
        lock_path(METER).write_text(json.dumps(owner), encoding="utf-8")
        with instrument_locks("lab-1", {"multimeter": METER}) as left_by:
            assert mark_of(dying.pid) is None
        assert left_by["multimeter"].startswith(f"process {dying.pid} of ")
    assert {*waits} == {0.02}  # nobody waits for long after it is dead


@posix
def test_what_cannot_be_taken_away_is_left_empty(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file of another user in a directory that all share: nobody has died."""

    def refuse(_path: Path) -> None:
        raise PermissionError

    with monkeypatch.context() as patch, instrument_locks("lab-1", {"multimeter": METER}):
        patch.setattr(Path, "unlink", refuse)
    assert [each.read_bytes() for each in folder.iterdir()] == [b""]
    with instrument_locks("lab-2", {"multimeter": METER}) as left_by:
        assert left_by == {}


@posix
def test_a_file_system_that_cannot_unlock_ends_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_file: int) -> None:
        raise OSError

    with monkeypatch.context() as patch, instrument_locks("lab-1", {"multimeter": METER}):
        patch.setattr("vcfbench.safety.lock.unlock", refuse)
    assert list(folder.iterdir()) == []


@posix
def test_descriptor_kept_by_library_does_not_hold_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[int] = []

    def lock(file: int) -> bool:
        kept.append(os.dup(file))
        os.lseek(file, 1 << 20, os.SEEK_SET)  # as locking does on Windows
        return try_lock(file)

    def refuse(_path: Path) -> None:
        raise PermissionError

    monkeypatch.setattr("vcfbench.safety.lock.try_lock", lock)
    monkeypatch.setattr(Path, "unlink", refuse)  # the second finds the file of the first
    for _ in range(2):
        with instrument_locks("lab-1", {"multimeter": METER}):
            assert json.loads(lock_path(METER).read_text("utf-8"))["station"] == "lab-1"
    for each in kept:
        os.close(each)


@posix
def test_read_only_lock_file_is_locked_unsigned(monkeypatch: pytest.MonkeyPatch) -> None:
    def guarded(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & os.O_RDWR and not flags & os.O_CREAT:
            raise PermissionError
        assert flags & os.O_NOFOLLOW
        assert flags & os.O_CLOEXEC
        return opened(path, flags, mode)

    lock_path(METER).parent.mkdir()
    lock_path(METER).write_text("")
    opened = os.open
    monkeypatch.setattr("os.open", guarded)
    with instrument_locks("lab-1", {"m": METER}), pytest.raises(InUse, match="in use by another process") as caught:
        instrument_locks("lab-2", {"m": METER}).__enter__()
    assert caught.value.owner is None


@posix
@pytest.mark.parametrize("error", [KeyError, OSError, ImportError], ids=["before 3.13", "3.13", "Windows"])
def test_a_user_without_a_name_signs_with_the_number(error: type[Exception], monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody() -> str:
        raise error

    monkeypatch.setattr("getpass.getuser", nobody)
    with instrument_locks("lab-1", {"multimeter": METER}):
        assert json.loads(lock_path(METER).read_text("utf-8"))["user"] == str(os.getuid())


@posix
@pytest.mark.parametrize("gone_first", [False, True])
def test_leftovers_of_dead_servers_are_removed(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, gone_first: bool
) -> None:
    """A socket at which somebody listens is another matter: its next owner is told who died with it."""
    with socket.create_server(("127.0.0.1", 0)) as served, socket.create_server(("127.0.0.1", 0)) as gone:
        served_at, gone_at = (f"socket://localhost:{each.getsockname()[1]}" for each in (served, gone))
        lives_at, nowhere = f"socket://localhost:{free_port()}", "socket://localhost:99999"
        for resource in (served_at, gone_at, lives_at, nowhere, METER):
            with instrument_locks("lab-1", {"multimeter": resource}):
                signed = lock_path(resource).read_text("utf-8")
            if resource != lives_at:
                signed = signed.replace(f'"pid": {os.getpid()}', '"pid": 0')
            lock_path(resource).write_text(signed, encoding="utf-8")
        with socket.create_connection(gone.getsockname()):
            gone.accept()[0].close()  # its end of a connection lingers
        gone.close()
        found = sorted(folder.iterdir(), key=lambda path: (path == lock_path(gone_at)) != gone_first)
        monkeypatch.setattr(Path, "iterdir", lambda _folder: iter(found))
        with instrument_locks("lab-1", {"multimeter": "GPIB0::1::INSTR"}):
            left = sorted(each.name for each in os.scandir(folder))
    stays = (served_at, lives_at, nowhere, METER, "GPIB0::1::INSTR")
    assert left == sorted(lock_path(each).name for each in stays)


@posix
def test_lock_of_a_dead_program_goes_to_the_next(folder: Path) -> None:
    path = lock_path(f"socket://localhost:{free_port()}")
    folder.mkdir()
    with instrument_locks("lab-1", {"multimeter": METER}):
        path.write_text(lock_path(METER).read_text().replace(f'"pid": {os.getpid()}', '"pid": 0'))
    with path.open() as begun:
        assert try_lock(begun.fileno())
        with instrument_locks("lab-1", {"multimeter": METER}):
            assert path.exists()
    with instrument_locks("lab-1", {"multimeter": METER}):
        assert not path.exists()


def test_what_nobody_has_signed_is_left_where_it_lies(folder: Path) -> None:
    """Another user's lock of a socket, given back and not taken away."""
    folder.mkdir()
    lock_path(f"socket://localhost:{free_port()}").write_text("")
    before = list(folder.iterdir())
    with instrument_locks("lab-1", {"multimeter": METER}):
        pass
    assert list(folder.iterdir()) == before


def test_a_lock_is_given_back_and_can_be_taken_again(folder: Path) -> None:
    for _ in range(2):
        with (
            instrument_locks("lab-1", {"power": SUPPLY}),
            pytest.raises(InUse),
            instrument_locks("lab-2", {"power": SUPPLY}),
        ):
            pytest.fail("two have it")
    assert sys.platform == "win32" or list(folder.iterdir()) == []


def test_a_lock_file_full_of_nonsense_locks_nobody_out(folder: Path) -> None:
    folder.mkdir()
    lock_path(METER).write_bytes(b"\xff\x00{")
    with instrument_locks("lab-1", {"multimeter": METER}):
        pass


def test_two_roles_at_one_resource_share_one_lock() -> None:
    behind = {"multimeter": METER, "power": "GPIB::22"}
    with instrument_locks("lab-1", behind) as left:
        assert left == {}
        signed = lock_path(METER).read_text("utf-8").replace(f'"pid": {os.getpid()}', '"pid": 0')
    lock_path(METER).write_text(signed, "utf-8")
    with instrument_locks("lab-1", behind) as left:
        assert {*left} == {*behind}


@posix
def test_every_user_can_lock_what_one_has_made(folder: Path) -> None:
    before = os.umask(0o077)
    try:
        with instrument_locks("lab-1", {"multimeter": METER}):
            assert stat.S_IMODE(lock_path(METER).stat().st_mode) == 0o666
    finally:
        os.umask(before)
    lock_path(METER).write_text("")
    lock_path(METER).chmod(0o444)
    with instrument_locks("lab-1", {"multimeter": METER}), pytest.raises(InUse), instrument_locks("2", {"m": METER}):
        pytest.fail("two have it")
    assert folder.exists()


@posix
@pytest.mark.parametrize("kind", ["symbolic", "hard", "fifo"])
def test_what_somebody_has_laid_there_is_not_touched(folder: Path, kind: str) -> None:
    folder.mkdir()
    (victim := folder.parent / "victim").write_text("of value")
    if kind == "symbolic":
        lock_path(METER).symlink_to(victim)
    elif kind == "hard":
        lock_path(METER).hardlink_to(victim)
    else:
        os.mkfifo(lock_path(METER))
    with pytest.raises(BenchError, match=r"lock file .* (cannot be opened|is not a regular file)"):
        instrument_locks("lab-1", {"multimeter": METER}).__enter__()
    assert victim.read_text() == "of value"


def test_a_directory_that_cannot_be_made_is_one_sentence(folder: Path) -> None:
    folder.write_text("")
    with pytest.raises(BenchError, match=r"lock file .* cannot be opened"):
        instrument_locks("lab-1", {"multimeter": METER}).__enter__()


@posix
def test_without_being_told_all_users_look_in_one_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("VCFBENCH_LOCKS")
    found = lock_directory()
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert lock_directory() == found
    assert found.stat().st_mode & stat.S_ISVTX
    assert re.fullmatch(r"vcfbench-gpib-0-22-[0-9a-f]{8}\.lock", lock_path(METER).name)
    assert re.fullmatch(r"vcfbench-[a-z0-9-]{80}-[0-9a-f]{8}\.lock", lock_path(f"ASRL/{'x' * 200}::INSTR").name)


def test_windows_has_a_place_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("VCFBENCH_LOCKS")
    monkeypatch.setattr("sys.platform", "win32")
    monkeypatch.setenv("PROGRAMDATA", str(tmp_path))
    assert lock_directory() == tmp_path / "vcfbench" / "locks"


@posix
def test_shared_place_lets_all_make_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("VCFBENCH_LOCKS")
    places = {"none": None, "file": 0o1777, "anybody's": 0o777, "read": 0o1755, "shared": 0o1777, "later": 0o1777}
    for name, mode in places.items():
        if mode is not None:
            (tmp_path / name).touch() if name == "file" else (tmp_path / name).mkdir()
            (tmp_path / name).chmod(mode)
    monkeypatch.setattr("vcfbench.safety.lock._SHARED", tuple(str(tmp_path / name) for name in places))
    assert lock_directory() == tmp_path / "shared"
    monkeypatch.setattr("vcfbench.safety.lock._SHARED", (str(tmp_path / "none"),))
    assert lock_directory() == Path(tempfile.gettempdir())


def test_station_locks_by_instrument_and_console_its_own() -> None:
    real = parse_bench(template(), "template")
    other = structs.replace(real, name="another-name")
    with station(real, None, None), pytest.raises(InUse), station(other, None, None):
        pytest.fail("two have it")
    with station(real, None, None, roles=["power"]), station(other, None, None, roles=["multimeter"]):
        pass
    with station(real, None, None, roles=["power"]), pytest.raises(InUse, match="power at"), station(other, None, None):
        pytest.fail("two have it")


def test_signing_replaces_content_of_lock_file(folder: Path) -> None:
    folder.mkdir()
    lock_path(METER).write_bytes(b"rubbish " * 200)
    with (
        instrument_locks("lab-1", {"multimeter": METER}),
        pytest.raises(InUse, match=rf"process {os.getpid()} of .* for station lab-1"),
        instrument_locks("lab-2", {"multimeter": METER}),
    ):
        pytest.fail("two have it")


def test_the_directory_of_the_locks_is_made_however_deep(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(folder / "a" / "b"))
    with instrument_locks("lab-1", {"multimeter": METER}):
        assert lock_path(METER).parent == folder / "a" / "b"


@posix
def test_two_may_make_a_file_at_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def late(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & os.O_EXCL and not path.exists():
            path.write_text("")  # the other one was faster
        return opened(path, flags, mode)

    folder.mkdir()
    opened = os.open
    monkeypatch.setattr("os.open", late)
    with instrument_locks("lab-1", {"multimeter": METER}):
        start = json.loads(lock_path(METER).read_text("utf-8"))["start"]
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", start)


def test_a_forked_process_keeps_no_lock_and_gives_none_back() -> None:
    lock = instrument_locks("one", {"power": SUPPLY})
    with lock:
        if (child := os.fork()) == 0:
            try:
                lock.__exit__(None, None, None)
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        assert lock_path(SUPPLY).exists()
        with pytest.raises(InUse), instrument_locks("other", {"power": SUPPLY}):
            pytest.fail("two have it")


@posix
def test_forked_child_of_dead_process_does_not_hold_lock(folder: Path) -> None:
    fork = """    import os, time
    if os.fork() == 0:
        print("forked", flush=True)
        time.sleep(60)
    os._exit(0)
"""
    command = [sys.executable, "-c", HOLD.replace("    sys.stdin.read()\n", fork)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:  # noqa: S603
        assert process.stdout is not None
        assert [process.stdout.readline() for _ in range(2)] == ["held\n", "forked\n"]
        process.wait()
    assert list(folder.iterdir())
    with instrument_locks("other", {"power": SUPPLY}) as left:
        assert left["power"].startswith(f"process {process.pid} of ")
    os.killpg(process.pid, signal.SIGKILL)
