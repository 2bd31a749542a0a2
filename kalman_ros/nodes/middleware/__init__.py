# SPDX-License-Identifier: Apache-2.0
"""The layer between the objects of all nodes and rclpy."""
