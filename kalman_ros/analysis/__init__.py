# SPDX-License-Identifier: Apache-2.0
"""Analysis of a scenario or a run: design, observability, error bounds, and checks."""
