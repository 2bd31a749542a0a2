# SPDX-License-Identifier: Apache-2.0
"""Replay of a recording through the estimator: statistics, checks, pictures and estimates."""
