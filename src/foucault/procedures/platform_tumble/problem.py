"""From the log of a tumble and what was said of it to what the estimator takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.tumble import input as tumble_input
from foucault.errors import Finding, error, finding
from foucault.estimate.tumble.fit import Prior, State, Tumble
from foucault.models import cluster
from foucault.models.cluster import CONSTANTS, LAYOUT, attitude_of
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures.platform_tumble.settings import NOISE, PRIOR, Settings
from foucault.tables import Log

WANDER = 0.01
"""Share of the variance of an average that wandering within it may add [1]."""

COARSE = np.radians(5.0)
"""Over an average the cluster turns less than this, where its slopes are taken at the middle [rad].
"""


def noise_of(log: Log, noise: ImuNoise | None) -> tuple[ImuNoise, list[Finding]]:
    """Return the noise, and where it comes from where it was not declared.

    `log`: command and readings [SI]; `noise` or None: noise as declared [SI].
    """
    told = []
    accel, gyro = (TriadNoise(), TriadNoise()) if noise is None else (noise.accel, noise.gyro)
    if not accel.white > 0:
        white = tumble_input.measured_white(log)
        accel = replace(accel, white=white)
        told.append(finding("tumble.measured", given=f"{white / 9.80665e-6:.3g}"))
    if not gyro.white > 0:
        gyro = replace(gyro, white=NOISE.gyro.white)
        given = np.degrees(gyro.white) * 60.0
        told.append(finding("tumble.noise", given=f"{given:.3g}"))
    if is_slow(accel) or is_slow(gyro):
        told.append(finding("tumble.slow_noise"))
    else:
        told.append(finding("tumble.white", minutes=f"{log.duration / 60:.0f}"))
    return ImuNoise(accel, gyro), told


def is_slow(noise: TriadNoise) -> bool:
    """Whether a noise has more than a white part."""
    return noise.bias_instability > 0 or noise.random_walk > 0


def tumble_of(
    log: Log, site: Site, settings: Settings, noise: ImuNoise
) -> tuple[Tumble, list[Finding]]:
    """Turn rows into intervals, and choose how many are averaged.

    `log`: command and readings [SI]; `noise`: noise [SI].
    """
    assert log.gyro is not None and log.accel is not None and site.latitude is not None
    command = log.gyro[:-1] if settings.held(log.sampled) == "from its time" else log.gyro[1:]
    reading = log.accel[1:] / site.gravity
    out = tumble_input.outlying(log, noise.accel.white / np.sqrt(log.interval))
    used: npt.NDArray[np.bool_] = np.asarray(np.isfinite(reading).all(axis=1)) & ~out[1:]
    if settings.mask_edges:
        used &= ~tumble_input.edges(log.time, command, settings.mask_edges)
    if int(used.sum()) <= len(LAYOUT):
        raise error("tumble.too_short", given=int(used.sum()), wanted=len(LAYOUT))
    interval = log.interval
    summed, psd = log.sampled == "increment", noise.gyro.white**2
    variance = noise.accel.white**2 / interval / site.gravity**2
    rounded = noise.accel.quantisation**2 / 12 / site.gravity**2
    if summed:  # attitude wanders within the mean
        variance += psd * interval / 12
    else:
        variance += rounded
    block, told = _block(settings.average, interval, command, psd, variance)
    shared = 0.0
    if summed and rounded:  # it is carried on: it counts at both ends of an average
        variance += 2 * rounded / block
        shared = -rounded / block / variance
    tumble = Tumble(
        dt=np.diff(log.time),
        command=np.ascontiguousarray(command),
        reading=np.where(used[:, None], reading, 0.0),
        used=used,
        w_ie_n=earth_rate_n(site.latitude),
        gravity=site.gravity,
        gyro_psd=psd,
        accel_variance=variance,
        arms=settings.lever_arms,
        mean=summed,
        block=block,
        shared=shared,
    )
    if out.any():
        told.append(finding(
            "tumble.outliers", count=int(out.sum()), share=f"{100 * out.mean():.2g}",
            time=f"{log.time[np.argmax(out)]:.6g}",
        ))  # fmt: skip
    masked = np.flatnonzero(~np.isfinite(log.accel).all(axis=1))
    if len(masked):
        told.append(finding("tumble.masked", count=len(masked), time=f"{log.time[masked[0]]:.6g}"))
    return tumble, told


def _block(
    average: float, interval: float, command: FloatArray, psd: float, variance: float
) -> tuple[int, list[Finding]]:
    """Choose how many readings are averaged to one residual."""
    block = max(1, round(average / interval))
    speed = float(np.linalg.norm(command, axis=1).max())
    far = max(1, int(COARSE / (speed * interval)))
    # Within an average of time T the attitude wanders by psd T / 12.
    calm = max(1, int(np.sqrt(12 * WANDER * variance / max(psd * interval, 1e-300))))
    if block <= min(far, calm):
        return block, []
    why = f"the cluster turns by {np.degrees(speed * block * interval):.3g} deg"
    if calm < far:
        why = "noise of the gyros turns it by more than the readings scatter"
    block = min(far, calm)
    given = f"{block * interval:.4g}"
    return block, [finding("tumble.average", asked=f"{average:.4g}", why=why, given=given)]


def prior_of(settings: Settings, site: Site, given: Mapping[str, tuple[float, float]]) -> Prior:
    """Return what is known beforehand, in the units of the kernels.

    `given`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    known = CoefficientVector.prior(CONSTANTS, {**PRIOR, **given})
    factor = cluster.normalised(site.gravity)
    sd = np.concatenate(
        [
            [settings.start_sd, settings.start_sd, settings.azimuth_sd],
            known.prior_sd * factor,
            [settings.delay_sd],
        ]
    )
    start = attitude_of(settings.angles).T
    return Prior(State(start, known.values * factor), sd)


def shifted(tumble: Tumble, prior: Prior, rows: int) -> tuple[Tumble, Prior]:
    """Return log and prior as if each reading had come `rows` intervals later.

    `prior`: what is known beforehand, of the delay too; `rows`: whole intervals of the delay,
    which readings are put back by [1].
    """
    order = np.arange(len(tumble.dt)) + rows
    there = (order >= 0) & (order < len(order))
    order = np.clip(order, 0, len(order) - 1)
    late = rows * float(np.median(tumble.dt))
    back = replace(tumble, reading=tumble.reading[order], used=tumble.used[order] & there)
    return back, replace(prior, mean=replace(prior.mean, delay=prior.mean.delay - late))
