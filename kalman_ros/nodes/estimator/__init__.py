# SPDX-License-Identifier: Apache-2.0
"""The estimator: readings and inputs in, the state with its covariance out."""
