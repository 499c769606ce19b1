"""The same log out of every format."""

import gzip

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read, write
from foucault.tables import Log
from refusals import refuses

RATE = {
    "rate": "100 Hz",
    "gyro": {"columns": [0, 1, 2], "unit": "deg/s"},
    "accel": {"columns": [3, 4, 5], "unit": "g"},
}


@pytest.fixture
def matrix():
    rng = np.random.default_rng(3)
    out = rng.normal(0.0, 1.0, (300, 6))
    out[:, 5] = 1.0 + rng.normal(0.0, 0.01, 300)
    out[:, 3:5] *= 0.01
    return out


def described(folder, file, **words):
    return read(LogDescription.model_validate({"file": file, **RATE, **words}), folder)


def check(log, matrix):
    assert np.array_equal(log.gyro, matrix[:, :3] * (np.pi / 180))
    assert np.array_equal(log.accel, matrix[:, 3:] * 9.80665)
    assert np.array_equal(log.time, np.arange(len(matrix)) / 100.0)
    assert log.sampled == "rate"
    assert log.findings == ()


def same(a, b):
    left, right = a.columns(), b.columns()
    return left.keys() == right.keys() and all(np.array_equal(left[k], right[k]) for k in left)


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet", ".npz"])
@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_our_own_files_need_no_description(tmp_path, log, suffix, sampled):
    log = Log(log.time, log.gyro, log.accel, sampled, log.temperature)
    write(log, tmp_path / f"log{suffix}")
    back = read(LogDescription(file=f"log{suffix}"), tmp_path)
    assert same(log, back)
    assert back.sampled == sampled
    assert back.findings == ()
    assert back.source["rows"] == 500
    assert back.source["file"] == f"log{suffix}"
    assert len(back.source["sha256"]) == 64
    assert back.source["description"]["gyro"]["unit"] == "rad/s"


def test_a_parquet_log_of_ours_that_was_damaged_is_refused(tmp_path, log):
    file = tmp_path / "log.parquet"
    write(log, file)
    whole = bytearray(file.read_bytes())
    at = whole.index(np.float64(log.accel[250, 0]).tobytes())
    whole[at : at + 8] = bytes(8)
    file.write_bytes(whole)
    with refuses("log.unreadable"):
        read(LogDescription(file="log.parquet"), tmp_path)


def test_extreme_floats_come_back_exactly(tmp_path):
    rng = np.random.default_rng(5)
    bits = rng.integers(0, 2**62, 3000, dtype=np.int64).view(np.float64).reshape(-1, 3)
    log = Log(np.arange(1000) / 3.0, bits, None)
    write(log, tmp_path / "log.csv")
    description = {"file": "log.csv", "time": {"unit": "s"}, "gyro": {"unit": "rad/s"}}
    assert np.array_equal(read(LogDescription(**description), tmp_path).gyro, bits)


def test_only_some_columns(tmp_path, log):
    write(Log(log.time, None, log.accel), tmp_path / "log.parquet")
    back = read(LogDescription(file="log.parquet"), tmp_path)
    assert back.gyro is None
    assert np.array_equal(back.accel, log.accel)


def test_our_own_gzip_is_reproducible(tmp_path, log):
    write(log, tmp_path / "a.csv.gz")
    write(log, tmp_path / "b.csv.gz")
    assert (tmp_path / "a.csv.gz").read_bytes() == (tmp_path / "b.csv.gz").read_bytes()


def test_other_suffixes_are_not_written(tmp_path, log):
    with pytest.raises(FoucaultError, match=r"written as .csv, .csv.gz, .parquet, .npz"):
        write(log, tmp_path / "log.xlsx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|", " ", "   "])
@pytest.mark.parametrize("packed", [False, True])
def test_text(tmp_path, matrix, delimiter, packed):
    lines = [delimiter.join(map(repr, row)) for row in matrix.tolist()]
    text = "\n".join(lines) + "\n"
    name = "log.txt.gz" if packed else "log.txt"
    (tmp_path / name).write_bytes(gzip.compress(text.encode()) if packed else text.encode())
    check(described(tmp_path, name), matrix)


