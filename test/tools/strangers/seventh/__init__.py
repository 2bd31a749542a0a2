# SPDX-License-Identifier: Apache-2.0
"""The seventh set of recordings: again other systems and faults."""
