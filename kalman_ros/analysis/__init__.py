# SPDX-License-Identifier: Apache-2.0
"""What can be said of a scenario or a run: design, observability, bounds, verdicts."""
