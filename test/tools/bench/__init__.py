# SPDX-License-Identifier: Apache-2.0
"""Speed as ratios to peers measured in the same run."""
