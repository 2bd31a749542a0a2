# SPDX-License-Identifier: Apache-2.0
"""Fit the parameters of an estimator to a recording."""
