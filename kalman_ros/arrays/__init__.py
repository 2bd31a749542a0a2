# SPDX-License-Identifier: Apache-2.0
"""Arrays in, arrays out: what ``import kalman_ros as kr`` offers to notebooks and scripts.

No ROS is needed. What people type is checked and converted here, in one place (`accept`); the work
is done by the same objects as in the nodes.
"""
