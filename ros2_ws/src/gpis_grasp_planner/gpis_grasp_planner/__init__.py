"""Grasp planning for multi-finger hands from CAD models (GPIS and Bayesian optimisation).

The core (everything but ``ros``) imports without ROS. Start reading at ``planner``.
"""

from gpis_grasp_planner.compiled_cache import select_cache

__version__ = "0.1.0"

select_cache()
