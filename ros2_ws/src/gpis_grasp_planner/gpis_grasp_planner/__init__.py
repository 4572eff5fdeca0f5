"""Grasp planning for multi-finger hands from CAD models (GPIS and Bayesian optimisation).

The core (everything but ``ros``) imports without ROS. Start reading at ``planner``.
"""

from pathlib import Path

from gpis_grasp_planner.thread_limits import limit_threads

__version__ = "0.2.0"

# Numba keys what it compiled by the path of the source; a workspace built with symbolic links has
# two paths to each, and would compile everything twice.
__path__ = [str(Path(__file__).resolve().parent)]

limit_threads()
