# SPDX-License-Identifier: Apache-2.0
"""The noise of an inertial sensor at rest, from a recording."""
