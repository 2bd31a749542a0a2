# SPDX-License-Identifier: Apache-2.0
"""The fault matrix: cases, runs, findings and tables."""
