"""From the sensor's plug to a log: sources of bytes, frames described as data, recordings."""
