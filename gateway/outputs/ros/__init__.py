"""Messages of ROS 2: their bytes, and the keys where a ROS 2 system looks for them."""
