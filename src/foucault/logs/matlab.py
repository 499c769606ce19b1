"""MATLAB files: version 4 to 7 (binary) and ASCII."""

from __future__ import annotations

import gzip
import math
import mmap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.errors import error
from foucault.logs import delimited
from foucault.logs.encoding import is_text, not_a_bomb, open_bytes
from foucault.logs.numpy_arrays import from_arrays
from foucault.logs.raw import Progress, RawTable, must_fit

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a .mat file; one saved with -ascii is read as text."""
    with open_bytes(path) as stream:
        start = stream.read(4096)
    if start[:10] == b"MATLAB 7.3":
        raise error("log.matlab_73", file=path.name)
    if start[:6] != b"MATLAB" and is_text(start):
        return delimited.open_raw(path, description, progress)
    from scipy.io import loadmat, whosmat

    with open_bytes(path) as stream:
        source: Any = stream  # the stubs know only paths, scipy also takes streams
        if not isinstance(source, gzip.GzipFile):  # gives what there is, not room for any claim
            source = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        claimed = sum(8.0 * math.prod(shape) for _, shape, _ in whosmat(source))
        not_a_bomb(claimed, path.stat().st_size)
        must_fit(path, claimed)
        source.seek(0)
        wanted = None if description.variable is None else [description.variable]
        contents = loadmat(source, variable_names=wanted)
        if wanted and wanted[0] not in contents:  # read again to tell which names there are
            source.seek(0)
            contents = loadmat(source)
    arrays = {
        name: value
        for name, value in contents.items()
        if not name.startswith("__") and isinstance(value, np.ndarray) and value.dtype.names is None
    }
    return from_arrays(path, arrays, description.variable, progress)
