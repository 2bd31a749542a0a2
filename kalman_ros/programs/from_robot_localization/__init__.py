# SPDX-License-Identifier: Apache-2.0
"""Parameter files from those of robot_localization."""
