# SPDX-License-Identifier: Apache-2.0
"""The markers: a loop drawn for RViz and other viewers."""
