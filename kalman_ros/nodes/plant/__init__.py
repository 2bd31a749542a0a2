# SPDX-License-Identifier: Apache-2.0
"""The plant: the simulated truth, its noisy sensors, and its input."""
