# SPDX-License-Identifier: Apache-2.0
"""Optimal control of linear systems, and what theory promises of it."""
