# SPDX-License-Identifier: Apache-2.0
"""The nodes: parameters in, objects wired, nothing clever."""
