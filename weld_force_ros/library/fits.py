"""Tell users of the library that a fit has to be made, which takes a while."""

import logging

_LOG = logging.getLogger("weld_force_ros")


def announce(line: str) -> None:
    """Log what is fitted and how long it takes; shown by default, silenced as any logger of Python is."""
    _LOG.warning(line)
