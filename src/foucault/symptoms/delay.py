"""What can go wrong where the time offset of two logs is looked for."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("delay.apart", "error",
     "Two logs without common time",
     "{slave} lasts from {first} s to {last} s, {master} from {start} s to {end} s: with offsets "
     "{bracket} they have fewer than {least} intervals in common.",
     'Widen --bracket "-5 s to 5 s", or write --bracket any to try every offset at which they '
     "overlap."),
    ("delay.bracket", "error",
     "A bracket that is none",
     'The bracket "{given}" does not say between which offsets to look.',
     'Write --bracket "-0.5 s to 0.5 s", or --bracket any.'),
    ("delay.mounting_given", "error",
     "A mounting that is none",
     'The mounting "{given}" does not say heading, pitch and roll.',
     'Write three angles, such as --mounting "90 deg, 0 deg, 0 deg", or leave it out.'),
    ("delay.no_second", "error",
     "One log where two are needed",
     "{file} describes one log only.",
     "Give the second log, or describe the master in [master] of the campaign."),
    ("delay.same_log", "error",
     "One log given twice where two are needed",
     "{file} is given twice: a log has no offset from itself.",
     "Give the log of the other instrument on the same body."),
    ("delay.no_gyro", "error",
     "A log without gyros where an offset is looked for",
     "{file} has no gyros: the offset is found by what both turn.",
     "Give logs that hold angular rates, or attitudes of a master."),
    ("delay.unlike", "warning",
     "Two logs that do not turn alike",
     "Of what the slave turned the master has {part} only, at the best of all offsets tried: the "
     "delay means nothing.",
     "Check that both are of the same run and on the same body, their units, and with --bracket "
     "any whether the clocks are farther apart."),
    ("delay.not_seen", "warning",
     "An offset that the motion does not show",
     "The delay is seen to {sd} ms only: the rates of turning change by {rate} deg/s (root mean "
     "square) and the logs differ by {noise} deg/s.",
     "Turn more quickly to and fro, about any axis: some seconds of rocking by hand or one S-turn "
     "show a delay; a steady turn or a straight run does not."),
    ("delay.edge", "warning",
     "An offset at the edge of where it was looked for",
     "The best offset, {delay} ms, is at the edge of the bracket from {low} s to {high} s, or "
     "beyond.{more}",
     'Widen --bracket "-5 s to 5 s", or write --bracket any.'),
    ("delay.rivals", "warning",
     "Motion that repeats itself",
     "Offsets of {others} ms fit nearly as well as {delay} ms: the motion repeats itself.",
     "Narrow --bracket to what is possible, or let the motion differ from one period to the next."),
    ("delay.validity", "warning",
     "A delay near zero",
     "The delay is {delay} ± {sd} ms: as far as can be told the master's messages are stamped when "
     "they hold, not when they arrive.",
     "If they are, no delay has to be taken out. If messages arrive tens of milliseconds late, "
     "something has shifted the stamps already."),
    ("delay.negative", "warning",
     "A negative delay",
     "The delay is {delay} ± {sd} ms: what the master says is of a time after its stamp.",
     "A message cannot arrive before it is made: the stamps are of the master's own clock and it "
     "is behind, the master predicts, or the slave's stamps are late."),
    ("delay.drift", "warning",
     "Clocks that drift apart",
     "The delay changes by {rate} ± {sd} ppm, from {first} ms at the start to {last} ms at the "
     "end: the two clocks go differently.",
     "Take the drift out of the stamps, or stamp both by one clock. The delay given holds at "
     "{middle} s."),
    ("delay.wanders", "warning",
     "A delay that does not stay",
     "In the parts of the log the delay is {parts} ms (± {sds}): it jumps or wanders.",
     "Look for a restart, for stamps that are given when a buffer is read, or for a clock that was "
     "set during the log."),
    ("delay.wild", "warning",
     "Turns that no body makes",
     "{count} turns of the master are not of this body and were left out, the largest of {size} "
     "deg at {time} s.",
     "A heading that was averaged or interpolated across its wrap looks like this, and so does a "
     "master that was set anew."),
    ("delay.sense", "warning",
     "An angle that counts the other way",
     "The two turn alike if the {what} of the master is reversed: {reversed} of the turning is "
     "then in both, as it is {part}.",
     'Describe the attitude with sense = "counter-clockwise" (or "clockwise") where it is the '
     'heading, with "-pitch" or "-roll" else. Without --mounting nothing tells one from another.'),
    ("delay.mirror", "warning",
     "Two logs that are mirror images",
     "The two turn alike if the {what} axis of the second is reversed: {reversed} of the turning "
     "is then in both, as it is {part}.",
     "One gyro has the wrong sign, or two columns are exchanged, in one of the logs: check the "
     "axes with `foucault inspect`. Without --mounting nothing tells one axis from another."),
    ("delay.axes", "warning",
     "A mounting other than was said",
     "The slave is mounted {angle} deg off what was given: its right, forward, up lie along {axes} "
     "of the master.",
     "Correct the mounting; where axes look exchanged one log may be forward, right, down."),
    ("delay.north_east_down", "note",
     "Axes that look like forward, right, down",
     "The slave's right, forward, up lie along {axes} of the master: one of the two seems to be "
     "in forward, right, down.",
     "Nothing for the delay. For anything else exchange the columns: x = right, y = forward, z = "
     "up; or the master's heading counts the other way, where it turned about up alone."),
    ("delay.mounting", "note",
     "A mounting that the motion does not show",
     "The mounting about {axis} of the slave is known to {sd} deg only; the delay is not touched.",
     "Turn about a second axis."),
    ("delay.scale", "warning",
     "One log that turns more than the other",
     "The slave turns {ratio} times as much as the master.{hint}",
     "Check the units of both: deg and rad, rates and increments, counts."),
    ("delay.earth", "note",
     "A bias that holds the Earth's rate",
     "The master says no latitude: its turning is that against the ground, and the bias found "
     "holds up to 15 deg/h of the Earth's.",
     "Nothing for the delay. Describe the master's latitude and longitude to have the bias."),
)
# fmt: on
