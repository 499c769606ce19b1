"""What every example and command says of three sessions, kept so that no change moves it silently.

    python tests/make_golden.py                 # writes tests/golden/*.json again
    python tests/make_golden.py ferraris north  # those alone

A file a case: what all its sessions share under "all", the rest under the seed. A line is a
quantity, named by its place in result.json (or in what the command prints with --json), with its
number, its list of numbers, or its sentence. Covariances are kept whole, as standard deviations
and rows of correlations. Versions, times and paths are left out.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from typer.testing import CliRunner

from foucault import campaign, run_folder
from foucault.cli import app
from foucault.logs import own
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.procedures import temperature
from foucault.result import Result
from foucault.result_document import document
from foucault.tables import Log
from make_compare import make_results
from make_navigation import calibration, errors, logged
from make_temperature import sessions

FOLDER = Path(__file__).parent / "golden"
EXAMPLES = Path(__file__).parent.parent / "examples"
SEEDS = (1, 2, 3)

TOLERANCE: tuple[tuple[str, str, float], ...] = (
    ("navigate", "*.up_sd", np.inf),  # the height is held: rounding alone, below a nanometre
    ("navigate", "*.vertical", np.inf),
    ("navigate", "*.up", 1e-2),
    ("navigate", "contributions.*", 2e-3),  # differences of two runs
    ("navigate", "*", 1e-5),
    ("platform_tumble", "*", 1e-5),
    ("systematic", "tables.navigation.velocity_up", np.inf),
    ("systematic", "*", 1e-5),
    ("transfer_alignment", "*", 1e-5),
    ("preflight", "two_imus.*", 1e-6),  # thousands of knots of a spline
    ("continuous_spin", "*", 1e-5),  # hundreds of samples on a band: other BLAS, other digits
    ("temperature", "diagnostics.families.*", 1e-4),  # tests of small differences
    ("*", "*", 1e-7),
)
"""Case, quantity, and by how much it may move; the first that fits counts.

