# SPDX-License-Identifier: Apache-2.0
"""The thirteenth set of recordings: again other systems and faults."""
