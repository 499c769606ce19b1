"""A folder of trials: what is missing is computed, what is there is kept."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault import campaign, monte_carlo, procedures
from foucault.campaign import study
from foucault.errors import FoucaultError

FILE = "optimise.json"


def opened(folder: Path, size: int = 4, **asked: Any) -> study.Parts:
    return study.opened(folder, asked, "search", size, {})


def draw(index: int, seeds: np.random.SeedSequence) -> dict[str, Any]:
    return {"i": index, "x": float(np.random.default_rng(seeds).standard_normal())}


def test_what_is_there_is_not_computed_again(tmp_path: Path) -> None:
    whole = opened(tmp_path / "whole").run(draw, 11, 3, map)
    kept, computed = opened(tmp_path / "parts"), []

    def noted(index: int, seeds: np.random.SeedSequence) -> dict[str, Any]:
        computed.append(index)
        return draw(index, seeds)

    kept.run(noted, 6, 3, map)
    assert kept.missing(11) == (range(4, 8), range(8, 11))
    longer = kept.run(noted, 11, 3, map)
    assert computed == [*range(6), *range(4, 11)]
    for name in ("i", "x"):
        np.testing.assert_array_equal(longer[name], whole[name])


def test_it_stops_early_with_what_is_finished_and_goes_on(tmp_path: Path) -> None:
    kept = opened(tmp_path)
    early = kept.run(draw, 12, 3, monte_carlo.threads(2), until=lambda: not kept.missing(8))
    assert list(early["i"]) == list(range(8))
    assert list(kept.run(draw, 12, 3, map)["i"]) == list(range(12))


def test_parts_that_are_lost_are_made_again(tmp_path: Path) -> None:
    kept = opened(tmp_path)
    assert kept.merge(12) == {}
    whole = kept.run(draw, 12, 3, map)
    (tmp_path / study.FOLDER / "0000004-0000007.parquet").unlink()
    assert list(kept.merge(12)["i"]) == [0, 1, 2, 3, 8, 9, 10, 11]
    np.testing.assert_array_equal(kept.run(draw, 12, 3, map)["x"], whole["x"])


def test_a_folder_keeps_its_size_of_parts_and_refuses_another_question(tmp_path: Path) -> None:
    opened(tmp_path, size=4, names=("a", "b"), seed=1)
    assert opened(tmp_path, size=500, names=("a", "b"), seed=1).size == 4
    with pytest.raises(FoucaultError, match="holds another search: names, seed is not"):
        opened(tmp_path, names=("a",), seed=2)
    said = json.loads((tmp_path / FILE).read_text())
    (tmp_path / FILE).write_text(json.dumps(said | {"version": "0.0.1"}))
    with pytest.raises(FoucaultError, match="version is not"):
        opened(tmp_path, names=("a", "b"), seed=1)
    (tmp_path / FILE).unlink()
    opened(tmp_path, names=("a",)).write(range(4), [{"i": 1}])
    (tmp_path / FILE).write_text("[]")
    with pytest.raises(FoucaultError, match=r"optimise\.json is missing or cannot be read"):
        opened(tmp_path, names=("a",))


def test_large_studies_have_larger_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "LARGE", 2)
    monkeypatch.setattr(study, "LARGE_PART", 3)
    described = campaign.parse(campaign.template("six_position"))
    row = study._row(study.names_of(described), "failed")
    monkeypatch.setattr(study.Trial, "__call__", lambda self, index, seeds: row)
    assert study.run(described, 7, tmp_path).status == {"failed": 7}
    assert [p.stem for p in sorted((tmp_path / study.FOLDER).iterdir())] == [
        "0000000-0000002", "0000003-0000005", "0000006-0000006",
    ]  # fmt: skip


def test_threads_take_items_as_they_are_needed() -> None:
    taken: list[int] = []

    def items() -> Any:
        for i in range(1000):
            taken.append(i)
            yield i

    rows = monte_carlo.threads(3)(abs, items())
    assert [next(rows) for _ in range(5)] == [0, 1, 2, 3, 4]
    assert len(taken) == 5 + 3 * monte_carlo.AHEAD
    rows.close()


@pytest.mark.parametrize("name", procedures.PROCEDURES)
def test_a_trial_goes_to_another_process_whole(name: str) -> None:
    trial = study.Trial(campaign.parse(campaign.template(name), f"{name}.toml"))
    assert pickle.loads(pickle.dumps(trial)) == trial
