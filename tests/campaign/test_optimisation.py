"""A search for a plan in a folder: the same whoever computes it, continued, and its plan runs."""

from __future__ import annotations

import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from foucault import campaign
from foucault.campaign import optimisation
from foucault.campaign.running import save_session, simulate
from foucault.errors import FoucaultError
from make_tumble import campaign_text
from refusals import refuses

SMALL = {"restarts": 6, "evaluations": 60, "size": 3, "seed": 5}


def described(procedure='rate_limit = "0.2 deg/s"', wanted="", path="campaign.toml"):
    procedure = f'{procedure}\nlatitude_sd = "0 deg"'  # what is stated then is the bound
    text = campaign_text(procedure, 'interval = "1 s"')
    text = text.replace("# gravity_sd = ", 'gravity_sd = "0 m/s^2"  # ')
    return campaign.parse(
        f"{text}\n[optimise]\ntruths = 1\nlatitudes = ['0 deg']\n{wanted}\n", path
    )


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    folder = tmp_path_factory.mktemp("search")
    return folder, optimisation.run(described(), folder, workers=1, **SMALL)


def content(folder):
    return pq.read_table(folder / "restarts.parquet")


def test_what_is_found_is_better_and_said_so(searched):
    folder, found = searched
    assert found.geometric_mean[0] < 1
    assert found.cases == ("the site", "latitude 0 deg", "cluster 1")
    assert len(found.restarts) == 6
    assert found.evaluations == content(folder)["evaluations"].to_numpy().sum()
    assert optimisation.load(folder) == found
    best = content(folder)["cost"].to_numpy().min()
    # What was searched by is a little pessimistic, see plans.tumble.FINEST.
    assert np.log(found.geometric_mean[0]) == pytest.approx(best, abs=0.06)


def test_workers_do_not_matter(searched, tmp_path):
    folder, found = searched
    other = optimisation.run(described(), tmp_path, workers=4, **SMALL)
    assert content(tmp_path).equals(content(folder))
    assert other == found


def test_what_was_lost_is_computed_again(searched, tmp_path):
    folder, _ = searched
    shutil.copytree(folder, tmp_path / "again")
    for name in ("0000001-0000001.parquet", "0000005-0000005.parquet"):
        (tmp_path / "again" / "parts" / name).unlink()
    (tmp_path / "again" / "restarts.parquet").unlink()
    optimisation.run(described(), tmp_path / "again", **SMALL)
    assert content(tmp_path / "again").equals(content(folder))


@pytest.mark.thorough
def test_more_restarts_go_on_where_it_ended(searched, tmp_path):
    folder, found = searched
    shutil.copytree(folder, tmp_path / "on")
    further = optimisation.run(described(), tmp_path / "on", **SMALL | {"restarts": 9})
    assert content(tmp_path / "on").slice(0, 6).equals(content(folder))
    costs = [r["cost"] for r in further.restarts]
    assert len(costs) == 9
    assert min(costs) <= min(r["cost"] for r in found.restarts)
    assert [r["continued"] for r in further.restarts] == [False] * 4 + [True] * 2 + [
        False,
        True,
        True,
    ]
    # Wherever it was interrupted, in the middle of a round too.
    optimisation.run(described(), tmp_path / "new", **SMALL | {"restarts": 5})
    assert optimisation.run(described(), tmp_path / "new", **SMALL | {"restarts": 9}) == further


def test_fewer_restarts_do_not_forget_what_was_found(searched, tmp_path):
    folder, found = searched
    shutil.copytree(folder, tmp_path / "fewer")
    assert optimisation.run(described(), tmp_path / "fewer", **SMALL | {"restarts": 2}) == found


def test_what_is_damaged_is_computed_again_or_said(searched, tmp_path):
    folder, found = searched
    shutil.copytree(folder, tmp_path / "cut")
    part = tmp_path / "cut" / "parts" / "0000002-0000002.parquet"
    part.write_bytes(part.read_bytes()[:200])
    assert optimisation.run(described(), tmp_path / "cut", **SMALL) == found
    (tmp_path / "cut" / "optimise.json").write_text("")
    with refuses("study.damaged", match=r"optimise\.json is missing or cannot be read"):
        optimisation.run(described(), tmp_path / "cut", **SMALL)


@pytest.mark.thorough
def test_what_the_plan_hardly_shows_is_said(searched, tmp_path):
    """Turns about x alone; what no such plan shows has no weight, so that the rest is named."""
    with pytest.raises(FoucaultError) as caught:
        optimisation.space_of(described(wanted='axes = "x"'))
    names = caught.value.message.split("that count: ")[1].split(". Allowed")[0].split(", ")
    weights = ", ".join(f'"{name}" = 0' for name in names)
    wanted = f'axes = "x"\nweights = {{ {weights} }}\nworst = 1e9'
    found = optimisation.run(described(wanted=wanted), tmp_path, **SMALL | {"restarts": 3})
    assert set(found.unseen) == set(names)
    assert not found.complete
    said = {item.code: item.message for item in found.findings}
    named = said["optimise.hardly"].split("under the plan found: ")[1].rstrip(".").split(", ")
    assert said["optimise.hardly"].startswith(f"{len(named)} of the coefficients that count keep")
    # x stays level; beside the Earth's rate nothing is commanded about y and z.
    assert {"accel.scale.x", "gyro.torquer_scale.y", "gyro.torquer_scale.z"} < set(named)
    assert not {"accel.scale.y", "accel.scale.z", "gyro.torquer_scale.x"} & set(named)
    # And all of them, by what a calibration of the campaign that was written would state.
    foreseen = optimisation.foresee(campaign.load(tmp_path / "campaign.toml"))
    left = {row["name"]: row["of_prior"] for row in foreseen.rows()}
    left = {name: left[name] for name in found.names if name not in names}
    assert not [name for name, share in left.items() if 0.45 < share < 0.55]
    assert set(named) == {name for name, share in left.items() if share > 0.5}
    assert "optimise.hardly" not in {item.code for item in searched[1].findings}


def test_the_plan_runs_unchanged(searched, tmp_path):
    folder, found = searched
    read = campaign.load(folder / "campaign.toml")
    session = simulate(read, 3)
    assert session.simulation.plan.duration == pytest.approx(found.duration) == 5400.0
    written = save_session(session, tmp_path / "session")
    result = campaign.calibrate(written)
    assert result.status == "converged"
    # The same cluster, but for 0.1 deg of the attitude at the start.
    sd = optimisation.space_of(described()).sd(session.simulation.plan, "cluster 3")
    np.testing.assert_allclose(result.coefficients.sd[:42], sd, rtol=0.03)


def test_a_procedure_without_plan_is_refused(tmp_path):
    with refuses("optimise.procedure", "hand_rotated"):
        optimisation.run(campaign.parse(campaign.template("hand_rotated")), tmp_path)
    with refuses("optimise.procedure"):
        campaign.parse(campaign.template("hand_rotated") + '\n[optimise]\naxes = "x"\n')
