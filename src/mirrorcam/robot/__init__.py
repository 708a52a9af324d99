"""Bags for ROS, and the viewer."""
