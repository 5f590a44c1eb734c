"""The node of ROS 2: see `phasestereo_ros.node`."""
