"""Gravity given without its uncertainty: in the covariance and the budget of every procedure."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import make_guard
from foucault import campaign
from foucault.diagnose.comparable import gravity_errors
from foucault.models import earth

G = earth.gravity(make_guard.LATITUDE, 60.0)
QUICK = ["hand_rotated", "hand_rotated_published", "six_position", "ferraris", "norm_observation",
         "turntable", "multi_position"]  # fmt: skip
SLOW = ["systematic", "platform_tumble", "transfer_alignment"]


def calibrated(name, **site):
    """Calibrate the session of a procedure, or that of its like."""
    like = {"hand_rotated_published": "hand_rotated", "multi_position": "turntable"}
    made = make_guard.session(like.get(name, name))
    made = made.with_keys(site={"gravity": f"{G} m/s^2", **site})
    if name in like:
        keys = {"spin_rate": "30 deg/s"}
        if name == "hand_rotated_published":
            keys = {"initial_rest": "2 s", "samples_per_rest": 40}
        text = made.text[: made.text.index("[procedure]")]
        rest = made.text[made.text.index("[procedure]") :]
        after = rest[rest.find("\n[") :] if "\n[" in rest else ""
        lines = "".join(f"{key} = {value!r}\n" for key, value in keys.items())
        made = make_guard.replace(made, text=f'{text}[procedure]\nname = "{name}"\n{lines}{after}')
    with TemporaryDirectory() as folder:
        return campaign.calibrate(made.write(Path(folder)))


@pytest.mark.thorough
@pytest.mark.parametrize("name", QUICK + SLOW)
def test_gravity_without_its_sd_is_in_covariance_and_budget(name):
    exact = calibrated(name, gravity_sd="0 m/s^2").coefficients
    result = calibrated(name)
    unsure = result.coefficients
    added = unsure.cov - exact.cov
    assert result.site["gravity_sd"] == pytest.approx(earth.NORMAL_GRAVITY_SD)
    share = earth.NORMAL_GRAVITY_SD / G
    where = [n for n in unsure.names if n.startswith("accel.scale.")]
    if where:  # a flight near level ties gravity to a bias
        at = [unsure.layout.index(n) for n in where]
        assert np.allclose(added[np.ix_(at, at)], share**2, rtol=0.1)
    else:
        assert np.trace(added) > 0
    ((_, error),) = gravity_errors(result, unsure).items()
    assert np.allclose(np.outer(error, error), added, atol=0.05 * np.abs(added).max())
