"""What the report of a north seeker's calibration shows beside its checks."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate.north.attitude import Known, solve
from foucault.estimate.north.calibration import Rig, tilts
from foucault.estimate.north.reduction import Pairs
from foucault.infer.mixed import Fit, HeldOut, causes
from foucault.models.dwells import Dwells
from foucault.models.north_seeker import Compensation
from foucault.models.rotation import turned


def table_json(fit: Fit, rig: Rig) -> dict[str, Any]:
    """Return what was found of the turntable, for result.json."""
    tilt = fit.state[len(fit.model.layout) :]
    east, north = tilt if len(tilt) else (0.0, 0.0)
    return {
        "used": rig.tilt,
        "tilt_about_east": float(east),
        "tilt_about_north": float(north),
        "heading_sd": rig.heading_sd,
        "heading_offset_sd": rig.heading_offset_sd,
    }


def unseen(rig: Rig, names: tuple[str, ...]) -> list[str]:
    """Say what the session cannot show in principle."""
    common = "it was taken as exact"
    if rig.heading_offset_sd:
        sd = np.degrees(rig.heading_offset_sd) * 60
        common = f"its standard uncertainty, {sd:.3g} arcmin, is part of every coupling"
    out = [
        f"An error that all reference headings share goes straight into every later heading; "
        f"{common}.",
        "A wrong latitude: 1 arcmin is "
        f"{np.tan(abs(rig.site.latitude or 0.0)) * np.radians(1 / 60) * 1e6:.0f} ppm in both "
        "scale factors.",
        "The gyro's constant offset, which every fix finds anew.",
        "Other index angles than those used, and other temperatures.",
    ]
    if "gyro.misalignment.xz" not in names:
        out.append(
            "Coupling of the rate along the axis of the base: 0.001 of it moves the heading by "
            "about 0.06 deg times the tangent of latitude, different at other tilts."
        )
    if rig.tilt == "each" and not rig.level_sd:
        out.append(
            "A table whose axis leans: tilted by 10 deg, 1 arcmin of it turns the headings by 11 "
            "arcsec. `level_sd` puts it into the uncertainty."
        )
    if rig.tilt == "one axis":
        out.append("Scale factor of the accelerometers: 200 ppm are 7 arcsec of tilt at 10 deg.")
    return out


def circle_accuracy(errors: FloatArray) -> dict[str, float]:
    """Return the usual figures of heading errors around the circle, for result.json.

    `errors` (m,): heading as found minus reference [rad]. Returns "std" about the mean, "max"
    departure from the mean, "peak_to_peak", and "rms" and "max_absolute" with the mean in [rad].
    """
    off = errors - errors.mean()
    return {
        "std": float(np.std(errors, ddof=1)) if len(errors) > 1 else 0.0,
        "max": float(np.abs(off).max()),
        "peak_to_peak": float(np.ptp(errors)),
        "mean": float(errors.mean()),
        "rms": float(np.sqrt(np.mean(errors**2))),
        "max_absolute": float(np.abs(errors).max()),
    }


def heading_errors(
    pairs: Pairs, rig: Rig, coefficients: CoefficientVector | None
) -> tuple[FloatArray, FloatArray]:
    """Return heading minus reference and its sd, as a fix in each set-up would have them.

    `pairs`: set-ups [SI]; `coefficients`: the calibration, None for the instrument as it is.
    Returns `errors`, `sd` (m,): [rad].
    """
    level = None if rig.accelerometers else max(rig.level_sd, 1e-9)
    known = Known(rig.site.gravity, rig.site.latitude, rig.latitude_sd, level_sd=level)
    found = solve(pairs, known, Compensation() if coefficients is None else Compensation(
        coefficients))  # fmt: skip
    return turned(found.angles[:, 0] - rig.heading), found.sd[:, 0]


def heading_table(
    fit: Fit, pairs: Pairs, rig: Rig, dwells: Dwells, apart: HeldOut
) -> dict[str, npt.NDArray[Any]]:
    """Return a row per set-up: readings, what is left of them, and tilt.

    `pairs`: set-ups [SI]; `apart`: every set-up predicted from the others.
    """
    left = fit.at.residuals.copy()
    for source in fit.at.sources:
        if source.shared is not None:
            left -= source.shared @ causes(fit, source.name)
    standard = apart.error / apart.sd
    lean = tilts(pairs, rig.site.gravity, Compensation()) if rig.accelerometers else None
    nothing = np.full(len(pairs), np.nan)
    before, _ = heading_errors(pairs, rig, None)
    after, sd = heading_errors(pairs, rig, fit.estimate.coefficients)
    return {
        "setup": np.array(dwells.names),
        "heading": rig.heading,
        "gyro_x": pairs.values[:, 0],
        "gyro_y": pairs.values[:, 1],
        "left_x": left[:, 0],
        "left_y": left[:, 1],
        "residual_x": standard[:, 0],
        "residual_y": standard[:, 1],
        "offset": pairs.offset,
        "heading_before": before,
        "heading_after": after,
        "heading_sd": sd,
        "pitch": nothing if lean is None else lean[:, 0],
        "roll": nothing if lean is None else lean[:, 1],
    }
