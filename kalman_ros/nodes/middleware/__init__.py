# SPDX-License-Identifier: Apache-2.0
"""What all nodes have in common between their objects and rclpy."""
