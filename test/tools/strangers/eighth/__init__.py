# SPDX-License-Identifier: Apache-2.0
"""The eighth set of recordings: again other systems and faults."""
