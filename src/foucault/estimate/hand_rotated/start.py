"""Where the likelihood of a session starts: linear and one-step solutions, in order.

The norm gives the accelerometers, the rests the gyro bias, the published cost the gyro matrix,
dead reckoning the headings up to one, and the Earth's rotation that one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.estimate import norm_observation
from foucault.estimate.hand_rotated.published import fit_directions
from foucault.models.imu import ImuModel
from foucault.models.rests_and_turns import Attitudes, Session, predict
from foucault.models.rotation import aligning, exp


def first_guess(session: Session, fixed: ImuModel | None = None) -> Attitudes | None:
    """Return a state to start from, or None where the rests do not determine the norm.

    Linear norm observation for the accelerometers, the mean of the rests for the gyro bias, the
    published cost for the gyro matrix, dead reckoning between rests for heading, and a linear
    fit of the Earth's rotation for the heading of the first.

    `fixed` or None: start from these accelerometer errors instead (for instance a prior).
    """
    if fixed is None:
        solved = norm_observation.solve(session.accel_mean, session.site.gravity)
        if solved is None:
            return None
        model = ImuModel(accel_matrix=solved[0], accel_bias=solved[1])
    else:
        model = fixed
    f_b, _ = model.compensate(session.accel_mean, None)
    assert f_b is not None
    up_b = f_b / np.linalg.norm(f_b, axis=1)[:, None]
    z = np.array([0.0, 0.0, 1.0])
    if session.gyro_mean is None:
        return Attitudes(model, np.stack([aligning(u, z) for u in up_b]))
    weight = session.rest_time / session.rest_time.sum()
    model = replace(model, gyro_bias=weight @ session.gyro_mean)
    turns = (session.last[:-1] - 1, session.first[1:])
    model = fit_directions(session.log, up_b, *turns, model, max_iterations=4).state
    C_nb = np.empty((len(up_b), 3, 3))
    C_nb[0] = aligning(up_b[0], z)
    guess = Attitudes(model, np.broadcast_to(np.eye(3), C_nb.shape))
    C_se = predict(session, (), guess, np.ones(3)).C_se
    for j, C in enumerate(C_se):
        reached = C_nb[j] @ C
        C_nb[j + 1] = aligning(reached @ up_b[j + 1], z) @ reached
    return _with_heading(session, Attitudes(model, C_nb))


def _with_heading(session: Session, state: Attitudes) -> Attitudes:
    """Turn all attitudes about up so that the gyro means at rest see the Earth's rotation."""
    if session.site.latitude is None or session.gyro_mean is None:
        return state
    _, north, up = session.earth @ np.eye(3)
    # Horizontal Earth rate after a turn by psi about up: north (-sin psi, cos psi); linear in
    # cos and sin, and in the gyro bias.
    C_bn = np.swapaxes(state.C_nb, 1, 2)
    scale = state.model.gyro_matrix
    rows = np.concatenate(
        [
            np.broadcast_to(np.eye(3), C_bn.shape),
            (scale @ C_bn)[:, :, 1:2] * north,
            (scale @ C_bn)[:, :, 0:1] * north,
        ],
        axis=2,
    ).reshape(-1, 5)
    known = session.gyro_mean - (scale @ C_bn)[:, :, 2] * up
    x, *_ = np.linalg.lstsq(rows, known.ravel(), rcond=None)
    psi = np.arctan2(-x[4], x[3])
    turn = exp(np.array([0.0, 0.0, -psi]))
    return Attitudes(replace(state.model, gyro_bias=x[:3]), turn @ state.C_nb)
