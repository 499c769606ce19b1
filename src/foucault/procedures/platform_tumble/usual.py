"""Errors and noise that are usual of torqued clusters."""

from __future__ import annotations

from foucault import units
from foucault.models.cluster import CONSTANTS
from foucault.models.noise import ImuNoise, TriadNoise

TYPICAL = {
    "gyro.drift": ("1 deg/h", "0.2 deg/h"),
    "gyro.drift_input": ("0.5 deg/h/g", "0.1 deg/h/g"),
    "gyro.drift_output": ("0.5 deg/h/g", "0.1 deg/h/g"),
    "gyro.drift_spin": ("0.5 deg/h/g", "0.1 deg/h/g"),
    "gyro.drift_input_output": ("0.01 deg/h/g^2", "0.005 deg/h/g^2"),
    "gyro.drift_input_spin": ("0.01 deg/h/g^2", "0.005 deg/h/g^2"),
    "gyro.drift_output_spin": ("0.01 deg/h/g^2", "0.005 deg/h/g^2"),
    "gyro.torquer_scale": ("400 ppm", "50 ppm"),
    "gyro.misalignment": ("120 arcsec", "20 arcsec"),
    "accel.bias": ("100 ug", "10 ug"),
    "accel.scale": ("100 ppm", "10 ppm"),
    "accel.misalignment": ("120 arcsec", "20 arcsec"),
    "accel.quadratic": ("100 ug/g^2", "10 ug/g^2"),
}
"""Mean and sd of the errors of clusters, in the signs of `models.cluster.SOURCE_SYMBOLS`."""


def _kind(group: str) -> str:
    kind: str = CONSTANTS.coefficients[CONSTANTS.group(group)[0]].kind
    return kind


PRIOR = {group: (0.0, units.parse(mean, _kind(group))) for group, (mean, _) in TYPICAL.items()}
"""What is known of the errors where nothing else is said: zero, give or take their usual size."""

WHITE = ("0.4472136 ug/sqrt(Hz)", "3.72678e-05 deg/sqrt(h)")
"""White noise of accelerometers and gyros: 1 ug in samples of 0.2 s, and a drift of 0.05 deg/h in
samples of 2 ms."""

NOISE = ImuNoise(
    TriadNoise(white=units.parse(WHITE[0], "velocity random walk")),
    TriadNoise(white=units.parse(WHITE[1], "angle random walk")),
)
"""Noise that is simulated where [noise] says nothing."""
