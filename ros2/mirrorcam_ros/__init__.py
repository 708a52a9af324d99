"""ROS 2 node of a MirrorCam."""
