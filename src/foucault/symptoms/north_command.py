"""What can go wrong with what is said beside the readings of a north seeker."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("north.folder", "error",
     "A folder that holds a calibration",
     "'{folder}' holds the result of a calibration; its report would be overwritten.",
     "Give another folder."),
    ("north.other_campaign", "error",
     "A campaign of something else",
     "'{file}' is a campaign of {given}, not of a north seeker.",
     'Write [procedure] name = "north_seeking", or give the file of readings itself.'),
    ("north.reads_declared", "error",
     "A sign of the accelerometer stated twice",
     "--accel-reads was given with the campaign file '{file}', which states it in [log.accel].",
     "Leave the option out, or correct `reads` there."),
    ("north.latitude_both", "error",
     "A latitude given and unknown",
     "{given} and --unknown-latitude contradict one another.",
     "Leave one of them out; a rough latitude is --latitude with --latitude-sd."),
    ("north.fix_gravity", "error",
     "Neither latitude nor gravity",
     "The latitude is to be estimated and gravity is not known, so the accelerometers have no "
     "scale.",
     'Give --gravity "9.81 m/s^2", or in a campaign file gravity in [site].'),
    ("north.noise_half", "error",
     "Noise of one sensor only",
     "The noise of the {given} is given, that of the {missing} is not.",
     "Give both, --gyro-noise and --accel-noise, or neither: left out, it is measured or taken "
     "from the calibration."),
    ("north.whose", "note",
     "Readings that do not say of which instrument they are",
     "The calibration is of instrument {serial}; the readings name none.",
     "Give --serial, or serial in [instrument] of the campaign, so that mistakes are noticed."),
)
# fmt: on