def test_text_with_spaces_comments_blank_lines_and_crlf(tmp_path, matrix):
    lines = ["% made by a logger", "", "# second remark, with commas"]
    for i, row in enumerate(matrix.tolist()):
        lines.append("   " + "\t  ".join(map(repr, row)) + "  ")
        if i % 50 == 7:
            lines += ["# a remark between the samples", "", "   "]
        if i % 70 == 5:
            lines[-1] += "  % and one behind them"
    (tmp_path / "log.txt").write_bytes("\r\n".join(lines).encode())
    check(described(tmp_path, "log.txt"), matrix)


def test_comma_text_with_comments_between(tmp_path, matrix):
    lines = [", ".join(map(repr, row)) for row in matrix.tolist()]
    lines[40:40] = ["# restarted", " # twice"]
    (tmp_path / "log.csv").write_text("\ufeff" + "\n".join(lines))
    check(described(tmp_path, "log.csv"), matrix)


@pytest.mark.thorough
def test_long_text_is_cut_at_lines_only(tmp_path, matrix):
    many = np.tile(matrix, (300, 1))
    np.savetxt(tmp_path / "log.txt", many, fmt="%.17g")
    check(described(tmp_path, "log.txt"), many)


def test_decimal_comma(tmp_path, matrix):
    lines = [";".join(repr(v).replace(".", ",") for v in row) for row in matrix.tolist()]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    check(described(tmp_path, "log.csv", decimal=","), matrix)


@pytest.mark.parametrize(
    "head",
    [
        "gx,gy,gz,ax,ay,az",
        "Gyr_X (deg/s),Gyr_Y (deg/s),Gyr_Z (deg/s),Acc_X [g],Acc_Y [g],Acc_Z [g]",
        '"gyro.x","gyro.y","gyro.z","accel.x","accel.y","accel.z"',
        "wx,wy,wz,ax,ay,az\ndeg/s,deg/s,deg/s,g,g,g",
        "# gx,gy,gz,ax,ay,az",
    ],
)
def test_usual_names_are_guessed(tmp_path, matrix, head):
    lines = [head, *(",".join(map(repr, row)) for row in matrix.tolist())]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = described(tmp_path, "log.csv", gyro={"unit": "deg/s"}, accel={"unit": "g"})
    check(log, matrix)


def test_header_lines_of_numbers_are_skipped_when_told(tmp_path, matrix):
    lines = ["% title", "1 2 3", "4 5 6", ""]
    lines += [" ".join(map(repr, row)) for row in matrix.tolist()]
    (tmp_path / "log.txt").write_text("\n".join(lines))
    check(described(tmp_path, "log.txt", header=4), matrix)


def test_foreign_parquet(tmp_path, matrix):
    import pyarrow as pa
    from pyarrow import parquet

    names = ["gx", "gy", "gz", "ax", "ay", "az"]
    table = pa.table({n: matrix[:, i] for i, n in enumerate(names)} | {"note": ["x"] * 300})
    parquet.write_table(table, tmp_path / "log.parquet", row_group_size=77)
    check(described(tmp_path, "log.parquet", gyro={"unit": "deg/s"}), matrix)
    with pytest.raises(FoucaultError, match="column 'note': 'of type string' is not a number"):
        described(tmp_path, "log.parquet", gyro={"unit": "deg/s", "columns": ["gx", "gy", "note"]})


def test_npy(tmp_path, matrix):
    np.save(tmp_path / "a.npy", matrix)
    np.save(tmp_path / "b.npy", np.asfortranarray(matrix.T))
    check(described(tmp_path, "a.npy"), matrix)
    check(described(tmp_path, "b.npy"), matrix)


def test_structured_npy(tmp_path, matrix):
    dtype = [(name, "f8") for name in ("gx", "gy", "gz", "ax", "ay", "az")]
    np.save(tmp_path / "a.npy", np.array([tuple(row) for row in matrix], dtype))
    log = described(tmp_path, "a.npy", gyro={"unit": "deg/s"}, accel={"unit": "g"})
    check(log, matrix)


def test_npz_with_one_and_with_several_arrays(tmp_path, matrix):
    np.savez(tmp_path / "a.npz", imu=matrix, site=np.ones(3))
    check(described(tmp_path, "a.npz", variable="imu"), matrix)
    check(described(tmp_path, "a.npz"), matrix)
    np.savez(tmp_path / "b.npz", gyr=matrix[:, :3], acc=matrix[:, 3:])
    several = {
        "gyro": {"columns": ["gyr.0", "gyr.1", "gyr.2"], "unit": "deg/s"},
        "accel": {"columns": ["acc.0", "acc.1", "acc.2"], "unit": "g"},
    }
    check(described(tmp_path, "b.npz", **several), matrix)
    with pytest.raises(FoucaultError, match=r"no variable 'imo'\. Did you mean 'imu'"):
        described(tmp_path, "a.npz", variable="imo")


