"""Light fields for robots: ROS 2 bags, and a viewer."""
