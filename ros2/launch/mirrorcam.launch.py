"""Starts the node: ros2 launch mirrorcam_ros mirrorcam.launch.py layout:=layout.json device:=0"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "layout": (str, None, "layout.json of mirrorcam calibrate"),
    "device": (
        str,
        "0",
        "number of the camera, /dev/videoN, or an address, such as rtsp://HOST/PATH",
    ),
    "depth": (bool, "true", "whether depth and points are published while there are subscribers"),
    "near_mm": (float, "0.0", "minimum depth that is searched, 0: 0.6 times the reference depth"),
    "far_mm": (float, "0.0", "maximum depth that is searched, 0: 2 times the reference depth"),
    "width_px": (int, "0", "width of every view, 0: the resolution of the frame"),
    "reference_depth_mm": (float, "0.0", "depth of zero disparity, 0: the layout's"),
}


def generate_launch_description():
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (_, default, text) in ARGUMENTS.items()
    ]
    parameters = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, (kind, _, _) in ARGUMENTS.items()
    }
    node = Node(
        package="mirrorcam_ros",
        executable="light_field",
        namespace="mirrorcam",
        output="screen",
        parameters=[parameters],
    )
    return LaunchDescription([*declared, node])
