"""Reading and writing: recordings, dataset folders, messages and files, as frames and results; never with ROS."""
