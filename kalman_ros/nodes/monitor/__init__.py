# SPDX-License-Identifier: Apache-2.0
"""The monitor: the consistency of the estimate, and the cost of the control."""