Values and their bounds in sd, correlations, shares and budgets in parts of one, others in parts of
the largest number of their line. Sentences are the same to the letter.
"""

NOTHING = 1e-29
"""Numbers below it are rounding about zero: no variance in SI is as small [SI]."""

VOLATILE = {
    "schema", "provenance", "campaign", "display_value", "display_sd", "display_sd_seconds",
    "sd_seconds", "created", "date", "dates", "seconds", "versions", "sha256", "folder", "report",
    "path", "file", "files", "best",
}  # fmt: skip
"""`files` are digests of bytes; the order of `best` is by chance where axes are alike."""

DIGITS, OF_VALUES = 10, 12  # significant; a value is many times its sd
SHORT = 40  # letters: a name, no sentence; a list of names is one line
LIMITS, WORDS = ("value", "low", "high"), ("symbol", "meaning", "kind", "unit", "display_unit")
LONGEST = 100  # numbers; of longer lists and of columns of tables only the rms is kept


# -- the cases: each works in an empty folder ------------------------------------------------------


def _example(name: str, seed: int) -> Result:
    """Simulate an example into the folder "session" and calibrate it."""
    made = campaign.simulate(EXAMPLES / f"{name}.toml", seed)
    return campaign.calibrate(campaign.save_session(made, "session"))


def _calibrated(name: str) -> Callable[[int], dict[str, Any]]:
    def case(seed: int) -> dict[str, Any]:
        result = _example(name, seed)
        return document(result) | {"tables": result.tables}

    return case


def _said(*words: object) -> dict[str, Any]:
    """Return what a command prints with --json."""
    done = CliRunner().invoke(app, [*map(str, words), "--json"])
    if done.exit_code in (1, 2, 70):
        raise RuntimeError(f"foucault {words[0]} ended with {done.exit_code}: {done.output}")
    return {"exit": done.exit_code} | json.loads(done.stdout)


def _preflight(_: int) -> dict[str, Any]:
    return {file.stem: _said("preflight", file) for file in sorted(EXAMPLES.glob("*.toml"))}


def _north(seed: int) -> dict[str, Any]:
    run_folder.save(_example("north_seeking", seed), "run")
    made = campaign.simulate(EXAMPLES / "north_seeking.toml", seed + 10)
    path = campaign.save_session(made, "session")
    said = _said("north", path, "--calibration", "run")
    return said | {"setups": said["setups"][::12]}


SITE = ("--latitude", "47.3 deg", "--height", "430 m")


def _align(seed: int) -> dict[str, Any]:
    plan = [Rest(120.0), Rotate("up", -np.pi, np.radians(10)), Rest(121.0)]
    own.write(logged(plan, errors(seed)[0], rate=20.0, seed=seed).log, Path("log.csv"))
    return _said("align", "log.csv", *SITE, "--rest", "0 s to 120 s", "--rest", "141 s to 259 s",
                 "--gyro-bias-sd", "0.02 deg/h")  # fmt: skip


def _navigate(seed: int) -> dict[str, Any]:
    true, found = errors(seed)
    own.write(logged([Rest(600.0)], true, rate=10.0, seed=seed).log, Path("log.csv"))
    run_folder.save(calibration(found), "run")
    return _said("navigate", "log.csv", *SITE, "--longitude", "8.5 deg",
                 "--gyro-noise", "0.002 deg/sqrt(h)", "--accel-noise", "5 ug/sqrt(Hz)",
                 "--calibration", "run")  # fmt: skip


def _allan(seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(size=(20000, 3)), axis=0)
    accel = 0.01 * rng.normal(size=(20000, 3)) + 1e-5 * walk + [0.0, 0.0, 9.81]
    gyro = 1e-3 * rng.normal(size=(20000, 3)) + 1e-5 * walk
    own.write(Log(np.arange(20000) / 100, gyro, accel), Path("log.csv"))
    return _said("allan", "log.csv")


def _delay(seed: int) -> dict[str, Any]:
    made = campaign.simulate(EXAMPLES / "transfer_alignment.toml", seed)
    return _said("delay", campaign.save_session(made, "session"))


def _temperature(seed: int) -> dict[str, Any]:
    return document(temperature.calibrate(sessions((-15, 5, 25, 45, 65), seed)))


def _compare(seed: int) -> dict[str, Any]:
    for i, result in enumerate(make_results(3, seed)):
        run_folder.save(result, f"{2024 + i}")
    return _said("compare", *range(2024, 2027))


def _fleet(seed: int) -> dict[str, Any]:
    _said("simulate", "norm_observation", "-o", "bench", "--instruments", 4, "--seed", seed)
    said = _said("fleet", "bench/campaign.toml", "-o", "out")
    (file,) = Path("out").glob("*.parquet")
    return said | {"instruments": pq.read_table(file).to_pydict()}


SEEDS_OF = {
    "preflight": (1,),
    "navigate": (1, 2),
    "compare": (1, 2),
    "allan": (1, 2),
    "fleet": (1, 2),
}
"""Fewer, where a session says much, or none is made."""

CASES: dict[str, Callable[[int], dict[str, Any]]] = {
    **{file.stem: _calibrated(file.stem) for file in sorted(EXAMPLES.glob("*.toml"))},
    "preflight": _preflight, "north": _north, "align": _align, "navigate": _navigate,
    "allan": _allan, "delay": _delay, "temperature": _temperature, "compare": _compare,
    "fleet": _fleet,
}  # fmt: skip


# -- as lines --------------------------------------------------------------------------------------

Lines = dict[str, Any]


def made(case: str, seed: int) -> Lines:
    """Return what a case says of a session, a line a quantity."""
    with TemporaryDirectory() as folder, chdir(folder):
        return dict(_lines("", CASES[case](seed)))


def _lines(path: str, said: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(said, Mapping):
        said = {k: v for k, v in said.items() if k != "name" or not path.endswith(f".{v}")}
        if said.keys() >= {"passed", "sentence", *LIMITS}:  # a check
            level = "inside" if said.pop("passed") else f"outside, so {said['fails']}"
            said |= {"numbers": [said.pop(k) for k in LIMITS], "fails": f"{said['fails']}; {level}"}
        if said.keys() >= {*WORDS}:  # a coefficient
            said["words"] = "; ".join(str(said.pop(k, None)) for k in WORDS)
        if path == "covariance":
            yield "covariance.names", list(said["names"])
            path, said = "correlation", _correlation(**said)
        for key in sorted(said.keys() - VOLATILE, key=str):
            yield from _lines(f"{path}.{key}".lstrip("."), said[key])
    elif isinstance(said, np.ndarray):  # a column of a table
        if said.dtype.kind in "fiub":
            yield path, _digest(said.astype(float))
    elif isinstance(said, (list, tuple)):
        flat = _flat(said) if _numeric(said) else None
        if flat is not None:
            whole = len(flat) <= LONGEST
            yield path, [_rounded(x) for x in flat] if whole else _digest(np.array(flat, float))
            return
        if said and all(isinstance(x, str) and len(x) < SHORT for x in _flat(said)):
            yield path, list(said)
            return
        names = [one.get("name") if isinstance(one, Mapping) else None for one in said]
        named = all(isinstance(n, str) for n in names) and len(set(names)) == len(names)
        for i, one in enumerate(said):
            yield from _lines(f"{path}.{names[i] if named else i}", one)
    elif said is not None:
        yield path, _rounded(said, OF_VALUES if path.endswith("value") else DIGITS)


def _flat(said: Any) -> list[Any]:
    return [y for x in said for y in _flat(x)] if isinstance(said, (list, tuple)) else [said]


def _numeric(said: Any) -> bool:
    return bool(said) and all(x is None or isinstance(x, (int, float)) for x in _flat(said))


def _digest(x: Any) -> float:
    """Return the root mean square of what is finite."""
    seen = x[np.isfinite(x)]
    return _rounded(float(np.sqrt(np.mean(seen**2)))) if seen.size else 0.0


def _correlation(names: list[str], matrix: list[list[float]]) -> dict[str, list[float]]:
    """Return the rows of the correlations, left of the diagonal."""
    cov = np.array(matrix, float)
    root = np.sqrt(np.diag(cov))
    root[~(root > 0)] = np.inf
    correlation = cov / np.outer(root, root)
    return {name: correlation[i, :i].round(9).tolist() for i, name in enumerate(names) if i}


def _rounded(x: Any, digits: int = DIGITS) -> Any:
    if not isinstance(x, float):
        return x
    return float(f"{x:.{digits}g}") if np.isfinite(x) else None


# -- written, read, compared -----------------------------------------------------------------------


def write(case: str) -> None:
    """Make a case again and write its file."""
    runs = {str(seed): made(case, seed) for seed in SEEDS_OF.get(case, SEEDS)}
    first = next(iter(runs.values()))
    shared = {key for key in first if all(r.get(key, r) == first[key] for r in runs.values())}
    blocks = {"all": {key: first[key] for key in shared}}
    blocks |= {s: {k: v for k, v in run.items() if k not in shared} for s, run in runs.items()}
    text = ",\n".join(f'"{name}": {_block(lines)}' for name, lines in blocks.items())
    (FOLDER / f"{case}.json").write_text(f"{{\n{text}\n}}\n", encoding="utf-8")


def _block(lines: Lines) -> str:
    """Return JSON with the single numbers of one thing, such as a coefficient, on one line."""
    groups: Lines = {}
    for key, said in sorted(lines.items()):
        of, _, last = key.rpartition(".")
        if type(said) in (int, float, bool):
            groups.setdefault(of, {})[last] = said
        else:
            groups[f"{key}:"] = said
    said = (
        f" {json.dumps(k)}: {json.dumps(groups[k], ensure_ascii=False)}" for k in sorted(groups)
    )
    return "{\n" + ",\n".join(said) + "\n}"


def kept(case: str, seed: int) -> Lines:
    """Return the lines that were kept of a session."""
    blocks = json.loads((FOLDER / f"{case}.json").read_text(encoding="utf-8"))
    lines: Lines = {}
    for block in (blocks["all"], blocks[str(seed)]):
        for key, said in block.items():
            if key.endswith(":"):
                lines[key[:-1]] = said
            else:
                lines |= {f"{key}.{last}".lstrip("."): value for last, value in said.items()}
    return lines


def moved(case: str, before: Lines, after: Lines) -> list[str]:
    """Return a sentence for each quantity that is not what it was, the largest move first."""
    told: list[tuple[float, str]] = []
    for key in sorted(before.keys() | after.keys()):
        if key not in after or key not in before:
            one = before.get(key, after.get(key))
            told.append((np.inf, f"{key}: {'new' if key in after else 'gone'}, {one!r}"))
            continue
        a, b = before[key], after[key]
        if a == b:
            continue
        size, unit, i = _distance(key, a, b, before)
        allowed = next(t for c, q, t in TOLERANCE if fnmatchcase(case, c) and fnmatchcase(key, q))
        if size > allowed:
            where = (
                f"[{i}]" if isinstance(a, list) and isinstance(b, list) and size < np.inf else ""
            )
            a, b = (a[i], b[i]) if where else (a, b)
            by = f"moved by {size:.2g} {unit} (allowed {allowed:g})" if size < np.inf else "changed"
            told.append((size / allowed, f"{key}{where} {by}: {a!r} -> {b!r}"))
    return [words for _, words in sorted(told, key=lambda one: -one[0])]


def _distance(key: str, a: Any, b: Any, before: Lines) -> tuple[float, str, int]:
    """Return how far a quantity moved, in which unit, and which of its numbers moved most."""
    x, y = (np.array(v if isinstance(v, list) else [v], object) for v in (a, b))
    numbers = all(v is None or type(v) in (int, float) for v in (*x, *y))
    if not numbers or x.shape != y.shape or any((x == None) != (y == None)):  # noqa: E711
        return np.inf, "", 0
    x, y = x.astype(float), y.astype(float)
    if np.nanmax(np.abs([x, y])) < NOTHING:
        return 0.0, "", 0
    sd = [before.get(f"coefficients.{name}.sd", 0.0) for name in before.get("covariance.names", ())]
    scale: Any = max(np.nanmax(np.abs([x, y])), 1e-300)
    unit = "of its size"
    own_sd = before.get(key.removesuffix("value") + "sd")
    if key.endswith(".value") and own_sd:
        scale, unit = own_sd, "sd"
    elif key.startswith("correlation.") or key.endswith((".seen", ".share")):
        scale, unit = 1.0, "of one"
    elif ".budget." in key and not key.startswith("diagnostics."):  # one of several documents
        whole = key.partition(".budget.")[0] + ".budget."
        tail = "" if isinstance(a, list) else key[key.rindex(".") :]  # of each quantity by itself
        parts = [v for k, v in before.items()
                 if k.startswith(whole) and k.endswith(tail) and type(v) is type(a)]  # fmt: skip
        scale, unit = np.maximum(np.sum(parts, axis=0), 1e-300), "of the variance"
    elif key.startswith("diagnostics.budget.") and len(x) == len(sd):
        scale, unit = np.maximum(np.square(sd), 1e-300), "of the variance"
    far = np.nan_to_num(np.abs(y - x) / scale, nan=0.0)
    return float(far.max()), unit, int(far.argmax())


def main() -> None:
    """Write the cases named, or all of them."""
    FOLDER.mkdir(exist_ok=True)
    for case in sys.argv[1:] or CASES:
        started = time.perf_counter()
        write(case)
        print(f"{case}: {time.perf_counter() - started:.1f} s", flush=True)


if __name__ == "__main__":
    main()
