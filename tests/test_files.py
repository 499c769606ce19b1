"""Files appear whole or not at all."""

import errno
import hashlib
import os
import resource
import signal
from pathlib import Path

import pytest

from foucault.errors import FoucaultError
from foucault.files import atomic, free_memory, sha256


def names(folder):
    return [path.name for path in folder.iterdir()]


def test_writes_whole_file_with_the_same_suffixes(tmp_path):
    with atomic(tmp_path / "log.csv.gz") as temporary:
        assert temporary.parent == tmp_path
        assert temporary.name.endswith("log.csv.gz")
        temporary.write_text("new")
        assert not (tmp_path / "log.csv.gz").exists()
    assert (tmp_path / "log.csv.gz").read_text() == "new"
    assert names(tmp_path) == ["log.csv.gz"]


@pytest.mark.parametrize("failure", [ValueError("bad"), KeyboardInterrupt(), SystemExit(1)])
def test_failure_leaves_the_old_file(tmp_path, failure):
    target = tmp_path / "result.json"
    target.write_text("old")
    with pytest.raises(type(failure)), atomic(target) as temporary:
        temporary.write_text("half")
        raise failure
    assert target.read_text() == "old"
    assert names(tmp_path) == ["result.json"]


def test_disk_full_is_one_clear_error(tmp_path):
    target = tmp_path / "result.json"
    target.write_text("old")
    with pytest.raises(FoucaultError) as caught, atomic(target) as temporary:
        temporary.write_text("half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert caught.value.code == "output.unwritable"
    assert str(caught.value) == (
        f"'{target}' cannot be written: No space left on device. Nothing was changed; what was "
        "there before is intact. Free some space, or choose a folder that exists and that you "
        "may write to."
    )
    assert target.read_text() == "old"
    assert names(tmp_path) == ["result.json"]


def test_a_write_that_the_system_stops_leaves_nothing(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with pytest.raises(FoucaultError) as caught, atomic(tmp_path / "big.bin") as temporary:
            resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
            temporary.write_bytes(bytes(10_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert caught.value.code == "output.unwritable"
    assert "File too large" in caught.value.message
    assert names(tmp_path) == []


def test_places_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    for path, reason in (
        (tmp_path / "missing" / "x.csv", "No such file or directory"),
        (tmp_path / "file" / "x.csv", "Not a directory"),
        (tmp_path / "folder", "it is a folder"),
    ):
        reached = False
        with pytest.raises(FoucaultError, match=reason) as caught, atomic(path):
            reached = True
        assert caught.value.code == "output.unwritable"
        assert not reached  # known before the work begins


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FoucaultError, match="Permission denied"), atomic(tmp_path / "x.csv"):
        pass
    tmp_path.chmod(0o700)


def test_other_files_that_fail_inside_are_not_blamed_on_the_output(tmp_path):
    with pytest.raises(FileNotFoundError), atomic(tmp_path / "x.csv"):
        (tmp_path / "elsewhere" / "input.csv").read_text()
    assert names(tmp_path) == []


def test_sha256(tmp_path):
    (tmp_path / "x").write_bytes(b"abc" * 1_000_000)
    assert sha256(tmp_path / "x") == hashlib.sha256(b"abc" * 1_000_000).hexdigest()


def test_free_memory_is_what_the_machine_has_or_a_limit_leaves():
    assert free_memory() > 0
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + (256 << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    try:
        assert 0 < free_memory() <= 257 << 20
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
