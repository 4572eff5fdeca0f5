"""Start the grasp planner's node, and RViz where it is wanted.

ros2 launch gpis_grasp_planner grasp_planner.launch.py params_file:=my_cell.yaml rviz:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode, Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "gpis_grasp_planner"
ARGUMENTS = {
    "namespace": ("", "Namespace of the node and its topics."),
    "params_file": (
        PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "grasp_planner.yaml"]),
        "Parameters of the node.",
    ),
    "lifecycle": ("false", "Start the managed node, which waits for its transitions."),
    "rviz": ("false", "Start RViz with the package's configuration."),
    "fixed_frame": ("world", "RViz's fixed frame: that of the objects' poses, or one tf knows."),
    "log_level": ("info", "Level of the node's log."),
}


def generate_launch_description() -> LaunchDescription:
    """Make the description that `ros2 launch` runs."""
    chosen = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    of_node = {
        "package": PACKAGE,
        "name": "grasp_planner",
        "namespace": chosen["namespace"],
        "parameters": [chosen["params_file"]],
        "arguments": ["--ros-args", "--log-level", chosen["log_level"]],
        "output": "screen",
    }
    rviz_file = PathJoinSubstitution([FindPackageShare(PACKAGE), "rviz", "grasp.rviz"])
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            Node(
                executable="grasp_planner_node",
                condition=UnlessCondition(chosen["lifecycle"]),
                **of_node,
            ),
            LifecycleNode(
                executable="grasp_planner_lifecycle_node",
                condition=IfCondition(chosen["lifecycle"]),
                **of_node,
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=chosen["namespace"],
                arguments=["-d", rviz_file, "-f", chosen["fixed_frame"]],
                condition=IfCondition(chosen["rviz"]),
            ),
        ]
    )
