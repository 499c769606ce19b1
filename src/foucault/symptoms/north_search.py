"""What can go wrong when an order of stops of a north seeker is searched."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("north_search.too_short", "error",
     "A set-up too short for two stops",
     "A set-up of {given} has no time for two stops of {stop} and the move between them: {least}.",
     "Give more time in [optimise], a shorter `shortest` in [procedure], or a quicker `move` in "
     "[simulate]."),
    ("north_search.noise", "error",
     "A search for stops without the noise of the gyro",
     "[noise] does not say how noisy the gyro is, and the best order of stops depends on it.",
     'Write [noise.gyro] with white = "0.003 deg/sqrt(h)" and, if it is known, bias_instability '
     "and random_walk, and [noise.accel], whose noise else is zero. `foucault allan` measures "
     "them."),
    ("north_search.latitude", "error",
     "A search for stops from north at an unknown latitude",
     "Stops that count from a rough north show one direction, and that is a heading only where the "
     "latitude is known.",
     "Leave rough_sd or unknown_latitude out, and give latitude in [site]."),
    ("preflight.gyro_noise", "note",
     "A preflight of a north seeker without the noise of the gyro",
     "[noise] does not say how noisy gyro and accelerometers are, which a calibration measures in "
     "the readings; {given} were taken, as is typical of a gyro of navigation grade.",
     "Give it in [noise] if it is known: uncertainties depend on it."),
    ("preflight.accel_noise", "warning",
     "A plan of a north seeker judged without noise of its accelerometers",
     "[noise] does not say how noisy the accelerometers are: they were taken to have no noise.",
     'Write [noise.accel] with white = "5 ug/sqrt(Hz)", or what they have. Without it, their '
     "uncertainties are too small, those of a calibration too."),
    ("preflight.level", "note",
     "A level session, which does not show all couplings",
     "A level table does not show {names}: they will be known as well as `z_coupling_sd` says, and "
     "what they do at other tilts is part of every later uncertainty.",
     'Go through the headings tilted too, tilts = ["0 deg", "10 deg"], or write z_coupling = "no" '
     "where the case will stand level."),
    ("preflight.heading", "note",
     "What a calibration that is planned will give in the field",
     "With this calibration {time} of the same stops give the heading to {sd} deg (1 sd); with a "
     "perfect one to {perfect} deg.",
     "Nothing to do; longer stops than in the field make the calibration count less."),
)
# fmt: on
