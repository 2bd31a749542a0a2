# SPDX-License-Identifier: Apache-2.0
"""Translation of the parameter files of robot_localization."""
