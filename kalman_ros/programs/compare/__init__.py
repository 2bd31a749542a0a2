# SPDX-License-Identifier: Apache-2.0
"""Filters side by side on nonlinear problems."""
