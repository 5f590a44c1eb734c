"""In the place of ``stereo_image_proc.launch.py``: the same topics below a namespace.

ros2 launch phasestereo_ros phasestereo.launch.py namespace:=stereo params:=stereo.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return the node, with a file of parameters if there is one."""
    namespace, params = LaunchConfiguration("namespace"), LaunchConfiguration("params")
    given = PythonExpression(["'", params, "' != ''"])
    node = {"package": "phasestereo_ros", "executable": "phasestereo_node", "namespace": namespace}
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value=""),
            DeclareLaunchArgument("params", default_value=""),
            Node(**node, parameters=[params], condition=IfCondition(given)),
            Node(**node, condition=UnlessCondition(given)),
        ]
    )
