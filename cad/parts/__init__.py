"""The other printed parts: mount, camera clip, adapter for the robot, fit coupon."""
