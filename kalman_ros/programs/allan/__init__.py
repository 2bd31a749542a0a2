# SPDX-License-Identifier: Apache-2.0
"""Noise of an inertial sensor at rest, from a recording."""
