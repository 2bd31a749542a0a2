# SPDX-License-Identifier: Apache-2.0
"""A recording through the estimator: statistics, checks, pictures and estimates."""
