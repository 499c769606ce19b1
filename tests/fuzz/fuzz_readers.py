"""Feed the readers, units and campaign files what a coverage-guided fuzzer comes up with.

Not collected by pytest: run it by hand, for as long as you like::

    pip install atheris
    python tests/fuzz/fuzz_readers.py logs -max_total_time=300 corpus/
    python tests/fuzz/fuzz_readers.py campaign -max_total_time=300

The first word says what is fuzzed: logs, campaign, units or result. A `FoucaultError` is an answer;
any other exception, a hang (-timeout=20) or too much memory (-rss_limit_mb=3000) is a fault and
leaves a file that repeats it.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["foucault"]):
    from foucault import campaign, logs, run_folder, units
    from foucault.errors import FoucaultError
    from foucault.logs import dialect, raw, reading  # noqa: F401  instrumented

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
from make_damage import FLIGHTS, GOOD  # noqa: E402
from test_damaged_logs import believable, described  # noqa: E402

warnings.simplefilter("ignore")
FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
FILES = GOOD | FLIGHTS
NAMES = list(FILES)


def one_log(data: bytes) -> None:
    """The first byte says which format the rest is taken for."""
    if not data:
        return
    file = NAMES[data[0] % len(NAMES)]
    (FOLDER / file).write_bytes(data[1:])
    try:
        log = logs.read(described(file), FOLDER)
    except FoucaultError:
        return
    believable(log)


def one_campaign(data: bytes) -> None:
    """The first byte says after which template the rest stands."""
    try:
        campaign.parse(data.decode("utf-8", errors="replace"))
    except FoucaultError:
        return


def one_unit(data: bytes) -> None:
    """Number, unit and kind."""
    provider = atheris.FuzzedDataProvider(data)
    kind = provider.PickValueInList(list(units.KINDS))
    try:
        units.parse(provider.ConsumeUnicodeNoSurrogates(60), kind)
    except FoucaultError:
        return


def one_result(data: bytes) -> None:
    """A result.json."""
    (FOLDER / "result.json").write_bytes(data)
    try:
        run_folder.load_result(FOLDER / "result.json", with_tables=False)
    except FoucaultError:
        return


def seeds(what: str) -> list[bytes]:
    """Return what the fuzzer begins with."""
    if what == "logs":
        return [bytes([i]) + FILES[name] for i, name in enumerate(NAMES)]
    if what == "campaign":
        from foucault.procedures import PROCEDURES

        return [campaign.template(name).encode() for name in PROCEDURES]
    if what == "result":
        from make_result import make_result

        run_folder.save(make_result(), FOLDER / "run", "")
        return [(FOLDER / "run" / run_folder.RESULT_FILE).read_bytes()]
    return [b"0.01 deg/h", b"100 ug/sqrt(Hz)"]


def main() -> None:
    what = sys.argv.pop(1) if len(sys.argv) > 1 else ""
    chosen = {"logs": one_log, "campaign": one_campaign, "units": one_unit, "result": one_result}
    if what not in chosen:
        sys.exit(f"Say what to fuzz: {', '.join(chosen)}.")
    corpus = FOLDER / "seeds"
    corpus.mkdir()
    for i, seed in enumerate(seeds(what)):
        (corpus / str(i)).write_bytes(seed)
    atheris.Setup([*sys.argv, "-timeout=20", "-rss_limit_mb=3000", str(corpus)], chosen[what])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