def test_matlab(tmp_path, matrix):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"imu": matrix, "name": "a logger", "site": np.ones((3, 1))})
    check(described(tmp_path, "a.mat"), matrix)
    check(described(tmp_path, "a.mat", variable="imu"), matrix)
    savemat(tmp_path / "v4.mat", {"imu": matrix}, format="4")
    check(described(tmp_path, "v4.mat"), matrix)
    with pytest.raises(FoucaultError, match="variables are: imu, site"):
        described(tmp_path, "a.mat", variable="gyro")
    np.savetxt(tmp_path / "ascii.mat", matrix, fmt="%25.17e")
    check(described(tmp_path, "ascii.mat"), matrix)
    (tmp_path / "hdf.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(500))
    with pytest.raises(FoucaultError, match="Save it in MATLAB with save"):
        described(tmp_path, "hdf.mat")


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_binary(tmp_path, matrix, order, kind):
    code = {"little": "<", "big": ">"}[order] + np.dtype(kind).str[1:]
    (tmp_path / "log.bin").write_bytes(b"HEADER" + matrix.astype(code).tobytes())
    record = {"type": kind, "columns": 6, "byte_order": order, "skip": 6}
    log = described(tmp_path, "log.bin", record=record)
    check(log, matrix.astype(kind).astype(float))


def test_binary_records_of_several_types(tmp_path):
    rng = np.random.default_rng(2)
    types = ("uint32", *("int16",) * 6)
    rows = np.zeros(100, [(f"c{i}", "<" + np.dtype(t).str[1:]) for i, t in enumerate(types)])
    rows["c0"] = 10 * np.arange(100) + 5
    for i in range(1, 7):
        rows[f"c{i}"] = rng.integers(-50, 50, 100)
    rows["c6"] += 10000
    rows.tofile(tmp_path / "log.bin")
    log = read(
        LogDescription.model_validate(
            {
                "file": "log.bin",
                "record": {"type": list(types)},
                "time": {"column": 0, "unit": "ms"},
                "gyro": {"columns": [1, 2, 3], "unit": "count", "scale": "100 count/(deg/s)"},
                "accel": {"columns": [4, 5, 6], "unit": "count", "scale": "10000 count/g"},
            }
        ),
        tmp_path,
    )
    assert log.time == pytest.approx(0.01 * np.arange(100) + 0.005, abs=1e-12)
    assert log.gyro[:, 0] == pytest.approx(np.deg2rad(rows["c1"] / 100.0), rel=1e-14)
    assert log.accel[:, 2] == pytest.approx(rows["c6"] * 9.80665e-4, rel=1e-14)


def test_progress_runs_to_one(tmp_path, log):
    for suffix in (".csv", ".csv.gz", ".parquet", ".npz"):
        write(log, tmp_path / f"log{suffix}")
        seen = []
        read(LogDescription(file=f"log{suffix}"), tmp_path, seen.append)
        assert seen == sorted(seen)
        assert seen[-1] == 1.0


def test_titles_as_a_spreadsheet_in_europe_writes_them(tmp_path):
    file = tmp_path / "messung.csv"
    triads = ["Drehrate X [°/s]", "Y [°/s]", "Z [°/s]", "Beschl. X [g]", "Beschl. Y [g]", "Z [g]"]
    rows = [["Messreihe Prüfling A"], ["Zeit [ms]", *triads]]
    rows += [[f"{10 * i},0", "0,5", "-1,25", "0", "0,01", "0", "1,0"] for i in range(4)]
    text = "\r\n".join(";".join(row) for row in rows)
    file.write_bytes(text.encode("cp1252"))
    log = read(
        LogDescription.model_validate({
            "file": file.name, "decimal": ",",
            "time": {"column": "Zeit [ms]", "unit": "ms"},
            "gyro": {"columns": triads[:3], "unit": "deg/s"},
            "accel": {"columns": triads[3:], "unit": "g"},
        }),
        tmp_path,
    )  # fmt: skip
    np.testing.assert_allclose(log.time, [0.0, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(np.degrees(log.gyro[0]), [0.5, -1.25, 0.0])
    np.testing.assert_allclose(log.accel[0], [0.0980665, 0.0, 9.80665])
