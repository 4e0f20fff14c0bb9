"""The method on arrays, a module for each section of the paper; it imports neither readers nor ROS."""
