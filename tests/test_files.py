"""Files appear whole or not at all."""

import errno
import hashlib
import os
import resource
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from foucault.errors import FoucaultError, error
from foucault.files import (
    alone,
    atomic,
    beside,
    free_memory,
    keep_others,
    parse_json,
    parse_toml,
    read_text,
    sha256,
)
from refusals import refuses


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
    with refuses("output.unwritable") as caught, atomic(target) as temporary:
        temporary.write_text("half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert str(caught.value) == (
        f"'{target}' cannot be written: No space left on device. A file of this name that was "
        "there before is intact. Free some space, or choose a folder that exists and that you "
        "may write to."
    )
    assert target.read_text() == "old"
    assert names(tmp_path) == ["result.json"]


@pytest.mark.parametrize("said", ["[Errno 28] ", "Error writing: [errno 28] "])
def test_numbers_of_the_system_are_no_words(said):
    reason = OSError(f"{said}No space left on device")
    assert "rrno" not in str(error("output.unwritable", path="x", reason=reason))


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
        with refuses("output.unwritable", match=reason), atomic(path):
            reached = True
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


def test_temporary_names_cannot_be_guessed_and_follow_no_link(tmp_path, monkeypatch):
    seen = set()
    for _ in range(3):
        with atomic(tmp_path / "x.csv") as temporary:
            seen.add(temporary.name)
    assert len(seen) == 3
    monkeypatch.setattr("secrets.token_hex", lambda n: "known")
    (tmp_path / "victim").write_text("mine")
    (tmp_path / ".partial-known-x.csv").symlink_to(tmp_path / "victim")
    with pytest.raises(FoucaultError, match="File exists"), atomic(tmp_path / "x.csv"):
        pass
    assert (tmp_path / "victim").read_text() == "mine"
    assert (tmp_path / ".partial-known-x.csv").is_symlink()  # not ours to remove


def test_a_file_that_is_replaced_keeps_who_may_read_it(tmp_path):
    target = tmp_path / "result.json"
    with atomic(target) as temporary:
        temporary.write_text("new")
    umask = os.umask(0)
    os.umask(umask)
    assert target.stat().st_mode & 0o777 == 0o666 & ~umask
    target.chmod(0o600)
    with atomic(target) as temporary:
        assert temporary.stat().st_mode & 0o777 == 0o600
        temporary.write_text("newer")
    assert target.stat().st_mode & 0o777 == 0o600


def test_a_device_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FoucaultError, match="it is no ordinary file"), atomic(tmp_path / "pipe"):
        pass
    assert (tmp_path / "pipe").is_fifo()


def test_a_long_name(tmp_path):
    with atomic(tmp_path / ("a" * 251 + ".csv")) as temporary:
        temporary.write_text("new")
    assert names(tmp_path) == ["a" * 251 + ".csv"]
    target = tmp_path / ("a" * 5000)
    with pytest.raises(FoucaultError, match="File name too long") as caught, atomic(target):
        pass
    assert len(caught.value.message) < 1000


def test_only_earlier_outputs_are_replaced(tmp_path):
    mine, out = tmp_path / "campaign.toml", tmp_path / "calibration.h"
    mine.write_text("[log]\n")
    keep_others(out, [b"Calibration by"])  # nothing there
    out.write_text("/* Calibration by foucault */")
    keep_others(out, [b"Calibration by"], [mine])
    with refuses("output.other") as caught:
        keep_others(mine, [b"Calibration by"])
    assert "is no earlier output of this command; it may hold your work." in caught.value.message
    (tmp_path / "link").symlink_to(out)
    with refuses("output.input") as caught:
        keep_others(tmp_path / "link", [b"Calibration by"], [out])
    assert "is read for this: writing it would destroy it." in caught.value.message


@pytest.mark.parametrize(
    "text", ["x = " + "[" * 5000 + "]" * 5000, "[" + "a." * 5000 + "a]", "x = 1" + "0" * 5000]
)
def test_toml_that_nobody_means(text):
    with pytest.raises(tomllib.TOMLDecodeError):
        parse_toml(text)


@pytest.mark.parametrize("text", ["[" * 100_000, "[" * 900 + "]" * 900, "1" + "0" * 5000, "{"])
def test_json_that_nobody_means(text):
    with pytest.raises(ValueError):
        parse_json(text.encode())
    assert parse_json(b"[" * 60 + b"]" * 60)


def test_a_text_that_is_none(tmp_path):
    with (tmp_path / "log.csv").open("wb") as stream:
        stream.truncate(1 << 40)  # of holes
    with pytest.raises(OSError, match="longer than 16 MB"):
        read_text(tmp_path / "log.csv")


PROGRAM = """
import signal, sys, time
from pathlib import Path
from foucault.files import atomic
def slow(*_):
    with atomic(Path(sys.argv[-1]) / "log.csv") as part:
        part.write_text("half")
        print("writing", flush=True)
        while True:  # a signal just before one long sleep would be heard after it
            time.sleep(0.05)
import foucault.campaign
foucault.campaign.simulate = slow
sys.argv = ["foucault", "demo", "-o", sys.argv[-1]]
from foucault.cli import main
main()
"""


@pytest.mark.thorough
@pytest.mark.parametrize("heard", [True, False], ids=["heard", "nobody listens"])
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_nothing_is_left_of_a_run_that_is_told_to_end(tmp_path, how, heard):
    if signal.getsignal(how) is signal.SIG_IGN:
        pytest.skip("whoever started the tests has it ignored, as nohup does; a run heeds that")
    run = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(tmp_path)], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with run:
        _ends(run, tmp_path, how, heard)


def _ends(run, tmp_path, how, heard):
    assert run.stdout.readline() == "writing\n", run.communicate(timeout=300)
    assert [n.startswith(".partial-") for n in names(tmp_path)] == [True]
    if not heard:
        run.stderr.close()
    run.send_signal(how)
    run.wait(timeout=300)
    assert names(tmp_path) == []
    assert run.returncode == 128 + how
    said = run.stderr.read() if heard else ""
    assert heard == ("a result that was there before is intact" in said)
    assert "Traceback" not in said


def test_a_folder_is_one_runs_at_a_time(tmp_path):
    with alone(tmp_path / "a" / "run"):
        with refuses("output.busy") as caught, alone(tmp_path / "a" / "run"):
            pass
        assert "Another run of foucault is writing into" in caught.value.message
        (tmp_path / "a" / "run" / "result.json").write_text("{}")
    assert names(tmp_path / "a" / "run") == ["result.json"]
    with alone(tmp_path / "a" / "run"):  # and again
        pass
    with alone(tmp_path / "b" / "run"):
        pass
    assert names(tmp_path) == ["a"]  # an empty folder is removed again


def test_a_killed_run_holds_nobody_up(tmp_path):
    program = (
        "import os, sys; from foucault.files import alone\n"
        "with alone(sys.argv[1]): print(os.listdir(sys.argv[1])); sys.stdout.flush(); os._exit(9)"
    )
    run = [sys.executable, "-c", program, str(tmp_path)]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 9
    assert names(tmp_path) == [".foucault.lock"]
    with alone(tmp_path):
        pass
    assert names(tmp_path) == []


def test_a_page_that_does_not_fit_loses_no_result(tmp_path):
    with refuses("output.no_report") as caught, beside(tmp_path), atomic(tmp_path / "page"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert caught.value.message.endswith(
        f"The result itself is whole and lies in '{tmp_path}', but without its report."
    )
    assert "No space left on device" in caught.value.message


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
