# SPDX-License-Identifier: Apache-2.0
"""The program `doctor`: faults of a recording and of its parameters, with their proof."""
