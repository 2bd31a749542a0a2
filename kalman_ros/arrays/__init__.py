# SPDX-License-Identifier: Apache-2.0
"""Arrays in, arrays out: what ``import kalman_ros as kr`` offers to notebooks and scripts.

No ROS is needed. User input is checked and converted here, in one place (`accept`); the
computation uses the same objects as the nodes.
"""
