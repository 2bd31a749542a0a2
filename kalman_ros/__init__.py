# SPDX-License-Identifier: Apache-2.0
"""State estimation and optimal control for ROS 2: any model, any topic."""

__version__ = '0.1.0'
