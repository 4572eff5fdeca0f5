"""Grasp planning for multi-finger hands from CAD models (GPIS and Bayesian optimisation).

The core (everything but ``ros``) imports without ROS. Start reading at ``planning``.
"""

__version__ = "0.1.0"
