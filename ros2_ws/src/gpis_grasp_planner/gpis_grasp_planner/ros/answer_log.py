"""A line of the log for each answer, without the cost of rclpy's way to log.

For every line rclpy looks for its caller in the stack and in the source files, which takes longer
than to refuse a request.
"""

from __future__ import annotations

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import LoggingSeverity

_INFO = LoggingSeverity.INFO
_FUNCTION, _LINE = "log_info", 1


def log_info(log: RcutilsLogger, text: str) -> None:
    """Log a line of the severity INFO; console, file and ``/rosout`` as for any other.

    Parameters
    ----------
    log : RcutilsLogger
    text : str
    """
    if log.is_enabled_for(_INFO):
        rclpy_implementation.rclpy_logging_rcutils_log(
            _INFO, log.name, text, _FUNCTION, __file__, _LINE
        )
