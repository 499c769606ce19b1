"""Files of any format into the one log table, and that table into files.

``read(LogDescription(...), folder)`` reads what a campaign's ``[log]`` block describes;
``write(log, path)`` writes a file that needs no description.
"""

from foucault.logs.description import LogDescription
from foucault.logs.own import write
from foucault.logs.reading import by_serial, read

__all__ = ["LogDescription", "by_serial", "read", "write"]
