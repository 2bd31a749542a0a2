# SPDX-License-Identifier: Apache-2.0
"""A comparison of filters on nonlinear problems."""
