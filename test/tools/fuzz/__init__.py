# SPDX-License-Identifier: Apache-2.0
"""Estimators under hostile input."""
