"""Detection without a ROS graph: all frames of a recording, in parallel where that is asked for."""
