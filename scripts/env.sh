# To be sourced (bash or zsh): the environment in which the workspace runs.
#
#   source scripts/env.sh
#   python -m gpis_grasp_planner.ros.node        # or grasp_planner_node, gpis-grasp, colcon ...
#
# ROS 2 comes from wheels: the virtual environment itself is the ament prefix, and
# ros2_ws/install lies over it. On a machine with a ROS 2 Jazzy of its own nothing of this is
# needed: source /opt/ros/jazzy/setup.bash and build ros2_ws with colcon as usual.

_gpis_root=$(cd "$(dirname "${BASH_SOURCE[0]:-$0}")/.." && pwd)
export VIRTUAL_ENV="$_gpis_root/.venv"
case ":$PATH:" in
*":$VIRTUAL_ENV/bin:"*) ;;
*) export PATH="$VIRTUAL_ENV/bin:$PATH" ;;
esac
unset PYTHONHOME
export AMENT_PREFIX_PATH="$VIRTUAL_ENV"
export CMAKE_PREFIX_PATH="$VIRTUAL_ENV"

# Its own local_setup, not setup: that one would look for a local_setup in the virtual environment.
# colcon's script reads variables that may be unset; the caller's `set -u` must survive it.
_gpis_options=$-
set +u
if [ -n "${ZSH_VERSION:-}" ]; then
    _gpis_setup="$_gpis_root/ros2_ws/install/local_setup.zsh"
else
    _gpis_setup="$_gpis_root/ros2_ws/install/local_setup.bash"
fi
if [ -f "$_gpis_setup" ]; then
    . "$_gpis_setup"
else
    echo "scripts/env.sh: ros2_ws is not built yet (run: make setup)" >&2
fi
case $_gpis_options in *u*) set -u ;; esac
unset _gpis_root _gpis_options _gpis_setup
